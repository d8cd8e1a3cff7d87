"""What a study is to do, from the optimiser's parameters: where to search, what to swim, when to give up."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from datetime import datetime
from typing import TYPE_CHECKING, Any, Self, TypeVar

from fin_optimizer.parameters import NAMESPACE_PATTERN, OPTIMIZER_PARAMETERS
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.search.algorithms import search
from fin_optimizer.search.space import Dimension, Space
from fin_optimizer.study.file_names import SETTINGS_FILE
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.settings import Objective, Policy, Settings
from fin_optimizer.trial.phases import Timeouts
from fin_optimizer.words import MODULUS
from fin_plant.fin import AREA, Fin
from fin_plant.gait import Gait, JointDrive, carangiform
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.search.space import Search
    from fin_plant.parameters import Value

_LENGTH = "fin.length"
_Description = TypeVar("_Description")


@dataclass(frozen=True)
class _Varied:
    """How one parameter of the fin is searched: the parameters ``search.<parameter>.<name>``, in its unit."""

    minimum: float
    maximum: float
    step_variance: float

    @property
    def step_deviation(self) -> float:
        """Standard deviation of a step."""
        return math.sqrt(self.step_variance)


@dataclass(frozen=True)
class StudyPlan:
    """What the optimiser's parameters ask for; the attributes without a word here bear the names of theirs.

    Attributes:
        minimum_free: Space in B that must stay free on the study's disk.
        plants: Namespaces of the fish, empty for the node's own one.
        search: Proposes the fins.
        fin: The one that the search starts from.
        gait: What every fish swims.
        measurement: Which part of a swim is scored.
        timeouts: When a trial is given up.
        settings: What must not change while the study goes on.
    """

    trials: int
    seed: int
    failures_in_a_row: int
    autostart: bool
    exit_when_done: bool
    study_folder: str
    minimum_free: float
    plants: tuple[str, ...]
    search: Search
    fin: Fin
    gait: Gait
    measurement: Measurement
    timeouts: Timeouts
    settings: Settings

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return the plan that all of the optimiser's parameters make, each as its table has checked it.

        Raises:
            ValueError: A range that is upside down, a fin that cannot be, or a search that does not fit.
        """
        varied = _varied(values)
        space = Space(tuple(Dimension(name, v.minimum, v.maximum, unit=_unit(name)) for name, v in varied.items()))
        objective = Objective(values["objective"])
        fin = Fin.from_parameters(values)
        gait = _built(JointDrive, values, "gait.")
        return cls(
            **{name: values[name] for name in _AS_GIVEN},
            minimum_free=values["disk.minimum_free"],
            plants=_plants(values["plants"]),
            search=search(
                values["search.algorithm"],
                space,
                values["seed"],
                {name: v.step_deviation for name, v in varied.items()},
                values["search.population"],
                with_cost=objective is Objective.SPEED_AND_COST,
            ),
            fin=fin,
            gait=carangiform(gait.amplitude, gait.frequency),
            measurement=_built(Measurement, values, "measurement.", block=1.0 / gait.frequency),
            timeouts=_built(Timeouts, values, "timeout."),
            settings=_settings(values, space, objective, fin),
        )

    @property
    def no_gait(self) -> Gait:
        """The gait of a tail at rest."""
        return Gait((JointDrive(0.0, self.gait.joints[0].frequency),))

    @property
    def wants_cost(self) -> bool:
        """Whether the energy per metre is an objective."""
        return self.settings.objective is Objective.SPEED_AND_COST

    def fin_of(self, values: Mapping[str, float]) -> dict[str, Value]:
        """Return the fin of a candidate as the plant's parameters; the plant itself judges whether it can be."""
        return self.settings.fin_of(values)

    def study(self) -> Study:
        """Begin the study, or go on with it.

        Raises:
            ValueError: The folder cannot be used, or its study has other settings.
        """
        name = self.study_folder or f"runs/{datetime.now().astimezone():%Y-%m-%d_%H-%M-%S}"
        folder = given_path(name).absolute()
        try:
            if (folder / SETTINGS_FILE).exists():
                return Study.open(folder, self.settings)
            return Study.create(folder, self.settings)
        except OSError as error:
            msg = f"study_folder {folder} cannot be used: {error.strerror or error}; choose one that can be written"
            raise ValueError(msg) from error


_AS_GIVEN = [field.name for field in fields(StudyPlan) if field.name in OPTIMIZER_PARAMETERS and field.name != "plants"]


def _built(kind: type[_Description], values: Mapping[str, Any], prefix: str, **more: Any) -> _Description:
    """Return what the parameters ``prefix`` + the names of its attributes describe.

    Raises:
        ValueError: The values do not fit together.
    """
    named: Any = kind
    given = {f.name: values[prefix + f.name] for f in fields(named) if prefix + f.name in values}
    return kind(**given, **more)


def _unit(name: str) -> str:
    return OPTIMIZER_PARAMETERS[name].unit


def _varied(values: Mapping[str, Any]) -> dict[str, _Varied]:
    """Return how each parameter that is searched is searched, by its name."""
    varied = {name: _built(_Varied, values, f"search.{name.removeprefix('fin.')}.") for name in (MODULUS, _LENGTH)}
    if varied[_LENGTH].minimum == varied[_LENGTH].maximum == 0.0:  # the default: the shape stays
        del varied[_LENGTH]
    return varied


def _plants(names: Sequence[str]) -> tuple[str, ...]:
    for name in names:
        if not NAMESPACE_PATTERN.fullmatch(name):
            msg = f"plants has {name!r}: give namespaces like /tank_a/fish, a slash, then letters, digits and _"
            raise ValueError(msg)
    if len(set(names)) != len(names):
        msg = f"plants names a fish twice: {', '.join(names)}"
        raise ValueError(msg)
    return tuple(names)


def _settings(values: Mapping[str, Any], space: Space, objective: Objective, fin: Fin) -> Settings:
    policy = _built(Policy, values, "")
    elsewhere = {*asdict(policy), "objective", *space.names}
    deciding = OPTIMIZER_PARAMETERS.deciding_swims.keys() - elsewhere
    details: dict[str, object] = {name: value for name, value in values.items() if name in deciding}
    if _LENGTH in space.names:
        details[AREA] = fin.area
    return Settings(space, policy, details, objective)
