"""`bench`: how fast many fish swim, beside MuJoCo and SciPy in the same run, where the time goes, and trials a second.

Core time is the processor time of the one thread that does the work, the least of several repeats: other work on the
machine then costs little accuracy, and ratios of one run compare what ran under the same conditions.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.integrate

from fin_bringup import mujoco_fish
from fin_bringup.processes import find_executable
from fin_bringup.throughput import Throughput, throughput
from fin_plant import checks
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT, GaitFollower
from fin_sim import dynamics, swim, swim_batch
from fin_sim.batch import LONGEST_LANE_CHAIN
from fin_sim.batch.kernel import Form, generate
from fin_sim.chain import build_chain
from fin_sim.compiled import kernel
from fin_sim.swim import PAPER_FISH, RAMP_TIME

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

DURATION = 10.0
MODULI = np.linspace(0.5e9, 4e9, 15)
"""Stiffnesses over which the accuracy is stated, Pa: the paper's range."""
MUJOCO_ERROR = 0.01
"""Largest change of MuJoCo's speed, over the same range, from its finest step to the step that it is timed at."""
_REFUSED = 2
_NAMESPACE = "namespace:=/bench/fish"
_MICRO = 1e6
_MANY = 4096
"""Swims of which one is timed: enough that the set-up of a batch does not count."""


@dataclass(frozen=True)
class Sizes:
    """How much is measured."""

    repeats: int
    swims: tuple[int, ...]
    segments: tuple[int, ...]
    mujoco_steps: tuple[float, ...]
    trials: int


FULL = Sizes(5, (1, 10, 100, 1000, 10_000, 100_000), (1, 2, 3, 4, 5, 7, 8, 10, 15, 20), (4e-3, 2e-3, 1e-3, 2.5e-4), 200)
QUICK = Sizes(2, (1, 100, 2000), (1, 3, 20), (2e-3, 5e-4), 20)
TRIAL_DURATIONS = (10.0, 0.5)
"""Swims in s of the paper, and short ones, which show what a trial costs besides its swim."""


def core_time(work: Callable[[], object], repeats: int) -> float:
    """Return the least processor time of this thread in s that ``work`` took, after a first time that may compile."""
    work()
    taken = []
    for _ in range(repeats):
        begun = time.thread_time()
        work()
        taken.append(time.thread_time() - begun)
    return min(taken)


def wall_time(work: Callable[[], object], repeats: int) -> float:
    """Return the least time in s that ``work`` took, after a first time that may compile."""
    work()
    taken = []
    for _ in range(repeats):
        begun = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begun)
    return min(taken)


def converged(reactive: str) -> NDArray[np.float64]:
    """Return the mean speeds in m/s of the paper fin at ``MODULI`` by the general kernel at 1 ms: converged to 1e-8."""
    fins = [Fin(young_modulus=modulus) for modulus in MODULI]
    return np.array([swim(fin, duration=DURATION, reactive=reactive).mean_speed for fin in fins])  # type: ignore[arg-type]


def _batch(count: int, **options: Any) -> Callable[[], object]:
    """Return the work of swimming so many paper fins on one core, or as many as ``threads`` says."""
    columns = {"young_modulus": np.linspace(MODULI[0], MODULI[-1], count), **options.pop("columns", {})}
    arguments = {"reactive": "tip", "threads": 1, **options}
    return lambda: swim_batch(columns, **arguments)


def methods(sizes: Sizes) -> list[dict[str, Any]]:
    """Return the core time of a swim and its error for every form, precision and some steps of the lanes."""
    rows = []
    for reactive in ("tip", "distributed"):
        exact = converged(reactive)
        for precision in ("double", "single"):
            for step in (0.01, 0.02):
                options = {"reactive": reactive, "precision": precision, "step": step}
                taken = core_time(_batch(_MANY, **options), sizes.repeats)
                speeds = swim_batch({"young_modulus": MODULI}, threads=1, **options).mean_speed  # type: ignore[arg-type]
                error = float(np.abs(speeds / exact - 1.0).max())
                rows.append({**options, "core_ms": taken / _MANY * 1e3, "error": error})
    return rows


def scaling(sizes: Sizes) -> dict[str, list[dict[str, float]]]:
    """Return the time of a swim over the number of swims, of links and of cores."""
    over_swims = [
        {"swims": float(n), "core_ms": core_time(_batch(n), sizes.repeats if n <= _MANY else 1) / n * 1e3}
        for n in sizes.swims
    ]
    over_links = []
    for links in sizes.segments:
        lanes = links <= LONGEST_LANE_CHAIN
        n = 256 if lanes else 4
        taken = core_time(_batch(n, columns={"segments": np.full(n, links)}), sizes.repeats if lanes else 1)
        over_links.append({"links": float(links), "core_ms": taken / n * 1e3, "lanes": float(lanes)})
    n = 4 * _MANY
    over_cores = [
        {"cores": float(c), "swims_per_second": n / wall_time(_batch(n, threads=c), sizes.repeats)}
        for c in range(1, (os.cpu_count() or 1) + 1)
    ]
    return {"swims": over_swims, "links": over_links, "cores": over_cores}


def scipy_swim(relative_tolerance: float) -> float:
    """Return the mean speed of the paper fin by `solve_ivp` (LSODA) on the equations of the general kernel, m/s."""
    chain = build_chain(PAPER_FISH, Fin(), reactive="tip")
    table, body, links = chain.link_table(), chain.body_vector(), len(chain.links)
    follower = GaitFollower(1, RAMP_TIME)
    follower.command(PAPER_GAIT, 0.0)
    record, scratch = np.zeros(dynamics.RECORD_HEAD + links), np.zeros((links, dynamics.SCRATCH_COLUMNS))
    drive = np.zeros((links, 3))

    def slope(moment: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        drive[0] = follower.motion([moment])[0, 0]
        derivative, current = np.zeros(len(state)), state.copy()
        dynamics.evaluate(current, drive, table, body, True, False, derivative, record, scratch)  # noqa: FBT003
        derivative[dynamics.BODY_STATES + links] = drive[0, 2]
        return derivative

    start = np.zeros(dynamics.BODY_STATES + 2 * links)
    solution = scipy.integrate.solve_ivp(
        slope,
        (0.0, DURATION),
        start,
        method="LSODA",
        max_step=0.1,
        rtol=relative_tolerance,
        atol=1e-3 * relative_tolerance,
    )
    return float(np.hypot(*solution.y[:2, -1]) / DURATION)


def others(sizes: Sizes) -> dict[str, dict[str, float]]:
    """Return core time and error of the same swim by the general kernel, SciPy and MuJoCo, one core each."""
    exact = swim(duration=DURATION, reactive="tip").mean_speed
    general: dict[str, Any] = {"duration": DURATION, "reactive": "tip", "sample_time": 0.025, "step": 0.025}
    rows = {
        "general kernel at 25 ms": {
            "core_ms": core_time(lambda: swim(**general), sizes.repeats) * 1e3,
            "error": abs(swim(**general).mean_speed / exact - 1.0),
        }
    }
    tolerance = 1e-4
    rows["SciPy solve_ivp"] = {
        "core_ms": core_time(lambda: scipy_swim(tolerance), 1) * 1e3,
        "error": abs(scipy_swim(tolerance) / exact - 1.0),
        "relative_tolerance": tolerance,
    }
    fins = [Fin(young_modulus=modulus) for modulus in (MODULI[0], Fin().young_modulus, MODULI[-1])]
    speeds = {
        step: np.array([mujoco_fish.swim(fin, PAPER_FISH, PAPER_GAIT, DURATION, step) for fin in fins])
        for step in sizes.mujoco_steps
    }
    finest = speeds[min(speeds)]
    errors = {step: float(np.abs(speed / finest - 1.0).max()) for step, speed in speeds.items()}
    good = [step for step in errors if errors[step] <= MUJOCO_ERROR and step > min(speeds)]
    step = max(good, default=min(speeds))
    taken = core_time(lambda: mujoco_fish.swim(Fin(), PAPER_FISH, PAPER_GAIT, DURATION, step), sizes.repeats)
    row = {"core_ms": taken * 1e3, "error": errors[step], "step_ms": step * 1e3, "speed_cm_s": float(finest[1]) * 100.0}
    rows["MuJoCo rollout"] = row
    return rows


def operations() -> dict[str, float]:
    """Return what a step of one paper fish costs in floating-point operations, by kind."""
    form = Form(1, 3, free=True, distributed=False, tapered=False)
    return {kind: float(number) for kind, number in generate(form).operations.items()}


@kernel
def _multiply_add(work: NDArray[np.float64], factor: float, rounds: int) -> None:
    """Do 2 x 16 x len(work) x rounds operations with hardly a load between them; len(work) is a multiple of 64."""
    for _ in range(rounds):
        for i in range(64):
            x = work[i]
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            x = x * factor + x
            work[i] = x


def profile(sizes: Sizes) -> dict[str, float]:
    """Return where a batch's time goes, the rate of operations that its kernel reaches, and the machine's limit."""
    count = _MANY
    total = core_time(_batch(count), sizes.repeats)
    short = core_time(_batch(count, duration=0.02), sizes.repeats)
    steps = int(np.ceil(DURATION * 56 * 0.9))
    done = sum(operations().values()) * steps * count
    work, rounds = np.zeros(64), 100_000
    limit = 2 * 16 * 64 * rounds / core_time(lambda: _multiply_add(work, 1e-9, rounds), sizes.repeats)
    return {
        "core_us_per_swim": total / count * _MICRO,
        "set_up_us_per_swim": short / count * _MICRO,
        "ns_per_step_of_a_fish": (total - short) / count / steps * 1e9,
        "operations_per_step": sum(operations().values()),
        "gflops": done / (total - short) / 1e9,
        "gflops_limit": limit / 1e9,
        "share_of_limit": done / (total - short) / limit,
    }


def trial_loop(trials: int, duration: float) -> Throughput:
    """Return how fast the whole graph does trials in the simulator: three processes, a bag and the journal for each.

    Args:
        trials: Number of them.
        duration: Of a swim, in s.

    Raises:
        RuntimeError: The study failed; the message has the end of what it said.
    """
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / "study"
        words = (f"study_folder:={study}", f"trials:={trials}", f"measurement.duration:={duration}", _NAMESPACE)
        command = [str(find_executable("fin_bringup", "bringup")), *words, "disk.minimum_free:=0"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            msg = f"the study ended with exit code {done.returncode}:\n{done.stdout[-1000:]}{done.stderr[-1000:]}"
            raise RuntimeError(msg)
        return throughput(study)


def trial_loops(sizes: Sizes) -> list[dict[str, float]]:
    """Return trials a second and the factor of real time for long and short swims."""
    rows = []
    for duration in TRIAL_DURATIONS:
        found = trial_loop(sizes.trials, duration)
        figures = {"trials_a_second": found.trials_a_second, "real_time_factor": found.real_time_factor}
        rows.append({"duration_s": duration, "trials": float(found.trials), **figures})
    return rows


def measure(sizes: Sizes) -> dict[str, Any]:
    """Return all figures."""
    lanes, rest = methods(sizes), others(sizes)
    default = next(r for r in lanes if r["reactive"] == "tip" and r["precision"] == "double" and r["step"] == 0.02)  # noqa: PLR2004
    return {
        "cores": os.cpu_count(),
        "lanes": lanes,
        "scaling": scaling(sizes),
        "others": rest,
        "times_faster_than": {name: row["core_ms"] / default["core_ms"] for name, row in rest.items()},
        "real_time": DURATION / (default["core_ms"] * 1e-3),
        "operations": operations(),
        "profile": profile(sizes),
        "trial_loop": trial_loops(sizes),
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
    lines += ["", "| links | core-ms a swim | by |", "|---|---|---|"]
    lines += [
        f"| {r['links']:.0f} | {r['core_ms']:.4f} | {'lanes' if r['lanes'] else 'general kernel'} |"
        for r in scale["links"]
    ]
    lines += [
        "",
        "| cores | swims a second |",
        "|---|---|",
        *(f"| {r['cores']:.0f} | {r['swims_per_second']:.0f} |" for r in scale["cores"]),
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; exit 2 for what is refused."""
    parser = argparse.ArgumentParser(prog="bench", description="Measure how fast many fish swim.")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument("--quick", action="store_true", help="fewer sizes and repeats")
    parser.add_argument("--repeats", type=checks.read_whole_number, help="of each measurement; the least time counts")
    options = parser.parse_args(arguments)
    sizes = QUICK if options.quick else FULL
    try:
        if options.repeats is not None:
            sizes = replace(sizes, repeats=checks.whole_number("--repeats", options.repeats, 1))
        mujoco_fish.require()
    except ValueError as error:
        sys.stderr.write(f"bench: error: {error}\n")
        sys.exit(_REFUSED)
    figures = measure(sizes)
    sys.stdout.write(json.dumps(figures, indent=2) + "\n" if options.json else text(figures))


if __name__ == "__main__":
    main()
