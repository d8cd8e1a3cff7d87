"""The paper's experiments, each a number of independent runs; a run is a pure function of its plan.

Raja Mohamed & Raviraj repeat Clark et al. (ALIFE 13, 2012): speed over the stiffness of the fin in a mathematical model
and in simulation, a hill climber and a genetic algorithm on the stiffness, and a genetic algorithm on stiffness and
shape. Each experiment names the preset (`fin_sim.presets`) whose fin and fish swim: those of 2012, which give the
published curves. The later paper's fin of three segments of 4 cm swims once, to show that it cannot have been meant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_optimizer.search.cma_es import CmaEs
from fin_optimizer.search.genetic import Generation, GeneticAlgorithm
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.space import Dimension, Evaluation, Space
from fin_plant import checks
from fin_plant.fin import scaled_to_area
from fin_plant.gait import PAPER_GAIT
from fin_sim.batch import swim_batch
from fin_sim.paper_models import speeds_from_thrust
from fin_sim.presets import Preset, preset
from fin_sim.water_settings import PRESETS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.genetic import PopulationSearch

MODEL, SIMULATION, STATED = "clark2012_model", "clark2012_simulation", "raja_mohamed"
"""Presets: what gives the curves of figures 4 and 5, and the fin that the later paper states."""
MODULUS, LENGTH = "fin.young_modulus", "fin.length"
DURATION = 10.0
"""Length of a swim in s (both papers)."""
STEP_DEVIATION = math.sqrt(0.1)
"""Of a mutation in GPa, and in cm for the length, whose variance neither paper states: 0.1 in the paper's units."""
SHAPE_MODULUS = (0.5e9, 10e9)
"""Range of E for the shape experiment, Pa: neither paper states it; 7.55 GPa, what evolved, must lie well inside."""
SHAPE_LENGTH = (0.04, 0.14)
MODEL_BEATS, MODEL_SETTLE_BEATS = 20, 12
"""Beats that the held fin of the mathematical model swims, and of them those that it needs to become periodic."""
_COLUMNS = ("generation", "candidate", "young_modulus", "length", "height", "speed")


@dataclass(frozen=True)
class Campaign:
    """How large the experiments are; the default is the mission's paper.

    Attributes:
        seed: Of all random numbers.
        hill_climber_runs: Number of runs of the hill climber.
        hill_climber_candidates: Fins that each of them tries.
        genetic_runs: Number of runs of each genetic algorithm.
        population: Individuals of a generation.
        generations: Generations of a run.
        crossover: One-point crossover in the shape experiment (2012).
        modulus: Range of E for the experiments on E alone, Pa.
        landscape: Points over E; the landscape of the shape has as many for E and for length.
        water: Preset of the water that all fish swim in (`fin_sim.water_settings`); ``strip`` is the fish's own.

    Raises:
        ValueError: A number that cannot be, or a range upside down.
    """

    seed: int = 2012
    hill_climber_runs: int = 100
    hill_climber_candidates: int = 100
    genetic_runs: int = 30
    population: int = 100
    generations: int = 100
    crossover: bool = False
    modulus: tuple[float, float] = (0.5e9, 4e9)
    landscape: int = 100
    water: str = "strip"

    def __post_init__(self) -> None:
        checks.choice("water", self.water, PRESETS)
        checks.whole_number("seed", self.seed, 0)
        for name in ("hill_climber_runs", "hill_climber_candidates", "genetic_runs", "generations"):
            checks.whole_number(name, getattr(self, name), 1, advice="an experiment needs at least one")
        checks.whole_number("population", self.population, 2)
        checks.whole_number("landscape", self.landscape, 2)
        self.stiffness()

    @classmethod
    def clark(cls, **sizes: int) -> Campaign:
        """Return the campaign of 2012: population 125, crossover for the shape, E from 0 (here 10 MPa) to 5 GPa."""
        return replace(cls(population=125, crossover=True, modulus=(1e7, 5e9)), **sizes)  # type: ignore[arg-type]

    def stiffness(self) -> Space:
        """Return the space of the experiments on E alone."""
        return Space((Dimension(MODULUS, *self.modulus, "Pa"),))

    def shape(self) -> Space:
        """Return the space of E and length; area and thickness stay, so the height follows."""
        return Space((Dimension(MODULUS, *SHAPE_MODULUS, "Pa"), Dimension(LENGTH, *SHAPE_LENGTH, "m")))


@dataclass(frozen=True)
class Run:
    """One run of an experiment: what it computes depends on nothing else."""

    experiment: str
    number: int
    campaign: Campaign

    @property
    def name(self) -> str:
        """Name of the run's file."""
        return f"{self.experiment}-{self.number:03d}"

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of its table."""
        return _COLUMNS

    @property
    def preset(self) -> Preset:
        """Fin and fish that swim."""
        return in_water(preset(EXPERIMENTS[self.experiment].preset), self.campaign.water)

    @property
    def seed(self) -> int:
        """Seed of the run's search, independent of those of all other runs."""
        key = (sorted(EXPERIMENTS).index(self.experiment), self.number)
        state = np.random.SeedSequence(self.campaign.seed, spawn_key=key).generate_state(1, np.uint64)
        return int(state[0])


def in_water(given: Preset, water: str) -> Preset:
    """Return fin and fish in the water of a preset of `fin_sim.water_settings`.

    Raises:
        ValueError: An unknown name.
    """
    chosen = replace(given.fish.water, **PRESETS[water]._asdict())
    return replace(given, fish=replace(given.fish, water=chosen))


Values = Mapping[str, "NDArray[np.float64]"]
"""Columns of what varies, by parameter: E in Pa and, where it varies, the length in m."""
Table = dict[str, "NDArray[np.float64]"]
"""Columns of candidates: generation, candidate, young_modulus in Pa, length and height in m, speed in m/s."""


def shaped(values: Values, given: Preset) -> dict[str, NDArray[np.float64]]:
    """Return the columns of fins of the preset's area with these stiffnesses and lengths."""
    fin = given.fin
    length = np.asarray(values.get(LENGTH, np.full(values[MODULUS].shape, fin.length)))
    fins = scaled_to_area({**fin.as_parameters(), LENGTH: length}, fin.area)
    heights = {name: fins[f"fin.{name}"] for name in ("height", "tip_height")}
    return {"young_modulus": values[MODULUS], "length": length, **heights}


def _columns(values: Values, given: Preset) -> dict[str, Any]:
    """Return the columns of a batch: all that the values do not say is the preset's fin's."""
    return {**vars(given.fin), **shaped(values, given)}


def speeds(values: Values, given: Preset) -> NDArray[np.float64]:
    """Return the mean speed over a swim from rest in m/s, shape (n,); NaN where there is none."""
    fins = _columns(values, given)
    return swim_batch(fins, given.fish, PAPER_GAIT, DURATION, reactive=given.reactive, threads=1).mean_speed


def model_speeds(values: Values, given: Preset) -> NDArray[np.float64]:
    """Return the speed of the papers' mathematical model in m/s, U = sqrt(2 T / (rho S C_D)).

    The body is held, the fin has no mass, and the thrust T is its mean over whole beats.
    """
    beat = 1.0 / PAPER_GAIT.joints[0].frequency
    held = swim_batch(
        {**_columns(values, given), "density": np.zeros(1)},
        given.fish,
        PAPER_GAIT,
        MODEL_BEATS * beat,
        settle=MODEL_SETTLE_BEATS * beat,
        reactive=given.reactive,
        clamp="fixed",
        threads=1,
    )
    return speeds_from_thrust(held.thrust, given.fish.body.drag_area, given.fish.water.density)


def _table(run: Run, values: Sequence[Values], scores: Sequence[NDArray[np.float64]]) -> Table:
    fins = [shaped(part, run.preset) for part in values]
    columns = {
        "generation": [np.full(len(part), index, dtype=float) for index, part in enumerate(scores)],
        "candidate": [np.arange(len(part), dtype=float) for part in scores],
        "speed": list(scores),
    }
    columns |= {name: [part[name] for part in fins] for name in ("young_modulus", "length", "height")}
    return {name: np.concatenate(columns[name]) for name in _COLUMNS}


def _over_stiffness(run: Run, speed: Callable[[Values, Preset], NDArray[np.float64]]) -> Table:
    low, high = 0.2e9, 5e9  # the figures' axis
    values = {MODULUS: np.linspace(low, high, run.campaign.landscape)}
    return _table(run, [values], [speed(values, run.preset)])


def _model(run: Run) -> Table:
    return _over_stiffness(run, model_speeds)


def _simulation(run: Run) -> Table:
    return _over_stiffness(run, speeds)


def _landscape(run: Run) -> Table:
    count = run.campaign.landscape
    modulus, length = np.meshgrid(np.linspace(*SHAPE_MODULUS, count), np.linspace(*SHAPE_LENGTH, count))
    values = {MODULUS: modulus.ravel(), LENGTH: length.ravel()}
    return _table(run, [values], [speeds(values, run.preset)])


def _hill_climbers(runs: Sequence[Run]) -> list[Table]:
    """Climb several hills in step, so that their fins swim side by side; each climbs as it would alone."""
    steps = {MODULUS: STEP_DEVIATION * 1e9}
    searches = [HillClimber(run.campaign.stiffness(), run.seed, steps) for run in runs]
    histories: list[list[Evaluation]] = [[] for _ in runs]
    for _ in range(runs[0].campaign.hill_climber_candidates):
        tried = [search.propose(history) for search, history in zip(searches, histories, strict=True)]
        swum = speeds({MODULUS: np.array([values[MODULUS] for values in tried])}, runs[0].preset)
        for history, values, speed in zip(histories, tried, swum.tolist(), strict=True):
            history.append(Evaluation(values, None if math.isnan(speed) else speed))
    tables = []
    for run, history in zip(runs, histories, strict=True):
        scores = [np.array([math.nan if one.score is None else one.score]) for one in history]
        tables.append(_table(run, [{MODULUS: np.array([one.values[MODULUS]])} for one in history], scores))
    return tables


def evolve(search: PopulationSearch, generations: int, given: Preset) -> list[Generation]:
    """Return the generations of a search on the speed."""
    history: list[Generation] = []
    for _ in range(generations):
        values = search.propose(history)
        history.append(Generation(values, speeds(dict(zip(search.space.names, values.T, strict=True)), given)))
    return history


def _evolved(run: Run, search: PopulationSearch) -> Table:
    history = evolve(search, run.campaign.generations, run.preset)
    values = [dict(zip(search.space.names, generation.values.T, strict=True)) for generation in history]
    return _table(run, values, [generation.scores for generation in history])


def _genetic(run: Run) -> Table:
    campaign = run.campaign
    mutation = {MODULUS: STEP_DEVIATION * 1e9}
    return _evolved(run, GeneticAlgorithm(campaign.stiffness(), run.seed, mutation, campaign.population))


def _shape(run: Run) -> Table:
    campaign = run.campaign
    mutation = {MODULUS: STEP_DEVIATION * 1e9, LENGTH: STEP_DEVIATION * 1e-2}
    search = GeneticAlgorithm(campaign.shape(), run.seed, mutation, campaign.population, crossover=campaign.crossover)
    return _evolved(run, search)


def _cma(run: Run) -> Table:
    return _evolved(run, CmaEs(run.campaign.shape(), run.seed))


@dataclass(frozen=True)
class Experiment:
    """One of the paper's experiments.

    Attributes:
        title: What it is.
        runs: Number of its runs in a campaign.
        swims: Number of swims of a run in a campaign; about, for CMA-ES.
        perform: Carries out a group of its runs.
        together: Runs that are carried out as a group.
        preset: Whose fin and fish swim.
    """

    title: str
    runs: Callable[[Campaign], int]
    swims: Callable[[Campaign], int]
    perform: Callable[[Sequence[Run]], list[Table]]
    together: int = 1
    preset: str = SIMULATION


def _each(perform: Callable[[Run], Table]) -> Callable[[Sequence[Run]], list[Table]]:
    return lambda runs: [perform(run) for run in runs]


def _once(_: Campaign) -> int:
    return 1


EXPERIMENTS = {
    "model": Experiment(
        "speed of the mathematical model over E",
        _once,
        lambda campaign: campaign.landscape,
        _each(_model),
        preset=MODEL,
    ),
    "simulation": Experiment(
        "speed of the simulation over E", _once, lambda campaign: campaign.landscape, _each(_simulation)
    ),
    "stated_fin": Experiment(
        "the simulation with the fin that the later paper states",
        _once,
        lambda campaign: campaign.landscape,
        _each(_simulation),
        preset=STATED,
    ),
    "hill_climber": Experiment(
        "hill climber on E",
        lambda campaign: campaign.hill_climber_runs,
        lambda campaign: campaign.hill_climber_candidates,
        _hill_climbers,
        together=25,
    ),
    "genetic": Experiment(
        "genetic algorithm on E",
        lambda campaign: campaign.genetic_runs,
        lambda campaign: campaign.population * campaign.generations,
        _each(_genetic),
    ),
    "shape": Experiment(
        "genetic algorithm on E and shape",
        lambda campaign: campaign.genetic_runs,
        lambda campaign: campaign.population * campaign.generations,
        _each(_shape),
    ),
    "landscape": Experiment(
        "speed over E and length", _once, lambda campaign: campaign.landscape**2, _each(_landscape)
    ),
    "cma": Experiment(
        "CMA-ES on E and shape, the yardstick",
        lambda campaign: campaign.genetic_runs,
        lambda campaign: 6 * campaign.generations,
        _each(_cma),
    ),
}


def planned_runs(campaign: Campaign, names: Sequence[str] = ()) -> list[Run]:
    """Return the runs of the experiments named, of all where none is.

    Raises:
        ValueError: An unknown name.
    """
    chosen = [checks.choice("experiment", name, EXPERIMENTS) for name in names] or list(EXPERIMENTS)
    return [
        Run(name, number, campaign)
        for name in dict.fromkeys(chosen)
        for number in range(EXPERIMENTS[name].runs(campaign))
    ]


def groups(runs: Sequence[Run]) -> list[list[Run]]:
    """Return the runs as the groups in which they are carried out; grouping changes no result."""
    result: list[list[Run]] = []
    for run in runs:
        last = result[-1] if result else []
        if last and last[0].experiment == run.experiment and len(last) < EXPERIMENTS[run.experiment].together:
            last.append(run)
        else:
            result.append([run])
    return result


def perform(runs: Sequence[Run]) -> list[Table]:
    """Carry out a group of runs of one experiment."""
    return EXPERIMENTS[runs[0].experiment].perform(runs)
