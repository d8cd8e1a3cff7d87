"""What a study is to do, from the optimiser's parameters: where to search, what to swim, when to give up."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from typing import TYPE_CHECKING, Any, Self, TypeVar

from fin_optimizer.gait_parameters import beat_of, gait_from_parameters
from fin_optimizer.goals import MEAN_SPEED, Goals
from fin_optimizer.parameters import NAMESPACE_PATTERN, OPTIMIZER_PARAMETERS
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.search.algorithms import FOR_FINS, Swimming, search
from fin_optimizer.search.rules import gait_of
from fin_optimizer.search.space import Choice, Dimension, Space
from fin_optimizer.search.space_file import SPACE_FILE, read_space
from fin_optimizer.study.file_names import SETTINGS_FILE
from fin_optimizer.study.folder import read_settings
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.ledger import Study
from fin_optimizer.study.settings import CONSTRAINTS, Policy, Settings, begun_by_default, sent_parameters
from fin_optimizer.trial.phases import Timeouts
from fin_optimizer.words import MODULUS
from fin_plant.fin import AREA, Fin
from fin_plant.paths import given_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.search.space import Search
    from fin_optimizer.search.space_file import SpaceFile
    from fin_plant.gait import Gait
    from fin_plant.parameters import Value

FISH_FILE = "fish.yaml"
"""In a study's folder: its copy of the fish that a cloud is drawn around."""
_LENGTH = "fin.length"
_SHORT_FORM = tuple(
    name for name in OPTIMIZER_PARAMETERS if name.startswith(("search.young_modulus.", "search.length."))
)
"""Parameters that say what is searched where no file does."""
_STEP_SHARE = 0.1
"""Standard deviation of a step over the range of a parameter, as the paper's of Young's modulus: 0.32 GPa in 3.5."""
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
        gait: What every fish swims; where it is searched, one as wide and as fast as any that may be.
        measurement: Which part of a swim is scored.
        timeouts: When a trial is given up.
        stop_regret: Expected regret, a share of the best speed, below which a search that knows it ends.
        settings: What must not change while the study goes on.
        files: What a space was read from, by the names of the study's copies.
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
    stop_regret: float
    settings: Settings
    files: Mapping[str, bytes]

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> Self:
        """Return the plan that all of the optimiser's parameters make, each as its table has checked it.

        Raises:
            ValueError: A range that is upside down, a fin that cannot be, or a search that does not fit.
        """
        values = {**values, **_of_its_time(values)}
        goals = Goals.of_objective(values["objective"], values["constraints"])
        fin = Fin.from_parameters(values)
        gait = gait_from_parameters(values)
        given = _space_file(values, len(gait.joints))
        if given is None:
            varied = _varied(values)
            space = Space(tuple(Dimension(name, v.minimum, v.maximum, unit=_unit(name)) for name, v in varied.items()))
            deviations = {name: v.step_deviation for name, v in varied.items()}
            settings = _settings(values, space, goals, fin)
        else:
            space, gait = given.space, _widest_gait(given)
            deviations = {d.name: max(_STEP_SHARE * (d.high - d.low), d.step) for d in space.ranges}
            settings = _settings_of_file(values, given, goals)
        measurement = _built(Measurement, values, "measurement.", block=beat_of(gait))
        _check_goals(goals, measurement)
        if not gait.moves:
            msg = "the gait moves no joint: give gait.amplitude, gait.joints.amplitude or a bias, in rad"
            raise ValueError(msg)

        fish = _fish_file(values)
        known = None if fish is None else _around(fish)
        of_speed = [measure.name for measure in goals.measures] == [MEAN_SPEED]

        def swum(candidate: Mapping[str, Any]) -> tuple[Fin, Gait]:
            own = Fin.from_parameters({**fin.as_parameters(), **settings.fin_of(candidate)})
            return own, gait if settings.rules is None else gait_of(settings.sent(candidate))

        return cls(
            **{name: values[name] for name in _AS_GIVEN},
            minimum_free=values["disk.minimum_free"],
            plants=_plants(values["plants"]),
            search=search(
                values["search.algorithm"],
                space,
                values["seed"],
                deviations,
                values["search.population"],
                objectives=len(goals.measures),
                constraints=len(goals.constraints),
                swimming=Swimming(swum, measurement.settle, measurement.duration, known) if of_speed else None,
            ),
            fin=fin,
            gait=gait,
            measurement=measurement,
            timeouts=_built(Timeouts, values, "timeout."),
            stop_regret=values["search.stop_regret"],
            settings=settings,
            files={
                **({} if given is None else given.files),
                **({} if fish is None else {FISH_FILE: fish.read_bytes()}),
            },
        )

    @classmethod
    def of_study(cls, folder: Path) -> Self:
        """Return the plan with which the study in a folder is gone on.

        Raises:
            ValueError: Its settings cannot be read, or are not those that this version makes of them.
        """
        settings = read_settings(folder)
        given = {name: value for name, value in settings.flat().items() if name in OPTIMIZER_PARAMETERS}
        plan = cls.from_parameters(OPTIMIZER_PARAMETERS.checked({**given, "study_folder": str(folder)}))
        if differs := settings.differences(plan.settings):
            msg = f"{folder} was begun by a version with other settings: {'; '.join(differs)}"
            raise ValueError(msg)
        return plan

    def gait_of(self, values: Mapping[str, Any]) -> Gait:
        """Return the gait of a candidate."""
        return self.gait if self.settings.rules is None else gait_of(self.settings.sent(values))

    def measurement_of(self, gait: Gait) -> Measurement:
        """Return which part of the swim with a gait is scored: its speed is judged beat by beat."""
        return replace(self.measurement, block=beat_of(gait))

    def fin_of(self, values: Mapping[str, Any]) -> dict[str, Value]:
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
            study = Study.create(folder, self.settings)
            for file, content in self.files.items():
                (folder / file).write_bytes(content)
        except OSError as error:
            msg = f"study_folder {folder} cannot be used: {error.strerror or error}; choose one that can be written"
            raise ValueError(msg) from error
        return study


def _check_goals(goals: Goals, measurement: Measurement) -> None:
    """Refuse a constraint that no swim with a score meets.

    Raises:
        ValueError: There is one.
    """
    for each in goals.constraints:
        speed = each.measure.name in {"mean_speed", "steady_speed"}
        if speed and each.at_least and each.limit > measurement.largest_speed:
            msg = (
                f"constraint {each.text!r}: no swim has a score beyond measurement.largest_speed = "
                f"{measurement.largest_speed:g} m/s; is it {each.measure.example} that was meant?"
            )
            raise ValueError(msg)


def _of_its_time(values: Mapping[str, Any]) -> dict[str, Value]:
    """Return the settings that a study was begun with by default, where nothing but today's default is asked for."""
    if not values["study_folder"]:
        return {}
    try:
        there = begun_by_default(read_settings(given_path(values["study_folder"])).details)
    except (OSError, StudyError):
        return {}  # there is none yet, or `study` says what is wrong with it
    return {name: value for name, value in there.items() if values[name] == OPTIMIZER_PARAMETERS[name].default}


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


def _space_file(values: Mapping[str, Any], joints: int) -> SpaceFile | None:
    """Return what the search space's file says, of a study that is gone on with its copy's; None without one.

    Raises:
        ValueError: It is refused, or the short form is given beside it.
    """
    path = given_path(values["space"]) if values["space"] else None
    if path is None and values["study_folder"]:
        folder = given_path(values["study_folder"])
        path = folder / SPACE_FILE if (folder / SETTINGS_FILE).exists() and (folder / SPACE_FILE).exists() else None
    if path is None:
        return None
    if beside := [name for name in _SHORT_FORM if values[name] != OPTIMIZER_PARAMETERS[name].default]:
        msg = f"{beside[0]} says what is searched, and so does {path}: put it into the file, or leave the file out"
        raise ValueError(msg)
    return read_space(path, sent_parameters(values), joints)


def _fish_file(values: Mapping[str, Any]) -> Path | None:
    """Return the file of the fish that a cloud is drawn around, of a study that is gone on with its copy; None of none.

    Raises:
        ValueError: It is there for another search, or cannot be read.
    """
    path = given_path(values["search.fish"]) if values["search.fish"] else None
    if path is not None and values["search.algorithm"] not in FOR_FINS:
        msg = f"search.fish = {path} is for search.algorithm = cloud, not {values['search.algorithm']}"
        raise ValueError(msg)
    if values["study_folder"]:
        folder = given_path(values["study_folder"])
        if (folder / SETTINGS_FILE).exists():
            path = folder / FISH_FILE if (folder / FISH_FILE).exists() else None
    return path


def _around(path: Path) -> Mapping[str, Any]:
    from fin_optimizer.calibration.cloud_prior import around  # noqa: PLC0415  (a second, for who gives a fish)

    try:
        return around(path)
    except ValueError as error:  # which names the file
        msg = f"search.fish = {error}"
        raise ValueError(msg) from error


def _widest_gait(given: SpaceFile) -> Gait:
    """Return a gait of which every number is the largest that a candidate may have, either way."""
    searched = {
        d.name: max(d.choices if isinstance(d, Choice) else (d.minimum, d.last), key=abs)  # type: ignore[arg-type]
        for d in given.space.dimensions
        if d.name.startswith("gait.")
    }
    return gait_of({**given.start, **searched})


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


def _settings_of_file(values: Mapping[str, Any], given: SpaceFile, goals: Goals) -> Settings:
    """Return the settings of a study whose space is a file's."""
    policy = _built(Policy, values, "")
    elsewhere = {*asdict(policy), "objective", CONSTRAINTS, *_SHORT_FORM, *sent_parameters(values)}
    deciding = OPTIMIZER_PARAMETERS.deciding_swims.keys() - elsewhere
    details: dict[str, object] = {name: value for name, value in values.items() if name in deciding}
    return Settings(Space(given.space.dimensions), policy, details | dict(given.start), goals, given.rules)


def _settings(values: Mapping[str, Any], space: Space, goals: Goals, fin: Fin) -> Settings:
    policy = _built(Policy, values, "")
    elsewhere = {*asdict(policy), "objective", CONSTRAINTS, *space.names}
    deciding = OPTIMIZER_PARAMETERS.deciding_swims.keys() - elsewhere
    details: dict[str, object] = {name: value for name, value in values.items() if name in deciding}
    if _LENGTH in space.names:
        details[AREA] = fin.area
    return Settings(space, policy, details, goals)
