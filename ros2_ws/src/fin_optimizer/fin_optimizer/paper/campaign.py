"""`campaign`: the paper's experiments, all or some, resumed where they were cut short, with the paper's figures.

A folder holds `study.json`, one file a finished run in `runs/`, and what is drawn from them. A run's file is written
whole under another name and then renamed, so a kill at any moment leaves finished runs and nothing else; the next
start carries out the missing ones. The runs may go to any executor of `concurrent.futures`, a Dask cluster's too.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import zipfile
from collections.abc import Callable
from concurrent.futures import as_completed
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from fin_optimizer.paper import comparison, experiments, figures, space_campaign, space_report
from fin_optimizer.paper.executors import open_executor
from fin_optimizer.paper.experiments import (
    EXPERIMENTS,
    MODEL,
    SIMULATION,
    STATED,
    Campaign,
    Run,
    perform,
    planned_runs,
)
from fin_optimizer.paper.space_campaign import (
    DEFAULT_FISH,
    LATER,
    SWUM,
    SpaceCampaign,
    SpaceRun,
    later_experiment,
    own_value,
)
from fin_optimizer.search.algorithms import ALGORITHMS
from fin_plant import checks, json_file, text_file
from fin_plant.command import command
from fin_plant.paths import given_path
from fin_plant.whole_file import write_text, write_whole
from fin_sim.chain import REACTIVE_FORMS
from fin_sim.presets import PRESETS, preset
from fin_sim.source_digest import simulator_digest
from fin_sim.water_settings import PRESETS as WATERS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from concurrent.futures import Executor

    from fin_optimizer.paper.experiments import Table

    AnyRun = Run | SpaceRun

_OF_A_SPACE = ("algorithm", "runs", "swims", "goal", "constraint", "fish", "fin", "reactive", "duration", "settle")
_OF_THE_PAPERS = (
    "variant",
    "hill_climber_runs",
    "hill_climber_candidates",
    "genetic_runs",
    "generations",
    "landscape",
    "modulus",
)
_SIMULATOR = "simulator"
"""Entry of a run's file that stands for the code that swam it."""
RunT = TypeVar("RunT", Run, SpaceRun)


Show = Callable[[int, int], None]
"""Told that so many more runs with so many swims are done."""


def _leave_out_water(settings: dict[str, Any]) -> None:
    """Take out what the settings did not hold when there was one kind of water: such a folder can be resumed."""
    del settings["water"]
    for given in settings["fish"].values():
        del given["fish"]["axes"]
        for name in ("model", "wake", "drag", "tip_term", "added_mass"):
            del given["fish"]["water"][name]


def _settings(campaign: Campaign | SpaceCampaign) -> dict[str, Any]:
    """Return what decides a campaign's results."""
    if isinstance(campaign, SpaceCampaign):
        more = {"space": json.loads(campaign.space), "fish": {campaign.fish: asdict(campaign.given)}}
        if campaign.settle > 0.0:  # older versions took all of the window, and their runs are not gone on with
            more["window"] = "whole beats"
    else:
        more = {"fish": {name: asdict(preset(name)) for name in (MODEL, SIMULATION, STATED)}}
    settings = dict(json.loads(json.dumps({**asdict(campaign), **more})))
    if campaign.water == "strip":
        _leave_out_water(settings)
    return settings


def _begin_folder(folder: Path, campaign: Campaign | SpaceCampaign) -> None:
    """Make the folder of a campaign, where there is none yet."""
    settings = folder / "study.json"
    try:
        (folder / "runs").mkdir(parents=True, exist_ok=True)
        if not settings.exists():
            write_text(settings, json.dumps(_settings(campaign), indent=2) + "\n")
    except OSError as error:
        msg = f"cannot write to the folder {folder}: {error.strerror}; choose another one with --output"
        raise ValueError(msg) from None


def _refuse_another(folder: Path, campaign: Campaign | SpaceCampaign) -> None:
    """Refuse a folder that holds another campaign."""
    settings, wanted = folder / "study.json", _settings(campaign)
    if not settings.exists():
        return
    try:
        with text_file.named(settings):
            found = json_file.read(settings)
    except ValueError as error:
        msg = f"{error}: move it away, or choose another folder with --output"
        raise ValueError(msg) from None
    if found != wanted:
        changed = ["all"]
        if isinstance(found, dict):
            changed = [name for name in {**wanted, **found} if found.get(name) != wanted.get(name)]
        msg = (
            f"{folder} holds a campaign with other settings ({', '.join(changed)}): give the same ones to resume it "
            "(the fish are the presets of this version), or choose another folder with --output"
        )
        raise ValueError(msg)


def load_run(path: Path, run: AnyRun) -> Table:
    """Return the candidates of a finished run.

    Raises:
        ValueError: A file that is no whole result of this run.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as content:
            table = {name: content[name] for name in content.files}
            name = str(table.pop("run"))
            table.pop(_SIMULATOR, None)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        msg = f"result file {path} is damaged ({error}): move it away, the run is then repeated"
        raise ValueError(msg) from None
    if name != run.name:
        msg = f"result file {path} is that of run {name}: move it away, the run is then repeated"
        raise ValueError(msg)
    sizes = {column.shape for column in table.values()}
    if not set(run.columns) <= table.keys() or len(sizes) != 1:
        msg = f"result file {path} is damaged (columns missing or cut short): move it away, the run is then repeated"
        raise ValueError(msg)
    return table


def _save(path: Path, run: AnyRun, table: Table) -> None:
    told = {"run": np.array(run.name), _SIMULATOR: np.array(simulator_digest())}
    write_whole(path, lambda part: np.savez_compressed(part, allow_pickle=False, **told, **table))


def finished(folder: Path, runs: Sequence[RunT]) -> dict[RunT, Table]:
    """Return the runs whose results lie in the folder.

    Raises:
        ValueError: A file that is no whole result.
    """
    paths = {run: folder / "runs" / f"{run.name}.npz" for run in runs}
    return {run: load_run(path, run) for run, path in paths.items() if path.exists()}


def swum_by_others(folder: Path, runs: Iterable[AnyRun]) -> list[AnyRun]:
    """Return the finished runs that another version of the simulator swam, or one that did not tell which it was."""
    others = []
    for run in runs:
        with (folder / "runs" / f"{run.name}.npz").open("rb") as file, np.load(file, allow_pickle=False) as content:
            if _SIMULATOR not in content.files or str(content[_SIMULATOR]) != simulator_digest():
                others.append(run)
    return others


def carry_out(runs: Sequence[RunT], folder: Path, executor: Executor, show: Show) -> dict[RunT, Table]:
    """Carry out runs, write each as soon as its group is done, and return their tables.

    Args:
        runs: The runs.
        folder: The campaign's folder.
        executor: Where they are carried out; results do not depend on it.
        show: Told of every finished group.
    """
    work: Any = space_campaign if any(isinstance(run, SpaceRun) for run in runs) else experiments
    waiting = {executor.submit(work.perform, group): group for group in work.groups(runs)}
    results = {}
    try:
        for future in as_completed(waiting):
            for run, table in zip(waiting[future], future.result(), strict=True):
                _save(folder / "runs" / f"{run.name}.npz", run, table)
                results[run] = table
                show(1, len(table["candidate"]))
    finally:
        for future in waiting:
            future.cancel()
    return results


def collect(folder: Path, results: Mapping[Run, Table]) -> None:
    """Write the tidy tables: every candidate in candidates.npz, every run in runs.csv."""
    ordered = sorted(results, key=lambda run: (list(EXPERIMENTS).index(run.experiment), run.number))
    sizes = [len(results[run]["speed"]) for run in ordered]
    columns: dict[str, np.ndarray] = {
        "experiment": np.repeat([run.experiment for run in ordered], sizes),
        "run": np.repeat([run.number for run in ordered], sizes),
    }
    for name in results[ordered[0]]:
        columns[name] = np.concatenate([results[run][name] for run in ordered])
    write_whole(folder / "candidates.npz", lambda path: np.savez_compressed(path, allow_pickle=False, **columns))
    lines = ["experiment,run,seed,swims,best_speed_m_s,young_modulus_pa,length_m,height_m"]
    for run in ordered:
        best = comparison.best(results[run])
        shown = ",".join(f"{best[name]:.9g}" for name in ("speed", "young_modulus", "length", "height"))
        lines.append(f"{run.experiment},{run.number},{run.seed},{len(results[run]['speed'])},{shown}")
    write_text(folder / "runs.csv", "\n".join(lines) + "\n")


def compile_first(runs: Sequence[AnyRun]) -> float:
    """Compile what the runs need, so that workers find it in the cache; return the time that it took in s."""
    begun = time.perf_counter()
    if isinstance(runs[0], SpaceRun):
        space_campaign.perform([replace(runs[0], campaign=replace(runs[0].campaign, swims=1))])
        return time.perf_counter() - begun
    small = {"landscape": 2, "generations": 1, "population": 2, "hill_climber_candidates": 1}
    papers = [run for run in runs if isinstance(run, Run)]
    for experiment in dict.fromkeys(run.experiment for run in papers):
        first = next(run for run in papers if run.experiment == experiment)
        perform([replace(first, campaign=replace(first.campaign, **small))])  # type: ignore[arg-type]
    return time.perf_counter() - begun


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="campaign", description="Run the paper's experiments; the same command again resumes them."
    )
    add = parser.add_argument
    names = ", ".join(EXPERIMENTS)
    later = ", ".join(LATER)
    add("experiments", nargs="*", metavar="EXPERIMENT", help=f"all, or some of: {names}; or one of: {later}")
    add("--output", type=given_path, help="folder of the results (default: runs/campaign, or of its own for a space)")
    add("--variant", choices=("paper", "2012"), help="sizes of the paper, or of Clark et al. 2012")
    add("--water", choices=tuple(WATERS), default="strip", help="preset of the water that all fish swim in")
    add("--seed", type=checks.read_whole_number, help="of all random numbers")
    add("--hill-climber-runs", type=checks.read_whole_number, help="runs of the hill climber")
    add("--hill-climber-candidates", type=checks.read_whole_number, help="fins that each of them tries")
    add("--genetic-runs", type=checks.read_whole_number, help="runs of each genetic algorithm")
    add("--population", type=checks.read_whole_number, help="individuals of a generation")
    add("--generations", type=checks.read_whole_number, help="generations of a run")
    add("--landscape", type=checks.read_whole_number, help="points over E, and over the length")
    add(
        "--modulus",
        type=checks.read_number,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="range of E in GPa for experiments on E alone",
    )
    space = parser.add_argument_group("any search over the space of a file, in place of an experiment")
    add = space.add_argument
    add("--space", type=given_path, metavar="FILE", help="the space, a YAML file as a study takes it")
    add("--algorithm", metavar="NAME", help=f"the search: {', '.join(ALGORITHMS)}")
    add("--runs", type=checks.read_whole_number, help="runs of the search (default: 1)")
    add("--swims", type=checks.read_whole_number, help="swims of a run (default: 1000)")
    add("--goal", action="append", metavar="MEASURE", help=f"what is good, one or several: {', '.join(SWUM)}")
    add("--constraint", action="append", metavar="TEXT", help="what must be met, for example 'power <= 0.5 W'")
    add("--fish", help=f"{DEFAULT_FISH}, or one of {', '.join(PRESETS)} (default: {DEFAULT_FISH})")
    add("--fin", action="append", metavar="fin.NAME=VALUE", help="what its fin has otherwise")
    add("--reactive", choices=REACTIVE_FORMS, help="form of Lighthill's force (default: the fish's)")
    add("--duration", type=checks.read_number, help="length of a swim from rest in s (default: 10)")
    add(
        "--settle",
        type=checks.read_number,
        help="start of the window of all measures in s, above 0 of whole beats (default: 0)",
    )
    add = parser.add_argument
    add("--workers", type=checks.read_whole_number, default=os.cpu_count() or 1, help="processes (default: one a core)")
    add("--dask", metavar="ADDRESS", help="carry the runs out on the Dask cluster with this scheduler")
    return parser


def _campaign_of(arguments: argparse.Namespace) -> Campaign:
    campaign = Campaign.clark() if arguments.variant == "2012" else Campaign()
    sizes = ("seed", "hill_climber_runs", "hill_climber_candidates", "genetic_runs", "population", "generations")
    given = {
        name: getattr(arguments, name)
        for name in (*sizes, "landscape", "water")
        if getattr(arguments, name) is not None
    }
    if arguments.modulus is not None:
        given["modulus"] = tuple(
            checks.number("--modulus", value, 0.01, 200.0, unit="GPa") * 1e9 for value in arguments.modulus
        )
    return replace(campaign, **given)


def _space_campaign_of(arguments: argparse.Namespace) -> SpaceCampaign | None:
    """Return the campaign over a space that is asked for, if one is.

    Raises:
        ValueError: It is refused, or options that have no meaning for it are given.
    """
    later = [name for name in arguments.experiments if name in LATER]
    given = {name: getattr(arguments, name) for name in _OF_A_SPACE if getattr(arguments, name) is not None}
    if not later and arguments.space is None:
        if given:
            msg = f"--{next(iter(given))} needs a space: give --space FILE, or name one of {', '.join(LATER)}"
            raise ValueError(msg)
        return None
    if len(arguments.experiments) > (arguments.space is None):
        msg = f"{', '.join(arguments.experiments)}: a campaign over a space is carried out alone; leave the others out"
        raise ValueError(msg)
    if wrong := [name for name in _OF_THE_PAPERS if getattr(arguments, name) is not None]:
        msg = f"--{wrong[0].replace('_', '-')} is of the papers' experiments: leave it out"
        raise ValueError(msg)
    shared = ("seed", "population", "water")
    given |= {name: getattr(arguments, name) for name in shared if getattr(arguments, name) is not None}
    for one, several in (("goal", "goals"), ("constraint", "constraints")):
        if one in given:
            given[several] = tuple(given.pop(one))
    if "fin" in given:
        given["fin"] = tuple(map(own_value, given["fin"]))
    if later:
        return replace(later_experiment(later[0]), **given)
    if "algorithm" not in given:
        msg = f"--space needs --algorithm, one of {', '.join(ALGORITHMS)}"
        raise ValueError(msg)
    return SpaceCampaign.of_file(arguments.space, **given)


def _folder_of(arguments: argparse.Namespace) -> Path:
    if arguments.output is not None:
        return Path(arguments.output)
    if arguments.space is not None:
        return Path("runs") / f"campaign-{arguments.space.stem}-{arguments.algorithm}"
    later = [name for name in arguments.experiments if name in LATER]
    return Path("runs") / (f"campaign-{later[0]}" if later else "campaign")


def _run(arguments: argparse.Namespace, console: Console) -> Path:
    """Carry out what is missing, write tables and pictures; return the folder."""
    of_space = _space_campaign_of(arguments)
    workers = checks.whole_number("--workers", arguments.workers, 1)
    folder = _folder_of(arguments)
    warn = partial(console.print, "campaign: warning:", markup=False)
    if of_space is not None:
        found = _carried_out(of_space, of_space.planned(), folder, workers, arguments.dask, console)
        paths = space_report.write(folder, of_space, found, warn)
    else:
        campaign = _campaign_of(arguments)
        runs = planned_runs(campaign, arguments.experiments)
        results = _carried_out(campaign, runs, folder, workers, arguments.dask, console)
        collect(folder, results)
        paths = figures.write(folder, campaign, results, warn)
    for path in paths:
        console.print(f"wrote {path}")
    return folder


def _carried_out(
    campaign: Campaign | SpaceCampaign,
    runs: Sequence[RunT],
    folder: Path,
    workers: int,
    dask: str | None,
    console: Console,
) -> dict[RunT, Table]:
    _refuse_another(folder, campaign)
    results = finished(folder, runs)
    if others := swum_by_others(folder, results):
        console.print(
            f"campaign: warning: {len(others)} of the {checks.counted(len(results), 'finished run')} in {folder} "
            "were swum by another version of the simulator, whose numbers may differ: another folder by --output "
            "swims all anew",
            markup=False,
        )
    missing = [run for run in runs if run not in results]
    took = compile_first(missing) if missing else 0.0  # what cannot swim is refused by it, before anything is written
    _begin_folder(folder, campaign)
    if missing:
        console.print(f"compiled in {took:.1f} s; {len(results)} of {len(runs)} runs are done already")
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("runs"))
        bar = Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console)
        with open_executor(workers, dask) as executor, bar:
            task = bar.add_task("swimming", total=len(missing))
            begun, swum = time.perf_counter(), 0

            def show(done: int, swims: int) -> None:
                nonlocal swum
                swum += swims
                bar.advance(task, done)

            results |= carry_out(missing, folder, executor, show)
            took = time.perf_counter() - begun
        console.print(f"{swum} swims in {took:.1f} s, {swum / took:.0f} a second")
    return results


@command("campaign", when_output_closes=None)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0 when done, 2 for what is refused, 130 when interrupted."""
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    try:
        options = _parser().parse_args(arguments)
        folder = _run(options, console)
        for report in (folder / "paper.md", folder / space_report.REPORT):
            if report.exists():
                sys.stdout.write(report.read_text(encoding="utf-8"))
    except KeyboardInterrupt:
        console.print("campaign: interrupted; the same command again goes on with the runs that are missing")
        raise
    return 0


if __name__ == "__main__":
    sys.exit(main())
