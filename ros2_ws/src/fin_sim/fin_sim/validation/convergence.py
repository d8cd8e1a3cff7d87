"""Orders of convergence: of the integration in its step, of the chain in its number of segments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.figures import new_figure, own_style
from fin_plant.fin import Fin
from fin_sim import closed_forms
from fin_sim.chain import fin_links
from fin_sim.picture import BODY_COLOUR, FIN_COLOUR, TAIL_COLOUR
from fin_sim.swim import swim
from fin_sim.validation.page import Check, Section

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

FIGURE = "validation_convergence.png"
# Powers of two of the sample time, so that every step divides it and the ramp's end falls on a step.
STEPS = np.array([0.0625 / 2.0**power for power in range(2, 8)])
_FINEST = 0.0625 / 2.0**10
SEGMENTS = (3, 4, 5, 6, 8, 10, 14, 20)


def step_errors(reactive: str = "distributed") -> NDArray[np.float64]:
    """Return the relative errors of the distance swum in 5 s by the paper fin with the steps `STEPS`, shape (6,)."""

    def distance(step: float) -> float:
        return float(swim(Fin(), duration=5.0, step=step, sample_time=0.0625, reactive=reactive).x[-1])  # type: ignore[arg-type]

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


def swim_speeds(segments: tuple[int, ...] = SEGMENTS) -> NDArray[np.float64]:
    """Return the mean speeds in m/s over 10 s of the paper fin, hinges `midpoint`, for each number of segments."""
    return np.array([swim(Fin(segments=count, hinges="midpoint"), step=2e-3).mean_speed for count in segments])


def extrapolated(segments: tuple[int, ...], speeds: NDArray[np.float64]) -> float:
    """Return the speed for infinitely many segments from the two finest, for an error like 1/N^2 (Richardson)."""
    fine, coarse = segments[-1] ** 2, segments[-2] ** 2
    return float((fine * speeds[-1] - coarse * speeds[-2]) / (fine - coarse))


@dataclass(frozen=True)
class SegmentErrors:
    """How the paper fin depends on its number of segments.

    Attributes:
        static: Relative errors of the static tip deflection, hinges `midpoint`, shape (S,).
        speeds: Mean speeds over 10 s in m/s with hinges `midpoint`, shape (S,).
        between: The same with the papers' hinges `between` the segments.
    """

    static: NDArray[np.float64]
    speeds: NDArray[np.float64]
    between: NDArray[np.float64]

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
    between = np.array([swim(Fin(segments=n), step=2e-3).mean_speed for n in SEGMENTS])
    return SegmentErrors(1.0 - deflections, swim_speeds(), between)


def section(figures: Path) -> Section:
    """Return the part on convergence and draw its picture."""
    steps, segments = step_errors(), segment_errors()
    _draw(figures / FIGURE, steps, segments)
    columns = zip(SEGMENTS, segments.speeds, segments.between, strict=True)
    rows = [f"| {n} | {100.0 * a:.3f} | {100.0 * b:.3f} |" for n, a, b in columns]
    text = f"""
Mean speed of the paper fin over 10 s by the number of segments. `midpoint` tends to
{100.0 * segments.limit:.3f} cm/s with order 2. The papers' hinges `between` the segments stand for a stiffer root,
since their first segment is rigid: with three of them they are another fin than the sheet, and tend to it with order 1
only.

| N | `midpoint`, cm/s | `between`, cm/s |
|---|---|---|
{chr(10).join(rows)}
"""
    caption = "Error over the time step and over the number of segments."
    return Section("Convergence", _checks(steps, segments), text, FIGURE, caption)


def _checks(steps: NDArray[np.float64], segments: SegmentErrors) -> list[Check]:
    steps_order, swim_order = order(STEPS, steps), segments.swimming_order
    at_default = float(np.interp(1e-3, STEPS[::-1], steps[::-1]))
    static_miss = max(
        abs(static_deflection(Fin(segments=n, hinges="midpoint")) - closed_forms.midpoint_deflection(n))
        for n in (3, 5, 10)
    )
    return [
        Check("order of the integration, less 4", steps_order - 4.0, 0.3, f"{steps_order:.2f}, steps 0.5 to 16 ms"),
        Check("error of the distance at the default step of 1 ms", at_default, 1e-6),
        Check("order of `midpoint` in N, static tip deflection, less 2", segments.static_order - 2.0, 0.02),
        Check("static tip deflection at N = 3, 5, 10 against 1 - 1/(4 N^2)", static_miss, 1e-12, "0.972, 0.990, 0.998"),
        Check(
            "order of `midpoint` in N, swimming speed, less 2", swim_order - 2.0, 0.3, f"{swim_order:.2f}, N 3 to 10"
        ),
    ]


@own_style()
def _draw(path: Path, steps: NDArray[np.float64], segments: SegmentErrors) -> None:
    figure, axes = new_figure(11.0, 4.2, 1, 2)
    left, right = axes.flat
    left.loglog(1e3 * STEPS, steps, "o-", color=BODY_COLOUR, label=f"distance swum, order {order(STEPS, steps):.2f}")
    left.loglog(1e3 * STEPS, steps[2] * (STEPS / STEPS[2]) ** 4, "--", color=TAIL_COLOUR, label="order 4")
    left.set(xlabel="time step, ms", ylabel="relative error", title="Integration")
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
