"""The pictures of a study, drawn from its settings, trials and fish alone: also later, and while it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from fin_optimizer.gait_parameters import beat_of, describe_gait, gait_from_parameters
from fin_optimizer.score.mean_speed import Measurement
from fin_optimizer.search.space import Choice
from fin_optimizer.study import drawing
from fin_optimizer.study.candidate import candidates, fastest, front
from fin_optimizer.study.file_names import FIGURE_FILE, FRONT_FILE
from fin_optimizer.study.report import varied
from fin_optimizer.study.settings import Objective
from fin_optimizer.study.simulated_curve import can_be_computed, simulated_speed, speed_over_range
from fin_plant.figures import try_to_draw
from fin_plant.fin import AREA, Fin

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from fin_optimizer.study.candidate import Candidate, TrialRecord
    from fin_optimizer.study.settings import Settings
    from fin_optimizer.study.simulated_curve import SpeedCurve

_FREQUENCY, _AMPLITUDE = "gait.frequency", "gait.amplitude"
_SETTLE, _DURATION = "measurement.settle", "measurement.duration"


def draw_study(
    path: Path, settings: Settings, trials: Sequence[TrialRecord], fish: Mapping[str, object]
) -> tuple[list[Path], list[str]]:
    """Draw speed over what was searched, and where the study is about the cost too the Pareto front beside it.

    Args:
        path: Where to write the first picture, in the format that its name ends in.
        settings: Of the study.
        trials: All of them, one at least with a score.
        fish: What swam, as the journal has it; empty if it is not known.

    Returns:
        What was drawn, and why the rest could not be.
    """
    tried = candidates(trials)
    wanted = {path: lambda: _draw_speed(path, settings, trials, fish)}
    if settings.objective is Objective.SPEED_AND_COST:
        beside = path.with_name(FRONT_FILE).with_suffix(path.suffix)
        if path.name != FIGURE_FILE:
            beside = path.with_stem(f"{path.stem}_pareto_front")
        wanted[beside] = lambda: drawing.draw_front(beside, tried, front(tried), title=title(settings, tried))
    failures = {each: try_to_draw(each, draw) for each, draw in wanted.items()}
    return [each for each, why in failures.items() if not why], [why for why in failures.values() if why]


def _draw_speed(path: Path, settings: Settings, trials: Sequence[TrialRecord], fish: Mapping[str, object]) -> None:
    tried = candidates(trials)
    best, heading = fastest(tried), title(settings, tried)
    first, *others = settings.space.dimensions
    if others:
        drawing.draw_map(path, tried, best, (first, others[0]), title=heading)
        return
    simulated = _simulated(settings, fish)
    drawing.draw_speed(path, trials, best, first, simulated=simulated, title=heading)


def _simulated(settings: Settings, fish: Mapping[str, object]) -> SpeedCurve | None:
    """Return the simulator's speed over what was searched, None where the fish that swam cannot be computed."""
    details = cast("Mapping[str, float]", settings.details)
    if not can_be_computed(fish) or not {_FREQUENCY, _AMPLITUDE, _SETTLE, _DURATION} <= details.keys():
        return None
    (dimension,) = settings.space.dimensions
    if isinstance(dimension, Choice) or settings.rules is not None:
        return None
    fin = Fin.from_parameters(settings.fin_of({dimension.name: dimension.minimum}))
    gait = gait_from_parameters(details)
    measurement = Measurement(details[_SETTLE], details[_DURATION], block=beat_of(gait))
    parameters = {name: value for name, value in fish.items() if name != "plant"}
    try:
        speed = simulated_speed(dimension.name, fin, gait, measurement, parameters)  # type: ignore[arg-type]
    except (LookupError, ValueError):  # an older version's simulator, which had other parameters
        return None
    return speed_over_range(dimension, speed)


def title(settings: Settings, tried: Sequence[Candidate]) -> str:
    """Return a picture's heading: the fin as far as it stays, with its profile, and the gait."""
    details = cast("Mapping[str, float]", settings.details)
    lines = [_fin(settings, tried)]
    if {_FREQUENCY, _AMPLITUDE} <= details.keys():
        gait = describe_gait(gait_from_parameters(details))
        lines.append(f"{gait}; swims of {details[_DURATION]:g} s" if _DURATION in details else gait)
    return "\n".join(filter(None, lines))


def _fin(settings: Settings, tried: Sequence[Candidate]) -> str:
    """Return the fin in words, without what was searched; nothing if the settings do not tell it."""
    if tried and settings.rules is not None:
        varies = varied(settings, [candidate.values for candidate in tried])
        shown = Fin.from_parameters(settings.fin_of(tried[0].values)).describe(without=varies)
        return shown if shown != "fin " else ""
    if not tried or "fin.thickness" not in settings.details:
        return ""
    names = settings.space.names
    fin = settings.fin_of(tried[0].values)
    if "fin.length" not in names:
        return Fin.from_parameters(fin).describe(without=names)
    told = [f"{1000.0 * fin['fin.thickness']:.4g} mm thick"]
    area = cast("float", settings.details.get(AREA, 0.0))
    if area:
        told.insert(0, f"of {1e4 * area:.4g} cm²")
        heights = [fin["fin.height"], *fin["fin.profile_height"], fin["fin.tip_height"]]
        shape = [f"{height / heights[0]:.3g}" for height in heights]
        if len(set(shape)) > 1:
            told.append(f"heights from root to tip as {' : '.join(shape)}")
    return f"fin {', '.join(told)}"
