"""Orders of convergence: of the integration in its step, of the chain in its number of segments."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fin_plant.figures import new_figure, own_style
from fin_plant.fin import Fin
from fin_sim import closed_forms
from fin_sim.batch import swim_batch
from fin_sim.chain import fin_links
from fin_sim.picture import BODY_COLOUR, FIN_COLOUR, TAIL_COLOUR
from fin_sim.presets import preset
from fin_sim.swim import STEP, swim
from fin_sim.validation.page import Check, Section

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

FIGURE = "validation_convergence.png"
# Powers of two of the sample time, so that every step divides it and the ramp's end falls on a step.
STEPS = np.array([0.0625 / 2.0**power for power in range(2, 8)])
_FINEST = 0.0625 / 2.0**10
FEW = preset("three_segments").fin
"""Of few segments, so that no hinge is stiff: there the integration shows its order. With stiff ones it has less."""
SEGMENTS = (3, 4, 5, 6, 8, 10, 14, 20)
_SOFT, _STIFF = 0.8e9, 4e9
"""E of fins, Pa, that swim half as fast as the best, and the stiffest that a study looks at by default."""
ALLOWED_CHANGE = 0.01
"""By how much of the speed segments, step and lanes may change a default swim."""


def step_errors(fin: Fin) -> NDArray[np.float64]:
    """Return the relative errors of the distance swum in 5 s by a fin with the steps `STEPS`, shape (6,)."""

    def distance(step: float) -> float:
        return float(swim(fin, duration=5.0, step=step, sample_time=0.0625).x[-1])

    finest = distance(_FINEST)
    return np.array([abs(distance(step) / finest - 1.0) for step in STEPS])


def order(sizes: NDArray[np.float64], errors: NDArray[np.float64]) -> float:
    """Return the slope of the errors over the sizes in logarithmic scales."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def static_deflection(fin: Fin) -> float:
    """Return the tip deflection of a fin under a small force across its tip over that of the beam, F L^3 / (3 E I)."""
    links, _ = fin_links(fin)
    lengths = np.array([link.length for link in links])
    position = np.cumsum(lengths) - lengths
    arms = fin.length - position[1:]
    stiffness = np.array([link.stiffness for link in links[1:]])
    beam = fin.length**3 / (3.0 * fin.young_modulus * fin.height * fin.thickness**3 / 12.0)
    return float(np.sum(arms**2 / stiffness) / beam)


def swim_speeds(segments: tuple[int, ...] = SEGMENTS, **attributes: Any) -> NDArray[np.float64]:
    """Return the mean speeds in m/s over 10 s of the default fin, for each number of segments.

    Args:
        segments: The numbers.
        attributes: Other values of the fin.
    """
    return np.array([swim(Fin(**{**attributes, "segments": n}), step=2e-3).mean_speed for n in segments])


def default_swim_changes() -> dict[str, float]:
    """Return by how much of the mean speed a default swim changes in finer segments, at a finer step and in a batch."""
    fin = Fin()
    speed = swim(fin).mean_speed
    others = {
        f"{fin.segments} to {2 * fin.segments} segments": swim(replace(fin, segments=2 * fin.segments)).mean_speed,
        "the step halved": swim(fin, step=0.5 * STEP).mean_speed,
        "in a batch": float(swim_batch([fin]).mean_speed[0]),
    }
    return {name: other / speed - 1.0 for name, other in others.items()}


def extrapolated(segments: tuple[int, ...], speeds: NDArray[np.float64]) -> float:
    """Return the speed for infinitely many segments from the two finest, for an error like 1/N^2 (Richardson)."""
    fine, coarse = segments[-1] ** 2, segments[-2] ** 2
    return float((fine * speeds[-1] - coarse * speeds[-2]) / (fine - coarse))


@dataclass(frozen=True)
class SegmentErrors:
    """How the default fin depends on its number of segments.

    Attributes:
        static: Relative errors of the static tip deflection, hinges `midpoint`, shape (S,).
        speeds: Mean speeds over 10 s in m/s with hinges `midpoint`, shape (S,).
        between: The same with the papers' hinges `between` the segments.
        soft: As `speeds`, of a fin of 0.8 GPa.
        stiff: As `speeds`, of a fin of 4 GPa.
    """

    static: NDArray[np.float64]
    speeds: NDArray[np.float64]
    between: NDArray[np.float64]
    soft: NDArray[np.float64]
    stiff: NDArray[np.float64]

    @property
    def static_order(self) -> float:
        """Order of the static tip deflection in the number of segments."""
        return -order(np.array(SEGMENTS, dtype=float), self.static)

    @property
    def limit(self) -> float:
        """Speed in m/s for infinitely many segments."""
        return extrapolated(SEGMENTS, self.speeds)

    @property
    def swimming(self) -> NDArray[np.float64]:
        """Relative errors of the speed, shape (S - 2,): the limit comes from the last two."""
        return np.abs(self.speeds / self.limit - 1.0)[:-2]

    @property
    def swimming_order(self) -> float:
        """Order of the speed in the number of segments."""
        return -order(np.array(SEGMENTS[:-2], dtype=float), self.swimming)


def segment_errors() -> SegmentErrors:
    """Return the errors of the numbers of segments `SEGMENTS`."""
    deflections = np.array([static_deflection(Fin(segments=n, hinges="midpoint")) for n in SEGMENTS])
    return SegmentErrors(
        static=1.0 - deflections,
        speeds=swim_speeds(),
        between=swim_speeds(hinges="between"),
        soft=swim_speeds(young_modulus=_SOFT),
        stiff=swim_speeds(young_modulus=_STIFF),
    )


def section(figures: Path) -> Section:
    """Return the part on convergence and draw its picture."""
    steps, segments = (step_errors(FEW), step_errors(Fin())), segment_errors()
    _draw(figures / FIGURE, *steps, segments)
    curves = (segments.speeds, segments.soft, segments.stiff)
    misses = [curve / extrapolated(SEGMENTS, curve) - 1.0 for curve in curves]
    columns = zip(SEGMENTS, segments.speeds, *misses, segments.between, strict=True)
    rows = [
        f"| {n} | {100.0 * speed:.3f} | {own:+.2%} | {soft:+.2%} | {stiff:+.2%} | {100.0 * between:.3f} |"
        for n, speed, own, soft, stiff, between in columns
    ]
    text = f"""
Mean speed of the default fin ({1e-9 * Fin().young_modulus:g} GPa) over 10 s by the number of segments, and how far it
is from the limit, also of a fin of {1e-9 * _SOFT:g} GPa, half as fast as the best, and one of {1e-9 * _STIFF:g} GPa.
`midpoint` tends to {100.0 * segments.limit:.3f} cm/s with order 2. {Fin().segments} segments are the least with which
all three are within 1 %, hence the default. The papers' hinges `between` the segments stand for a stiffer root, since
their first segment is rigid: with three of them they are another fin than the sheet, and tend to it with order 1 only.

| N | `midpoint`, cm/s | off | off at 0.8 GPa | off at 4 GPa | `between`, cm/s |
|---|---|---|---|---|---|
{chr(10).join(rows)}
"""
    caption = "Error over the time step and over the number of segments."
    return Section("Convergence", _checks(*steps, segments), text, FIGURE, caption)


def _checks(few: NDArray[np.float64], steps: NDArray[np.float64], segments: SegmentErrors) -> list[Check]:
    steps_order, swim_order = order(STEPS, few), segments.swimming_order
    at_default = float(np.interp(STEP, STEPS[::-1], steps[::-1]))
    static_miss = max(
        abs(static_deflection(Fin(segments=n, hinges="midpoint")) - closed_forms.midpoint_deflection(n))
        for n in (3, 5, 10)
    )
    return [
        Check(
            "order of the integration, less 4",
            steps_order - 4.0,
            0.3,
            f"{steps_order:.2f}, three segments, steps 0.5 to 16 ms",
        ),
        Check("error of the distance at the default step of 1 ms", at_default, 1e-6),
        Check("order of `midpoint` in N, static tip deflection, less 2", segments.static_order - 2.0, 0.02),
        Check("static tip deflection at N = 3, 5, 10 against 1 - 1/(4 N^2)", static_miss, 1e-12, "0.972, 0.990, 0.998"),
        Check(
            "order of `midpoint` in N, swimming speed, less 2", swim_order - 2.0, 0.3, f"{swim_order:.2f}, N 3 to 10"
        ),
        *(
            Check(f"mean speed of a default swim, {name}: change", change, ALLOWED_CHANGE)
            for name, change in default_swim_changes().items()
        ),
    ]


@own_style()
def _draw(path: Path, few: NDArray[np.float64], steps: NDArray[np.float64], segments: SegmentErrors) -> None:
    figure, axes = new_figure(11.0, 4.2, 1, 2)
    left, right = axes.flat
    for errors, style, colour, name in (
        (few, "o-", BODY_COLOUR, "three segments"),
        (steps, "s-", FIN_COLOUR, "default fin"),
    ):
        left.loglog(1e3 * STEPS, errors, style, color=colour, label=f"{name}, order {order(STEPS, errors):.2f}")
    left.loglog(1e3 * STEPS, few[2] * (STEPS / STEPS[2]) ** 4, "--", color=TAIL_COLOUR, label="order 4")
    left.set(xlabel="time step, ms", ylabel="relative error of the distance swum", title="Integration")
    counts, static = np.array(SEGMENTS, dtype=float), segments.static
    for over, errors, style, colour, label in (
        (counts, static, "o-", FIN_COLOUR, f"static tip deflection, order {segments.static_order:.2f}"),
        (counts[:-2], segments.swimming, "s-", BODY_COLOUR, f"swimming speed, order {segments.swimming_order:.2f}"),
        (counts, static[0] * (counts / counts[0]) ** -2.0, "--", TAIL_COLOUR, "order 2"),
    ):
        right.loglog(over, errors, style, color=colour, label=label)
    right.set(xlabel="segments N", ylabel="relative error", title="Chain of hinges at the segments' middles")
    right.set_xticks(counts, [f"{count:g}" for count in counts], minor=False)
    right.minorticks_off()
    for panel in (left, right):
        panel.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=120)
