"""Command ``recover_study``: makes a study's journal anew that was lost, cut, damaged or changed."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from fin_optimizer.plan import StudyPlan
from fin_optimizer.study.recovery import recover
from fin_plant.checks import counted
from fin_plant.command import command
from fin_plant.output import go_on_when_output_closes
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from fin_optimizer.search.space import Search
    from fin_optimizer.study.recovery import Recovery


@command("recover_study", when_output_closes=go_on_when_output_closes)
def main(arguments: Sequence[str] | None = None) -> int:
    """Recover a study; return 0, or 2 if that cannot be done."""
    parser = argparse.ArgumentParser(
        prog="recover_study",
        description="Make a study's journal anew, where it was lost, cut, damaged or changed by another program: from "
        "its first entries as far as they are whole, and from the bags. The old journal stays beside it.",
    )
    parser.add_argument("study", type=given_path, metavar="STUDY", help="its folder, with study.json and bags/")
    folder = parser.parse_args(arguments).study
    try:
        recovery = recover(folder, _search(folder))
    except OSError as error:
        msg = f"cannot write the journal of {folder}: {error.strerror or error}"
        raise ValueError(msg) from None
    said = [f"{folder}: the journal is as it should be, nothing to recover"] if recovery is None else _said(recovery)
    sys.stdout.writelines(f"{line}\n" for line in said)
    return 0


def _search(folder: Path) -> Search | None:
    """Return what proposes the study's fins; None where that cannot be told any more."""
    try:
        return StudyPlan.of_study(folder).search
    except (OSError, ValueError):
        return None


def _said(recovery: Recovery) -> Iterator[str]:
    kept, bags = counted(recovery.kept, "trial"), counted(len(recovery.from_bags), "trial")
    yield f"the journal was made anew: {kept} from what was whole of it, {bags} from bags"
    if recovery.lost:
        numbers = ", ".join(f"{number:04d}" for number in recovery.lost)
        yield f"of {counted(len(recovery.lost), 'trial')} nothing tells how it ended, they are made again: {numbers}"
    if recovery.set_aside is not None:
        yield f"the old journal is {recovery.set_aside.name} now"


if __name__ == "__main__":
    sys.exit(main())
