"""What a study is to do, from the optimiser's parameters: where to search, what to swim, when to give up."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime
from typing import TYPE_CHECKING, cast

from fin_optimizer.parameters import NAMESPACE_PATTERN
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.search.hill_climber import HillClimber
from fin_optimizer.search.one_by_one import OneByOne
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.folder import SETTINGS_FILE
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.settings import Objective, Policy, Settings
from fin_optimizer.trial.phases import Timeouts
from fin_optimizer.words import MODULUS
from fin_plant.fin import AREA, Fin
from fin_plant.gait import Gait, JointDrive, carangiform
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_optimizer.search.space import Search
    from fin_plant.parameters import Value

# What decides candidates and scores, hence must not change while a study goes on.
_DECISIVE = ("seed", "search.", "gait.", "measurement.", "fin.")
_LENGTH = "fin.length"


class Plan:
    """What the node's parameters ask for.

    Raises:
        ValueError: A range that is upside down, a fin that cannot be, or a search that does not fit.
    """

    def __init__(self, values: Mapping[str, Value]) -> None:
        self.values = dict(values)
        space, deviations = self._space()
        self.dimension = space.dimensions[0]
        self.objective = Objective(str(values["objective"]))
        self.search = self._search(space, deviations)
        self.fin = Fin.from_parameters(values)
        frequency = self.number("gait.frequency")
        self.gait = carangiform(self.number("gait.amplitude"), frequency)
        self.no_gait = Gait((JointDrive(0.0, frequency),))
        measured = ("settle", "duration", "largest_speed", "largest_start_speed")
        numbers = {name: self.number(f"measurement.{name}") for name in measured}
        self.measurement = Measurement(**numbers, block=1.0 / frequency)
        names = ("find", "plant", "reply", "silence", "rest", "people")
        self.timeouts = Timeouts(**{name: self.number(f"timeout.{name}") for name in names})
        self.plants = self._plants()
        details = {n: v for n, v in values.items() if n.startswith(_DECISIVE) and n not in space.names}
        if _LENGTH in space.names:
            details[AREA] = self.fin.area
        policy = Policy(self.count("repeats"), self.count("attempts"))
        self.settings = Settings(space, policy, details, self.objective)

    @property
    def wants_cost(self) -> bool:
        """Whether the cost of transport is an objective."""
        return self.objective is Objective.SPEED_AND_COST

    def _space(self) -> tuple[Space, dict[str, float]]:
        """Return what is searched, and the standard deviation of a step by parameter."""
        dimensions, deviations = [], {}
        for name in (MODULUS, _LENGTH):
            prefix = f"search.{name.removeprefix('fin.')}"
            unit = "Pa" if name == MODULUS else "m"
            low, high = self.number(f"{prefix}.minimum"), self.number(f"{prefix}.maximum")
            if name == _LENGTH and low == high == 0.0:
                continue  # the default: the shape stays
            dimensions.append(Dimension(name, low, high, unit=unit))
            deviations[name] = math.sqrt(self.number(f"{prefix}.step_variance"))
        return Space(tuple(dimensions)), deviations

    def _search(self, space: Space, deviations: Mapping[str, float]) -> Search:
        name, seed = str(self.values["search.algorithm"]), self.count("seed")
        population = self.count("search.population") or None
        if name == "hill_climber":
            return HillClimber(space, seed, deviations)
        if self.wants_cost:
            msg = f"search.algorithm = {name} knows one objective only: use hill_climber for {self.objective}"
            raise ValueError(msg)
        # Both take longer to load than a study with the hill climber should wait.
        from fin_optimizer.search.cma_es import CmaEs  # noqa: PLC0415
        from fin_optimizer.search.genetic import GeneticAlgorithm  # noqa: PLC0415

        if name == "cma_es":
            return OneByOne(CmaEs(space, seed, population))
        genetic = GeneticAlgorithm(space, seed, deviations)
        return OneByOne(replace(genetic, population=population or genetic.population))

    def _plants(self) -> list[str]:
        """Return the namespaces of the fish, empty for the node's own one."""
        plants = cast("list[str]", self.values["plants"])
        for plant in plants:
            if not NAMESPACE_PATTERN.fullmatch(plant):
                msg = f"plants has {plant!r}: give namespaces like /tank_a/fish, a slash, then letters, digits and _"
                raise ValueError(msg)
        if len(set(plants)) != len(plants):
            msg = f"plants names a fish twice: {', '.join(plants)}"
            raise ValueError(msg)
        return list(plants)

    def number(self, name: str) -> float:
        """Return a parameter of type double."""
        return cast("float", self.values[name])

    def count(self, name: str) -> int:
        """Return a parameter of type integer."""
        return cast("int", self.values[name])

    def fin_of(self, values: Mapping[str, float]) -> dict[str, Value]:
        """Return the fin of a candidate as the plant's parameters; the plant itself judges whether it can be."""
        return self.settings.fin_of(values)

    def study(self) -> Study:
        """Begin the study, or go on with it.

        Raises:
            ValueError: The folder cannot be used, or its study has other settings.
        """
        name = str(self.values["study_folder"]) or f"runs/{datetime.now().astimezone():%Y-%m-%d_%H-%M-%S}"
        folder = given_path(name).absolute()
        try:
            if (folder / SETTINGS_FILE).exists():
                return Study.open(folder, self.settings)
            return Study.create(folder, self.settings)
        except OSError as error:
            msg = f"study_folder {folder} cannot be used: {error.strerror or error}; choose one that can be written"
            raise ValueError(msg) from error
