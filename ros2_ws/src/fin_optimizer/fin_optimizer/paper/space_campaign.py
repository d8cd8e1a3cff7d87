"""A campaign over a space that a file describes: any search, any goals, many runs, in the batch simulator.

A run is a pure function of the campaign and its number. Runs that are carried out together go in step, so that what all
of them ask for next swims side by side; each gets the candidates that it would get alone.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np

from fin_optimizer.goals import Goals
from fin_optimizer.paper.experiments import in_water
from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.search.algorithms import ALGORITHMS, search
from fin_optimizer.search.genetic import Generation
from fin_optimizer.search.many import columns_of
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Evaluation
from fin_optimizer.search.space_file import read_content, space_of
from fin_plant import checks, text_file
from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.paths import config_folder
from fin_plant.units import in_range
from fin_sim.batch import swim_batch
from fin_sim.chain import REACTIVE_FORMS
from fin_sim.presets import PRESETS, Preset, preset
from fin_sim.swim import PAPER_FISH
from fin_sim.water_settings import PRESETS as WATERS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_optimizer.search.genetic import PopulationSearch
    from fin_optimizer.search.space import Search
    from fin_optimizer.search.space_file import SpaceFile
    from fin_sim.chain import Reactive

    Array = NDArray[np.float64]
    Table = dict[str, Array]

DEFAULT_FISH = "default"
"""Name of the simulator's own fish and fin, beside the presets."""
SWUM = ("mean_speed", "steady_speed", "power", "energy_per_metre", "thrust", "efficiency")
"""Measures that the batch can tell."""
_STEP_SHARE = 0.1
"""As of a study: standard deviation of a step over the range of a parameter."""
_MOST_AT_ONCE = 512
"""Candidates of a run that swim together where no score decides what follows."""
_IN_STEP = {"hill_climber": 25, "genetic": 10, "cma_es": 25, "nsga2": 5}
"""Runs carried out together, by search; of others one, for proposing takes longer than swimming."""


class SpaceError(ValueError):
    """Something in the space itself is refused: whoever knows its file names it."""


@dataclass(frozen=True)
class SpaceCampaign:
    """Runs of one search over one space.

    Attributes:
        space: What the space's file says, as JSON, the stock in its place.
        algorithm: One of `ALGORITHMS`.
        runs: Number of runs, each with random numbers of its own.
        swims: Of a run; where candidates come by generations the last one is whole.
        population: Candidates of a generation; 0 takes the search's own number.
        seed: Of all random numbers.
        goals: What is to be good, some of `SWUM`.
        constraints: What must be met beside, like ``mean_speed >= 2 cm/s``.
        fish: A preset, or ``default``: whose fish swims, and whose fin the search starts from.
        fin: What the fin has otherwise than the preset's, name and value.
        water: Preset of the water (`fin_sim.water_settings`); ``strip`` is the fish's own.
        reactive: Form of Lighthill's force; the fish's own where it is empty.
        duration: Of a swim from rest, s.
        settle: Time from the start to the window over which every measure is a mean, s. Where it is above 0 the mean is
            over the whole beats that end with the window, as many as it has, for candidates may beat differently.

    Raises:
        ValueError: A value that is refused.
    """

    space: str
    algorithm: str
    runs: int = 1
    swims: int = 1000
    population: int = 0
    seed: int = 2012
    goals: tuple[str, ...] = ("mean_speed",)
    constraints: tuple[str, ...] = ()
    fish: str = DEFAULT_FISH
    fin: tuple[tuple[str, Any], ...] = ()
    water: str = "strip"
    reactive: str = ""
    duration: float = 10.0
    settle: float = 0.0

    def __post_init__(self) -> None:
        checks.choice("--algorithm", self.algorithm, ALGORITHMS)
        checks.choice("--fish", self.fish, (DEFAULT_FISH, *PRESETS))
        checks.choice("--water", self.water, WATERS)
        checks.whole_number("--runs", self.runs, 1)
        checks.whole_number("--swims", self.swims, 1)
        checks.whole_number("--population", self.population, 0)
        checks.whole_number("--seed", self.seed, 0)
        checks.number("--duration", self.duration, 0.0, 1e4, unit="s", exclusive_minimum=True)
        checks.number("--settle", self.settle, 0.0, 0.999 * self.duration, unit="s")
        self._check_goals()
        _plan(self)

    def _check_goals(self) -> None:
        if unknown := [each.name for each in self.wanted.asked if each.name not in SWUM]:
            msg = f"the batch simulator cannot tell {', '.join(unknown)}: choose of {', '.join(SWUM)}"
            raise ValueError(msg)
        if "efficiency" in {each.name for each in self.wanted.asked} and self.given.reactive == "tip":
            msg = (
                f"fish {self.fish} has reactive = tip, which gives wrong servo power: efficiency needs --reactive "
                "distributed"
            )
            raise ValueError(msg)

    @classmethod
    def of_file(cls, path: Path, **given: Any) -> SpaceCampaign:
        """Return the campaign over the space of a file.

        Raises:
            ValueError: The file, or something given, is refused.
        """
        with text_file.named(path, "space"):
            content, _ = read_content(path)
        try:
            return cls(json.dumps(content), **given)
        except SpaceError as error:
            msg = f"space {path}: {error}"
            raise ValueError(msg) from error

    @property
    def given(self) -> Preset:
        """Fish and fin that the search starts from."""
        start = Preset(Fin(), PAPER_FISH, "distributed") if self.fish == DEFAULT_FISH else preset(self.fish)
        fin = Fin.from_parameters(start.fin.as_parameters() | dict(self.fin))
        reactive = checks.choice("--reactive", self.reactive, REACTIVE_FORMS) if self.reactive else start.reactive
        return in_water(replace(start, fin=fin, reactive=cast("Reactive", reactive)), self.water)

    @property
    def start(self) -> SpaceFile:
        """What the space's file says, for this fish."""
        return _plan(self)

    @property
    def wanted(self) -> Goals:
        """What is looked for."""
        return Goals.of(self.goals, self.constraints)

    def planned(self) -> list[SpaceRun]:
        """Return all runs."""
        return [SpaceRun(self, number) for number in range(self.runs)]


def own_value(text: str) -> tuple[str, Any]:
    """Return a parameter of the fin and its value, read from ``fin.thickness=1.2 mm``.

    Raises:
        ValueError: It is none.
    """
    name, _, value = (part.strip() for part in text.partition("="))
    try:
        entry = FIN_PARAMETERS.require(name)
        if entry.kind == "double":
            return name, in_range(name, value, entry)
        return name, entry.check(checks.read_whole_number(value) if entry.kind == "integer" else value)
    except ValueError as error:
        msg = f"--fin {text}: {error}"
        raise ValueError(msg) from None


@cache
def _plan(campaign: SpaceCampaign) -> SpaceFile:
    given = campaign.given
    joints = given.fish.driven_joints
    gait = {name: entry.default for name, entry in OPTIMIZER_PARAMETERS.items() if name.startswith("gait.")}
    if joints > 1:
        gait |= {"gait.preset": "sub_carangiform", "gait.driven_joints": joints}
    try:
        found = space_of(json.loads(campaign.space), {}, {**given.fin.as_parameters(), **gait}, joints)
    except ValueError as error:
        raise SpaceError(str(error)) from error
    _search_of(campaign, found, 0)
    return found


def _search_of(campaign: SpaceCampaign, found: SpaceFile, seed: int) -> Search:
    deviations = {d.name: max(_STEP_SHARE * (d.high - d.low), d.step) for d in found.space.ranges}
    return search(
        campaign.algorithm,
        found.space,
        seed,
        deviations,
        campaign.population,
        objectives=len(campaign.goals),
        constraints=len(campaign.constraints),
    )


@dataclass(frozen=True)
class SpaceRun:
    """One run: what it computes depends on nothing else."""

    campaign: SpaceCampaign
    number: int

    @property
    def experiment(self) -> str:
        """What tables call it."""
        return self.campaign.algorithm

    @property
    def name(self) -> str:
        """Name of the run's file."""
        return f"{self.experiment}-{self.number:03d}"

    @property
    def seed(self) -> int:
        """Seed of the run's search, independent of those of all other runs."""
        state = np.random.SeedSequence(self.campaign.seed, spawn_key=(self.number,)).generate_state(1, np.uint64)
        return int(state[0])

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of its table: generation, candidate, what was searched (of a choice its place), and the measures."""
        return ("generation", "candidate", *self.campaign.start.space.names, *SWUM)


class _Asked(Protocol):
    """A search under way."""

    def ask(self) -> Array:
        """Return candidates that may swim together, shape (n, parameters); none when the run is over."""

    def tell(self, tried: Generation) -> None:
        """Take what they achieved."""


class _ByGeneration:
    def __init__(self, proposes: PopulationSearch, swims: int) -> None:
        self._search, self._left = proposes, swims
        self._history: list[Generation] = []

    def ask(self) -> Array:
        return self._search.propose(self._history) if self._left > 0 else np.empty((0, len(self._search.space.names)))

    def tell(self, tried: Generation) -> None:
        self._history.append(tried)
        self._left -= len(tried.scores)


class _ByCandidate:
    def __init__(self, proposes: Search, swims: int) -> None:
        self._search, self._swims = proposes, swims
        self._history: list[Evaluation] = []

    def ask(self) -> Array:
        settled, asked = len(self._history), list(self._history)
        most = min(self._swims, settled + _MOST_AT_ONCE)
        while len(asked) < most and self._search.needed(len(asked)) <= settled:
            asked.append(Evaluation(self._search.propose(asked), None, pending=True))
        rows = [self._search.space.row(entry.values) for entry in asked[settled:]]
        return np.array(rows).reshape(len(rows), len(self._search.space.names))

    def tell(self, tried: Generation) -> None:
        nothing = np.empty((len(tried.scores), 0))
        others, excesses = (nothing if each is None else each for each in (tried.others, tried.excesses))
        for row, score, more, missed in zip(tried.values.tolist(), tried.scores, others, excesses, strict=True):
            values = self._search.space.values(row)
            if np.isnan(score):
                self._history.append(Evaluation(values, None))
            else:
                self._history.append(Evaluation(values, float(score), tuple(more.tolist()), tuple(missed.tolist())))


@dataclass
class _Running:
    run: SpaceRun
    asked: _Asked
    tables: list[Table]


def _begun(run: SpaceRun) -> _Running:
    proposes = _search_of(run.campaign, run.campaign.start, run.seed)
    swims = run.campaign.swims
    if isinstance(proposes, OneByOne):
        return _Running(run, _ByGeneration(proposes.search, swims), [])
    return _Running(run, _ByCandidate(proposes, swims), [])


def perform(runs: Sequence[SpaceRun]) -> list[Table]:
    """Carry out runs of one campaign in step; return the candidates of each, columns of `SpaceRun.columns`."""
    campaign = runs[0].campaign
    goals, under_way = campaign.wanted, [_begun(run) for run in runs]
    while True:
        asked = [each.asked.ask() for each in under_way]
        if not any(map(len, asked)):
            break
        swum = swim_candidates(campaign, np.vstack([numbers for numbers in asked if len(numbers)]))
        first = 0
        for each, numbers in zip(under_way, asked, strict=True):
            if not len(numbers):
                continue
            own = {name: column[first : first + len(numbers)] for name, column in swum.items()}
            first += len(numbers)
            each.asked.tell(_tried(goals, numbers, own))
            each.tables.append(_table(campaign, len(each.tables), numbers, own))
    return [{name: np.concatenate([t[name] for t in each.tables]) for name in each.run.columns} for each in under_way]


def _tried(goals: Goals, numbers: Array, swum: Table) -> Generation:
    """Return candidates with what they achieved; those that lack anything have no score."""
    objectives = np.column_stack(goals.objectives(swum))
    excesses = np.column_stack([*goals.excesses(swum), np.zeros(len(numbers))])[:, :-1]
    missing = np.isnan(objectives).any(axis=1) | np.isnan(excesses).any(axis=1)
    scores = np.where(missing, np.nan, objectives[:, 0])
    others = np.where(missing[:, None], np.nan, objectives[:, 1:])
    return Generation(numbers, scores, others if others.shape[1] else None, excesses if excesses.shape[1] else None)


def _table(campaign: SpaceCampaign, generation: int, numbers: Array, swum: Table) -> Table:
    names = campaign.start.space.names
    return {
        "generation": np.full(len(numbers), float(generation)),
        "candidate": np.arange(len(numbers), dtype=float),
        **dict(zip(names, numbers.T, strict=True)),
        **swum,
    }


def swim_candidates(campaign: SpaceCampaign, numbers: Array) -> Table:
    """Return the measures of `SWUM` of candidates, shape (n, parameters): each of shape (n,), NaN where there is none.

    All are means over the window, see `SpaceCampaign.settle`. Thrust is the force with which the tail pushes the body,
    see `BatchSwim.thrust`.
    """
    start, given = campaign.start, campaign.given
    columns = columns_of(start.space, start.rules, start.start, numbers)
    swum = swim_batch(
        columns.fins,
        given.fish,
        columns.gaits,
        campaign.duration,
        settle=campaign.settle,
        whole_beats=campaign.settle > 0.0,
        reactive=given.reactive,
        threads=1,
    )
    speed, power = swum.mean_forward_speed, swum.servo_power
    with np.errstate(all="ignore"):
        return {
            "mean_speed": speed,
            "steady_speed": speed,
            "power": power,
            "energy_per_metre": np.where((speed > 0.0) & (power > 0.0), power / speed, np.nan),
            "thrust": swum.thrust,
            "efficiency": np.where((speed > 0.0) & (power > 0.0), swum.thrust * speed / power, np.nan),
        }


def groups(runs: Sequence[SpaceRun]) -> list[list[SpaceRun]]:
    """Return the runs as the groups in which they are carried out; grouping changes no result."""
    size = _IN_STEP.get(runs[0].campaign.algorithm, 1) if runs else 1
    return [list(runs[start : start + size]) for start in range(0, len(runs), size)]


def later_experiment(name: str) -> SpaceCampaign:
    """Return one of `LATER` as it is by default."""
    file, given = LATER[name]
    return SpaceCampaign.of_file(config_folder("fin_optimizer") / file, **given)


_FINE = {"fin": (("fin.segments", 20),)}
LATER: dict[str, tuple[str, dict[str, Any]]] = {
    "ices2014": (
        "ices2014.yaml",
        {
            "algorithm": "nsga2",
            "runs": 20,
            "swims": 200 * 500,
            "population": 200,
            "goals": ("mean_speed", "efficiency"),
            "fin": (("fin.segments", 5), ("fin.thickness", 1.2e-3)),
            "settle": 5.0,
        },
    ),
    "profile": ("twenty_heights.yaml", {"algorithm": "cma_es", "runs": 3, "swims": 3_000, "population": 30, **_FINE}),
    "rectangle": ("rectangle.yaml", {"algorithm": "cma_es", "runs": 5, "swims": 1_000, "population": 20, **_FINE}),
}
"""Experiments of later papers and of this project, over spaces of ``config``: file, and what is not the default."""
