"""Orders of convergence: of the integration in its step, of the chain in its number of segments."""

from __future__ import annotations

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


@own_style()
def section(figures: Path) -> Section:
    """Return the part on convergence and draw its picture."""
    errors = step_errors()
    steps_order = order(STEPS, errors)
    counts = np.array(SEGMENTS, dtype=float)
    deflections = np.array([static_deflection(Fin(segments=n, hinges="midpoint")) for n in SEGMENTS])
    static_errors = 1.0 - deflections
    static_order = -order(counts, static_errors)
    speeds = swim_speeds()
    limit = extrapolated(SEGMENTS, speeds)
    speed_errors = np.abs(speeds / limit - 1.0)
    swim_order = -order(counts[:-2], speed_errors[:-2])  # the limit comes from the last two
    between = np.array([swim(Fin(segments=n), step=2e-3).mean_speed for n in SEGMENTS])

    figure, axes = new_figure(11.0, 4.2, 1, 2)
    left, right = axes.flat
    left.loglog(1e3 * STEPS, errors, "o-", color=BODY_COLOUR, label=f"distance swum, order {steps_order:.2f}")
    left.loglog(1e3 * STEPS, errors[2] * (STEPS / STEPS[2]) ** 4, "--", color=TAIL_COLOUR, label="order 4")
    left.set(xlabel="time step, ms", ylabel="relative error", title="Integration")
    right.loglog(
        counts, static_errors, "o-", color=FIN_COLOUR, label=f"static tip deflection, order {static_order:.2f}"
    )
    right.loglog(
        counts[:-2], speed_errors[:-2], "s-", color=BODY_COLOUR, label=f"swimming speed, order {swim_order:.2f}"
    )
    right.loglog(counts, static_errors[0] * (counts / counts[0]) ** -2.0, "--", color=TAIL_COLOUR, label="order 2")
    right.set(xlabel="segments N", ylabel="relative error", title="Chain of hinges at the segments' middles")
    right.set_xticks(counts, [f"{count:g}" for count in counts], minor=False)
    right.minorticks_off()
    for panel in (left, right):
        panel.legend(frameon=False, fontsize="small")
    figure.savefig(figures / FIGURE, dpi=120)

    checks = [
        Check("order of the integration, less 4", steps_order - 4.0, 0.3, f"{steps_order:.2f}, steps 0.5 to 16 ms"),
        Check(
            "error of the distance at the default step of 1 ms", float(np.interp(1e-3, STEPS[::-1], errors[::-1])), 1e-6
        ),
        Check("order of `midpoint` in N, static tip deflection, less 2", static_order - 2.0, 0.02),
        Check(
            "static tip deflection at N = 3, 5, 10 against 1 - 1/(4 N^2)",
            max(
                abs(static_deflection(Fin(segments=n, hinges="midpoint")) - closed_forms.midpoint_deflection(n))
                for n in (3, 5, 10)
            ),
            1e-12,
            "0.972, 0.990, 0.998",
        ),
        Check(
            "order of `midpoint` in N, swimming speed, less 2", swim_order - 2.0, 0.3, f"{swim_order:.2f}, N 3 to 10"
        ),
    ]
    rows = [f"| {n} | {100.0 * a:.3f} | {100.0 * b:.3f} |" for n, a, b in zip(SEGMENTS, speeds, between, strict=True)]
    text = f"""
Mean speed of the paper fin over 10 s by the number of segments. `midpoint` tends to {100.0 * limit:.3f} cm/s with
order 2. The papers' hinges `between` the segments stand for a stiffer root, since their first segment is rigid: with
three of them they are another fin than the sheet, and tend to it with order 1 only.

| N | `midpoint`, cm/s | `between`, cm/s |
|---|---|---|
{chr(10).join(rows)}
"""
    return Section("Convergence", checks, text, FIGURE, "Error over the time step and over the number of segments.")
