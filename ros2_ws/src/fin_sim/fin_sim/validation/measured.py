"""Measured swims of a real tail-actuated fish: few numbers identified on a third of them, the others predicted."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from fin_plant.figures import new_figure, own_style
from fin_plant.gait import Gait, JointDrive
from fin_plant.gait_follower import GaitFollower
from fin_sim import dynamics, time_stepping
from fin_sim.chain import Chain
from fin_sim.fish import Body, Link, Water
from fin_sim.picture import BODY_COLOUR, FIN_COLOUR, TAIL_COLOUR
from fin_sim.validation.page import Check, Section

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_sim.water_settings import Model, TipTerm

FIGURE = "validation_measured_swims.png"
TRAINING_AMPLITUDE = 25
"""Degrees. The nine swims of this amplitude are fitted; those of 15 and 30 degrees are predicted."""
LOST_SPEED = -0.02
"""Forward speed in m/s below which the camera had lost the fish, which never swims backwards."""

# Scales of the residuals: about the noise between repeats.
_SPEED_SCALE, _TURN_SCALE = 0.004, 0.012
_STEP, _EVERY = 8e-3, 5
_RAMP = 0.1
_BEAT_RANGE = (0.7, 1.3)
_HULL_AREA = 0.03  # m^2, published for such a fish
# Identified numbers: start and bounds. Start: the values published for such a fish (see `section`).
_START = (math.log(0.029), math.log(0.117), math.log(4.5e-3), 0.0)
_LOW = (math.log(1e-4), math.log(1e-3), math.log(2e-4), -0.5)
_HIGH = (math.log(0.1), math.log(3.0), math.log(0.2), 0.5)
_NAMES = ("S C_D, m^2", "S C_L, m^2/rad", "K_D, N m s^2", "bias offset, degrees")


@dataclass(frozen=True)
class Means:
    """Means over the second half of a swim.

    Attributes:
        speed: Forward, m/s.
        turning_rate: rad/s, positive to the left.
        sideways: Speed to the left, m/s.
    """

    speed: float
    turning_rate: float
    sideways: float


@dataclass(frozen=True)
class Measured:
    """One measured swim.

    Attributes:
        amplitude: degrees.
        bias: degrees.
        frequency: Tail beats, Hz.
        duration: s.
        start_speed: Forward speed at the start of the log, m/s.
        means: Over the second half.
        lost: The camera lost the fish on the way; the means are worth nothing.
    """

    amplitude: int
    bias: int
    frequency: float
    duration: float
    start_speed: float
    means: Means
    lost: bool = False


@dataclass(frozen=True)
class Assumed:
    """What is assumed of the fish that was measured, and not fitted.

    Attributes:
        tail_length: m.
        amplitude_factor: The tail's true amplitude over the commanded one.
        normal_drag: C_N of the tail's resistive force.
        model: Of the water's kinetic energy.
        tip_term: In three dimensions, what leaves at the trailing edge.
    """

    tail_length: float = 0.071
    amplitude_factor: float = 1.0
    normal_drag: float = 1.0
    model: Model = "strip"
    tip_term: TipTerm = "strip"


_ASSUMED = Assumed()
_OTHER_ASSUMPTIONS = {
    "amplitude 1.15 times the commanded": Assumed(amplitude_factor=1.15),
    "tail of 9 cm": Assumed(tail_length=0.09),
    "C_N = 0": Assumed(normal_drag=0.0),
    "C_N = 3": Assumed(normal_drag=3.0),
    "`surface_3d`": Assumed(model="surface_3d"),
    "`surface_3d`, scaled tip term": Assumed(model="surface_3d", tip_term="scaled"),
}


@dataclass(frozen=True)
class Noise:
    """Noise of one swim, from swims repeated.

    Attributes:
        speed: Standard deviation, m/s.
        turning_rate: Standard deviation, rad/s.
        pairs: Number of swims compared with their repeats.
        lost: Number of repeats that lost the fish.
    """

    speed: float
    turning_rate: float
    pairs: int
    lost: int


def _harmonic_fit(
    time: NDArray[np.float64], values: NDArray[np.float64], frequency: float
) -> tuple[NDArray[np.float64], float]:
    """Return mean, slope, cosine and sine of the line and harmonic that fit best, and the sum of squares they leave."""
    angle = 2.0 * math.pi * frequency * time
    terms = np.stack([np.ones_like(time), time, np.cos(angle), np.sin(angle)], axis=1)
    numbers = np.linalg.lstsq(terms, values, rcond=None)[0]
    return numbers, float(np.sum((terms @ numbers - values) ** 2))


def beat_frequency(time: NDArray[np.float64], yaw_rate: NDArray[np.float64]) -> float:
    """Return the tail-beat frequency in Hz, between 0.7 and 1.3: that of the harmonic which fits the yaw rate best.

    Args:
        time: s, shape (S,), at any intervals.
        yaw_rate: rad/s, shape (S,).
    """
    grid = np.linspace(*_BEAT_RANGE, 61)
    best = float(grid[np.argmin([_harmonic_fit(time, yaw_rate, each)[1] for each in grid])])
    near = float(grid[1] - grid[0])
    found = minimize_scalar(
        lambda frequency: _harmonic_fit(time, yaw_rate, frequency)[1],
        bounds=(best - near, best + near),
        method="bounded",
        options={"xatol": 1e-4},
    )
    return float(found.x)


def _means(time: NDArray[np.float64], swum: NDArray[np.float64], frequency: float) -> Means:
    """Return the means over the second half; ``swum`` has forward speed, sideways speed and heading, shape (S, 3)."""
    half = time >= 0.5 * (time[0] + time[-1])
    time, swum = time[half], swum[half]
    forward, sideways = (float(np.trapezoid(swum[:, column], time) / np.ptp(time)) for column in (0, 1))
    turning_rate = _harmonic_fit(time - time[0], np.unwrap(swum[:, 2]), frequency)[0][1]
    return Means(forward, float(turning_rate), sideways)


def read_swims(folder: Path) -> list[Measured]:
    """Return the swims of a folder of ``amplitude<deg>_bias<deg>_<run>.csv`` files.

    Raises:
        ValueError: There is none.
    """
    swims = []
    for path in sorted(folder.glob("amplitude*_bias*_*.csv")):
        named = re.match(r"amplitude(\d+)_bias([+-]\d+)_", path.name)
        if named is None:
            continue
        rows = np.genfromtxt(path, delimiter=",", names=True)
        time, forward = rows["t"] - rows["t"][0], rows["v_forward"]
        frequency = beat_frequency(time, rows["yaw_rate"])
        first = time < 2.0 / frequency
        start = np.polyfit(time[first], forward[first], 1)[1]
        swum = np.stack([forward, rows["v_lateral"], rows["heading"]], axis=1)
        swims.append(
            Measured(
                amplitude=int(named[1]),
                bias=int(named[2]),
                frequency=frequency,
                duration=float(time[-1]),
                start_speed=max(float(start), 0.0),
                means=_means(time, swum, frequency),
                lost=bool(np.min(forward) < LOST_SPEED),
            )
        )
    if not swims:
        msg = f"{folder} has no swims named amplitude<deg>_bias<deg>_<run>.csv"
        raise ValueError(msg)
    return swims


def repeat_noise(swims: list[Measured], repeats: list[Measured]) -> Noise:
    """Return the noise of one swim: the root mean square difference of like swims over the root of 2.

    Raises:
        ValueError: No swim was repeated without losing the fish.
    """
    pairs = [
        (swim.means, repeat.means)
        for swim in swims
        for repeat in repeats
        if (swim.amplitude, swim.bias) == (repeat.amplitude, repeat.bias) and not (swim.lost or repeat.lost)
    ]
    if not pairs:
        msg = "no swim was repeated without losing the fish: the noise can't be told"
        raise ValueError(msg)
    speed = [one.speed - other.speed for one, other in pairs]
    turn = [one.turning_rate - other.turning_rate for one, other in pairs]
    lost = sum(repeat.lost for repeat in repeats)
    return Noise(_root_mean_square(speed) / math.sqrt(2.0), _root_mean_square(turn) / math.sqrt(2.0), len(pairs), lost)


def predict(numbers: NDArray[np.float64], swim: Measured, assumed: Assumed = _ASSUMED) -> Means:
    """Return the computed means over the second half of a swim.

    Args:
        numbers: Logarithms of S C_D, S C_L and K_D, and the bias offset in rad.
        swim: What was commanded, for how long, and the speed at its start.
        assumed: The rest of the fish.
    """
    drag_area, lift_area, yaw_drag = np.exp(numbers[:3])
    body = Body(0.725, 0.217, 0.7888, 2.66e-3, 7.93e-4, drag_area, lift_area, yaw_drag, 0.105)
    water = Water(1000.0, assumed.normal_drag, model=assumed.model, tip_term=assumed.tip_term)
    chain = Chain(body, (Link(assumed.tail_length, 0.04, 0.04),), (True,), water)
    stepper = time_stepping.Stepper(chain, _STEP, _EVERY)
    samples = max(2, round(swim.duration / stepper.sample_time))
    amplitude = assumed.amplitude_factor * math.radians(swim.amplitude)
    bias = math.radians(swim.bias) + float(numbers[3])
    follower = GaitFollower(1, _RAMP, as_asked=True)
    follower.command(Gait((JointDrive(amplitude, swim.frequency, bias=bias),)), 0.0)
    state = stepper.start()
    state[dynamics.SURGE] = swim.start_speed
    states, _ = stepper.advance(state, follower.motion(stepper.half_step_times(samples)))
    time = stepper.sample_time * np.arange(samples + 1, dtype=np.float64)
    return _means(time, states[:, [dynamics.SURGE, dynamics.SWAY, dynamics.HEADING]], swim.frequency)


def _residuals(numbers: NDArray[np.float64], swims: list[Measured], assumed: Assumed) -> NDArray[np.float64]:
    result = []
    for swim in swims:
        means = predict(numbers, swim, assumed)
        result.append((means.speed - swim.means.speed) / _SPEED_SCALE)
        result.append((means.turning_rate - swim.means.turning_rate) / _TURN_SCALE)
    return np.array(result)


def identify(swims: list[Measured], assumed: Assumed = _ASSUMED) -> NDArray[np.float64]:
    """Return the numbers of `predict` that fit the swims best."""
    found = least_squares(
        _residuals,
        np.array(_START),
        bounds=(np.array(_LOW), np.array(_HIGH)),
        x_scale=np.array((0.3, 0.3, 0.3, 0.1)),
        diff_step=np.full(len(_START), 1e-3),
        max_nfev=30,
        args=(swims, assumed),
    )
    numbers: NDArray[np.float64] = found.x
    return numbers


def _root_mean_square(values: list[float] | NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _errors(numbers: NDArray[np.float64], swims: list[Measured], assumed: Assumed = _ASSUMED) -> tuple[float, float]:
    """Return the root mean squares of the errors of speed in m/s and of turning rate in rad/s."""
    residuals = _residuals(numbers, swims, assumed)
    return _root_mean_square(residuals[::2] * _SPEED_SCALE), _root_mean_square(residuals[1::2] * _TURN_SCALE)


@own_style()
def _draw(path: Path, swims: list[Measured], computed: list[Means], noise: Noise) -> None:
    figure, axes = new_figure(10.0, 4.6, 1, 2)
    colours = {15: BODY_COLOUR, 25: TAIL_COLOUR, 30: FIN_COLOUR}
    for swim, means in zip(swims, computed, strict=True):
        fitted = swim.amplitude == TRAINING_AMPLITUDE
        style = {"color": colours[swim.amplitude], "marker": "x" if fitted else "o", "ls": ""}
        label = f"{swim.amplitude} degrees, {'fitted' if fitted else 'predicted'}" if swim.bias == 0 else None
        axes[0, 0].plot(100.0 * swim.means.speed, 100.0 * means.speed, label=label, **style)
        axes[0, 1].plot(swim.means.turning_rate, means.turning_rate, **style)
    kinds = (("Forward speed", "cm/s", 100.0 * noise.speed), ("Turning rate", "rad/s", noise.turning_rate))
    for panel, (title, unit, spread) in zip(axes.flat, kinds, strict=True):
        ends = np.array((min(*panel.get_xlim(), *panel.get_ylim()), max(*panel.get_xlim(), *panel.get_ylim())))
        panel.plot(ends, ends, color="#9aa5b1", lw=1.0, zorder=0)
        panel.fill_between(ends, ends - spread, ends + spread, color="#9aa5b1", alpha=0.3, lw=0.0, zorder=0)
        panel.set(xlabel=f"measured, {unit}", ylabel=f"computed, {unit}", title=title, xlim=ends, ylim=ends)
    axes[0, 0].legend(frameon=False)
    figure.savefig(path, dpi=120)


def _side_differences(swims: list[Measured], means: list[Means]) -> NDArray[np.float64]:
    """Return how speed in m/s and turning rate in rad/s differ between opposite biases, shape (pairs, 2)."""
    found = {(swim.amplitude, swim.bias): each for swim, each in zip(swims, means, strict=True)}
    pairs = [(each, found[amplitude, -bias]) for (amplitude, bias), each in found.items() if bias > 0]
    return np.array([(a.speed - b.speed, abs(a.turning_rate) - abs(b.turning_rate)) for a, b in pairs])


def _compared(swims: list[Measured], computed: list[Means]) -> str:
    """Return what the computed swims show and what they do not, as Markdown."""
    biased = [(swim, means) for swim, means in zip(swims, computed, strict=True) if swim.bias]
    least = min(swim.amplitude for swim in swims)
    excess = [100.0 * (means.speed - swim.means.speed) for swim, means in biased if swim.amplitude == least]
    ratios = [means.sideways / swim.means.sideways for swim, means in biased]
    low, middle, high = np.percentile(ratios, (10, 50, 90))
    differing = _side_differences(swims, [swim.means for swim in swims])
    left_over = differing - _side_differences(swims, computed)
    speed, turn = 100.0 * _root_mean_square(differing[:, 0]), _root_mean_square(differing[:, 1])
    speed_left, turn_left = 100.0 * _root_mean_square(left_over[:, 0]), _root_mean_square(left_over[:, 1])
    return f"""
What this shows: speed over amplitude, turning over bias and their signs follow from the equations. What it does not:
agreement within the noise; the errors are larger. The biased swims of {least} degrees come out {np.mean(excess):.1f}
cm/s too fast in the mean and up to {max(excess):.1f}. The biased fish slips sideways {middle:.1f} times as fast as
measured in the median ({low:.1f} to {high:.1f} times in eight swims of ten): the hull's lift is too simple, or the
point that the camera follows is not the centre of mass. Opposite biases differ by {speed:.1f} cm/s and
{turn:.3f} rad/s (root mean square), and {speed_left:.1f} cm/s and {turn_left:.3f} rad/s of it are left over by the
bias offset: one constant offset does not explain it. Lift and yaw damping trade against each other. The identified
numbers carry whatever the assumed geometry has wrong."""


def _data(swims: list[Measured], repeats: list[Measured], noise: Noise) -> str:
    """Return the paragraphs on what was measured, in which time, and how well it repeats."""
    straight = float(np.mean([swim.frequency for swim in swims if not swim.bias]))
    biased = [swim.frequency for swim in swims if swim.bias]
    return f"""{len(swims)} measured swims of a robotic fish with one servo and a rigid tail
(`tests/data/tail_actuated_fish_swims`). The times published with the swims are wrong: they count 30 pictures a second,
and by the clock in the control logs of the same runs a picture came every 65 to 85 ms in a run's mean. Here all is in
true time, 2.01 to 2.55 times the published. In it a harmonic fitted to each swim's yaw rate beats at
{straight:.2f} Hz without bias and at {min(biased):.2f} to {max(biased):.2f} Hz with it, near
the published 1 Hz; each swim is computed at its own frequency.
Compared are the means over each swim's second half, started at the measured speed, since many are still accelerating.

**Noise.** Of {len(repeats)} repeats {noise.lost} lost the fish on the way (they swim backwards at more than
{-100.0 * LOST_SPEED:.0f} cm/s at some time) and are dropped; the other {noise.pairs}
(`tests/data/tail_actuated_fish_third_runs`) give a noise of one swim of {100.0 * noise.speed:.2f} cm/s and
{noise.turning_rate:.4f} rad/s. That repeats start at different speeds is in it."""


def _check(name: str, error: float, mean: float, noise: float) -> Check:
    return Check(name, error / mean, 0.2, f"{error / noise:.1f} times the noise of one swim")


def _identified(numbers: NDArray[np.float64]) -> str:
    """Return the rows of the identified numbers beside the published ones."""
    shown = [*np.exp(numbers[:3]), math.degrees(numbers[3])]
    started = [*np.exp(_START[:3]), 0.0]
    rows = zip(_NAMES, started, shown, strict=True)
    return "\n".join(f"| {name} | {published:.3g} | {own:.3g} |" for name, published, own in rows)


def _at_bounds(numbers: NDArray[np.float64]) -> str:
    """Return the sentence on numbers that are at a bound of what they were allowed, or an empty text."""
    bounds = zip(_NAMES, numbers, _LOW, _HIGH, strict=True)
    at_bound = [name for name, v, low, high in bounds if min(v - low, high - v) < 1e-3 * (high - low)]
    return f" At the bound of what it was allowed: {', '.join(at_bound)}." if at_bound else ""


def _refitted(training: list[Measured], others: list[Measured]) -> str:
    """Return the rows of what is fitted to ``training`` with other assumptions, and how well it predicts ``others``."""
    rows = []
    for name, assumed in _OTHER_ASSUMPTIONS.items():
        refit = identify(training, assumed)
        areas = " | ".join(f"{number:.2g}" for number in np.exp(refit[:3]))
        speed, turn = _errors(refit, others, assumed)
        rows.append(f"| {name} | {areas} | {100.0 * speed:.2f} | {turn:.3f} |")
    return "\n".join(rows)


def section(data: Path, figures: Path) -> Section:
    """Return the part on measured swims and draw its picture."""
    swims = read_swims(data / "tail_actuated_fish_swims")
    repeats = read_swims(data / "tail_actuated_fish_third_runs")
    noise = repeat_noise(swims, repeats)
    training = [swim for swim in swims if swim.amplitude == TRAINING_AMPLITUDE]
    others = [swim for swim in swims if swim.amplitude != TRAINING_AMPLITUDE]
    numbers = identify(training)
    computed = [predict(numbers, swim) for swim in swims]
    _draw(figures / FIGURE, swims, computed, noise)

    fit, unfitted = _errors(numbers, training), _errors(np.array(_START), others)
    speed, turn = _errors(numbers, others)
    mean_speed = float(np.mean([swim.means.speed for swim in others]))
    mean_turn = float(np.mean([abs(swim.means.turning_rate) for swim in others if swim.bias]))
    amplitudes = " and ".join(f"{amplitude}" for amplitude in sorted({swim.amplitude for swim in others}))
    largest_bias = max(abs(swim.bias) for swim in training)
    text = f"""
{_data(swims, repeats, noise)}

**Assumed.** Body (0.725 kg, added masses 0.217 and 0.789 kg, inertias 2.66e-3 and 7.93e-4 kg m^2,
joint at 10.5 cm) and tail (7.1 by 4.0 cm) are those that Wang & Tan (IEEE Transactions on Robotics 31, 2015, 906) give
for such a fish of the same laboratory, quoted without having the paper at hand; the data do not say that it is the same
one. C_N = 1, and the tail follows its command.

**Fitted** on the {len(training)} swims of {TRAINING_AMPLITUDE} degrees, bias 0 to {largest_bias} degrees either way:

| number | published for such a fish | identified |
|---|---|---|
{_identified(numbers)}

Errors (root mean square): fitted swims {100.0 * fit[0]:.2f} cm/s and {fit[1]:.3f} rad/s; the {len(others)} swims of
{amplitudes} degrees, which nothing was fitted to, {100.0 * speed:.2f} cm/s of {100.0 * mean_speed:.1f} and
{turn:.3f} rad/s of {mean_turn:.2f} (with the published numbers {100.0 * unfitted[0]:.1f} cm/s and
{unfitted[1]:.2f} rad/s).{_at_bounds(numbers)}
The drag area is {math.exp(_START[0] - numbers[0]):.0f} times below the published one; over the hull's published surface
of {_HULL_AREA} m^2 it is C_D = {math.exp(numbers[0]) / _HULL_AREA:.3f}. It is known only to a factor of two, since the
swims are short and the thrust is not measured. Fitted again with other assumptions, which predict about as well:

| assumed instead | S C_D, m^2 | S C_L, m^2/rad | K_D, N m s^2 | predicted: error, cm/s | error, rad/s |
|---|---|---|---|---|---|
{_refitted(training, others)}

{_compared(swims, computed)}"""
    caption = (
        "Computed over measured means of the second half; the grey line is agreement, the band the noise of one swim."
    )
    checks = [
        _check(
            f"{len(others)} predicted swims: speed, root mean square error over the mean",
            speed,
            mean_speed,
            noise.speed,
        ),
        _check(f"{len(others)} predicted swims: turning rate, the same", turn, mean_turn, noise.turning_rate),
    ]
    return Section("Measured swims", checks, text, FIGURE, caption)
