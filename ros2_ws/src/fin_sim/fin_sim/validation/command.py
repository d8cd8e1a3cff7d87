"""The command ``validation``: computes every figure, draws the pictures and writes ``docs/validation.md``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from fin_plant.command import command
from fin_plant.paths import given_path
from fin_sim.validation import (
    convergence,
    equations,
    later_fins,
    measured,
    measured_fins,
    paper,
    potential_flow,
    reference,
)
from fin_sim.validation.page import render

if TYPE_CHECKING:
    from collections.abc import Sequence


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="validation", description=__doc__)
    parser.add_argument("--data", type=given_path, default=Path("tests/data"), help="reference cases, curves and swims")
    parser.add_argument(
        "--docs", type=given_path, default=Path("docs"), help="where validation.md and figures/ are written"
    )
    return parser


@command("validation", when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, 1 where a figure of the project's own misses its target, 2 for bad input."""
    options = _parser().parse_args(arguments)
    if not (options.data / "cases").is_dir():
        msg = f"{options.data} has no folder cases: run in the repository or give --data"
        raise ValueError(msg)
    figures = options.docs / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    parts = (
        ("closed forms", equations.section),
        ("reference cases", lambda: reference.section(options.data / "cases")),
        ("potential flow", lambda: potential_flow.section(options.data / "potential_flow")),
        ("convergence", lambda: convergence.section(figures)),
        ("the papers' curves", lambda: paper.section(options.data, figures)),
        ("measured fins", lambda: measured_fins.section(figures)),
        ("later fins", lambda: later_fins.section(options.data)),
        ("measured swims", lambda: measured.section(options.data, figures)),
    )
    sections = []
    for name, make in parts:
        print(f"validation: {name}", file=sys.stderr)  # noqa: T201
        sections.append(make())
    page = options.docs / "validation.md"
    page.write_text(render(sections), encoding="utf-8")
    missed = [check for section in sections for check in section.checks if not check.passed]
    for check in missed:
        kind = "differs from what is published" if check.finding else "missed"
        print(f"validation: {kind}: {check.name}: {check.value:.3g}, target {check.target:.3g}", file=sys.stderr)  # noqa: T201
    print(f"validation: wrote {page}", file=sys.stderr)  # noqa: T201
    return 0 if all(check.finding for check in missed) else 1


if __name__ == "__main__":
    sys.exit(main())
