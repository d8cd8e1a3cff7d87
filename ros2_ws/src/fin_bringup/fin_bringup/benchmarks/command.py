"""`bench`: how fast many fish swim, beside MuJoCo and SciPy in the same run, where the time goes, and trials a second.

Core time is the processor time of the one thread that does the work, the least of several repeats: other work on the
machine then costs little accuracy, and ratios of one run compare what ran under the same conditions.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fin_bringup.benchmarks import mujoco_fish, other_programs, profile, swims, trials
from fin_bringup.benchmarks.measuring import DURATION, Sizes
from fin_plant import checks
from fin_plant.command import command

if TYPE_CHECKING:
    from collections.abc import Sequence

FULL = Sizes(5, (1, 10, 100, 1000, 10_000, 100_000), (1, 2, 3, 4, 5, 7, 8, 10, 15, 20), (4e-3, 2e-3, 1e-3, 2.5e-4), 200)
QUICK = Sizes(2, (1, 100, 2000), (1, 3, 20), (2e-3, 5e-4), 20)


def measure(sizes: Sizes) -> dict[str, Any]:
    """Return all figures."""
    lanes, rest = swims.methods(sizes), other_programs.others(sizes)
    default = next(r for r in lanes if r["reactive"] == "tip" and r["precision"] == "double" and r["step"] == 0.02)  # noqa: PLR2004
    return {
        "cores": os.cpu_count(),
        "lanes": lanes,
        "scaling": swims.scaling(sizes),
        "waters": swims.waters(sizes),
        "others": rest,
        "times_faster_than": {name: row["core_ms"] / default["core_ms"] for name, row in rest.items()},
        "real_time": DURATION / (default["core_ms"] * 1e-3),
        "operations": profile.operations(),
        "profile": profile.profile(sizes),
        "trial_loop": trials.trial_loops(sizes),
    }


def text(figures: dict[str, Any]) -> str:
    """Return the figures as tables for a reader."""
    lines = [f"{figures['cores']} cores; a swim: 10 s of the paper fin, three links, body free", ""]
    lines += [
        "| convective force | precision | step | core-ms a swim | largest error of the mean speed |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['reactive']} | {r['precision']} | {r['step'] * 1e3:.0f} ms | {r['core_ms']:.4f} | {r['error']:.1e} |"
        for r in figures["lanes"]
    ]
    lines += ["", "| the same swim by | core-ms | own error | times slower |", "|---|---|---|---|"]
    lines += [
        f"| {name} | {r['core_ms']:.2f} | {r['error']:.1e} | {figures['times_faster_than'][name]:.0f} |"
        for name, r in figures["others"].items()
    ]
    scale = figures["scaling"]
    lines += [
        "",
        "| swims | core-ms a swim |",
        "|---|---|",
        *(f"| {r['swims']:.0f} | {r['core_ms']:.4f} |" for r in scale["swims"]),
    ]
    lines += ["", "| links | core-ms, swum once | core-ms a swim |", "|---|---|---|"]
    lines += [f"| {r['links']:.0f} | {r['once_ms']:.4f} | {r['core_ms']:.4f} |" for r in scale["links"]]
    lines += [
        "",
        "| cores | swims a second |",
        "|---|---|",
        *(f"| {r['cores']:.0f} | {r['swims_per_second']:.0f} |" for r in scale["cores"]),
    ]
    lines += [
        "",
        "| water | wake | drag | core-ms a swim of a study of shapes | core-ms alone |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {r['model']} | {r['wake']} | {r['drag']} | {format(r['core_ms'], '.4f') if 'core_ms' in r else '-'} "
        f"| {r['alone_ms']:.1f} |"
        for r in figures["waters"]
    ]
    lines += ["", f"{figures['real_time']:.0f} times real time on one core", ""]
    lines += [
        "| where the time goes | |",
        "|---|---|",
        *(f"| {name} | {value:.4g} |" for name, value in figures["profile"].items()),
    ]
    lines += ["", "operations of a step: " + ", ".join(f"{n:.0f} {kind}" for kind, n in figures["operations"].items())]
    lines += ["", "| trials of the whole graph, a bag each | of | a second | times real time |", "|---|---|---|---|"]
    lines += [
        f"| {r['trials']:.0f} | {r['duration_s']:g} s | {r['trials_a_second']:.1f} | {r['real_time_factor']:.0f} |"
        for r in figures["trial_loop"]
    ]
    return "\n".join(lines) + "\n"


@command("bench", when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, or 2 for what is refused."""
    parser = argparse.ArgumentParser(prog="bench", description="Measure how fast many fish swim.")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument("--quick", action="store_true", help="fewer sizes and repeats")
    parser.add_argument("--repeats", type=checks.read_whole_number, help="of each measurement; the least time counts")
    options = parser.parse_args(arguments)
    sizes = QUICK if options.quick else FULL
    if options.repeats is not None:
        sizes = replace(sizes, repeats=checks.whole_number("--repeats", options.repeats, 1))
    mujoco_fish.require()
    figures = measure(sizes)
    sys.stdout.write(json.dumps(figures, indent=2) + "\n" if options.json else text(figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
