"""Fins of two later papers, simulated as far as their inputs are printed; the rank order of their speeds.

Clark, Wang, Tan & McKinley, IEEE ICES 2014, 227, print four measured speeds and no fin's inputs. Clark, Tan & McKinley,
Bioinspiration & Biomimetics 10 (2015) 065006, print frequency, duty, length, height and spring constant of four fins on
a small fish with an electromagnetic actuator; its body and the actuator's speed are read off their figures 1 and 5.
Nothing is fitted.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.fin import Fin
from fin_plant.gait import Gait, JointDrive
from fin_sim import dynamics, time_stepping
from fin_sim.chain import build_chain
from fin_sim.fish import Body, Fish
from fin_sim.materials import damping_time, material
from fin_sim.motor import Motor
from fin_sim.presets import preset
from fin_sim.validation.measured_fins import FISH, PLATE_DRAG, correlation
from fin_sim.validation.page import Section, table_head

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

LARGEST_ANGLE = math.radians(38.0)
"""Where the actuator stops (section 2.1)."""
RISE_TIME, FALL_TIME = 0.11, 0.21
"""From neutral to the stop under voltage, and back by the centring magnet, s; read off figure 5 to 0.01 s."""
TORQUE = 500e-6
"""Of the actuator, N m, "roughly" (section 2.1)."""
THICKNESS = 1.2e-3
"""Of the printed composites, m (section 4.1)."""
COMPOSITE = 90e6
"""E in Pa that composites were measured to have where the straight fit by which they were chosen is near 0; read off
figure 16 to 20 MPa."""
_SIDE = (0.061, 0.033)  # length and height of the body, m, by the ruler in figure 1
_WIDTH = 0.025  # assumed: three quarters of the height, as of the fish of 2012
_DENSITY = 1150.0  # assumed: between TangoBlackPlus and VeroWhite, kg/m^3
_SEGMENTS = 6
_HARMONICS = (1, 3, 5, 7)  # the actuator's angle repeats itself with the other sign after half a beat
_STEP, _EVERY = 1e-3, 10
_DURATION, _MEASURED, _RAMP = 18.0, 8.0, 0.5  # s
# Assumed beside the printed torque: an actuator that loses half of it at 10 rad/s, and gives all of it 6 degrees off.
# It has no stop, so it swings beyond the angle that it follows.
_MOTOR = Motor(TORQUE, no_load_speed=20.0, gain=10.0, derivative_time=0.0, time_constant=0.02)


@dataclass(frozen=True)
class LaterFin:
    """A fin of the later papers.

    Attributes:
        paper: Year.
        name: As the paper has it.
        frequency: Hz; 0 where it is not printed, and so are the other inputs.
        duty: Share of the beat with voltage on the coil, either way.
        length: m.
        height: m.
        spring: Spring constant, N m/rad.
        published: Speed that the paper simulated, m/s.
        measured: m/s.
    """

    paper: int
    name: str
    frequency: float
    duty: float
    length: float
    height: float
    spring: float
    published: float
    measured: float


def read_fins(path: Path) -> list[LaterFin]:
    """Return the fins of ``later_fins.csv``.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [
        LaterFin(
            paper=int(row["paper"]),
            name=row["fin"],
            frequency=float(row["frequency_hz"] or 0.0),
            duty=float(row["pulse_width_ratio"] or 0.0),
            length=0.01 * float(row["length_cm"] or 0.0),
            height=0.01 * float(row["height_cm"] or 0.0),
            spring=1e-6 * float(row["spring_constant_unm_rad"] or 0.0),
            published=0.01 * float(row["simulated_cm_s"]),
            measured=0.01 * float(row["measured_cm_s"]),
        )
        for row in rows
    ]


def actuator_angle(frequency: float, duty: float, points: int = 2048) -> NDArray[np.float64]:
    """Return a beat of the actuator's angle in rad, shape (points,), as figure 5 of the paper of 2015 draws it.

    Under voltage, for half of ``duty`` at the start of each half beat, it turns at the rate of the rise to the stop and
    stays there; without, it falls back to neutral at the rate of the fall. A beat too fast to come back to neutral may
    by these rates swing about any middle; it is centred.
    """
    step = 1.0 / frequency / points
    phase = np.arange(points) / points
    half = np.repeat([1.0, -1.0], points // 2)
    sign = np.where(phase % 0.5 < 0.5 * duty, half, 0.0)
    rise, fall = LARGEST_ANGLE / RISE_TIME * step, LARGEST_ANGLE / FALL_TIME * step
    angle, beat = 0.0, np.zeros(points)
    for _ in range(2):  # the first beat starts at neutral, the second where the first ended
        for index in range(points):
            if sign[index]:
                angle = min(max(angle + sign[index] * rise, -LARGEST_ANGLE), LARGEST_ANGLE)
            else:
                angle = math.copysign(max(abs(angle) - fall, 0.0), angle)
            beat[index] = angle
    return 0.5 * (beat - np.roll(beat, points // 2))


def harmonics(beat: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the complex amplitudes of the odd harmonics 1, 3, 5 and 7 of a beat, rad."""
    return np.asarray(2.0 / len(beat) * np.fft.rfft(beat)[list(_HARMONICS)])


def motion(frequency: float, amplitudes: NDArray[np.complex128], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angle, rate and acceleration of the joint, shape (T, 1, 3); begun over a ramp of half a second."""
    x = np.minimum(times / _RAMP, 1.0)
    ramp = (
        x**3 * (10.0 - 15.0 * x + 6.0 * x**2),
        30.0 * (x * (1.0 - x)) ** 2 / _RAMP,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / _RAMP**2,
    )
    speed = 2j * math.pi * frequency * np.array(_HARMONICS)
    waves = amplitudes * np.exp(np.multiply.outer(times, speed))
    angle, rate, bend = ((waves * speed**order).real.sum(axis=1) for order in range(3))
    columns = (
        ramp[0] * angle,
        ramp[1] * angle + ramp[0] * rate,
        ramp[2] * angle + 2.0 * ramp[1] * rate + ramp[0] * bend,
    )
    return np.stack(columns, axis=1)[:, None, :]


def small_fish() -> Fish:
    """Return the fish of 2015: the ellipsoid of its photograph, all else scaled by length from the fish of 2012.

    The scale is the cube root of the masses' ratio: areas go with its square, the yaw damping with its fifth power.
    """
    model = preset(FISH).fish
    length, height = _SIDE
    mass = math.pi / 6.0 * length * _WIDTH * height * model.water.density
    scale = (mass / model.body.mass) ** (1.0 / 3.0)
    body = Body.ellipsoid(
        length,
        _WIDTH,
        height,
        drag_area=model.body.drag_area * scale**2,
        lift_area=model.body.lift_area * scale**2,
        yaw_drag=model.body.yaw_drag * scale**5,
        density=model.water.density,
    )
    return Fish(body, model.water)


def _fin(of: LaterFin, modulus: float) -> Fin:
    return Fin(
        young_modulus=modulus,
        length=of.length,
        height=of.height,
        tip_height=of.height,
        thickness=THICKNESS,
        density=_DENSITY,
        segments=_SEGMENTS,
        hinges="midpoint",
        stiffness_length="segment",
        damping_time=damping_time(material("TangoBlackPlus").loss_factor, of.frequency),
        hinge_damping=0.0,
    )


def as_sheet(of: LaterFin) -> Fin:
    """Return the fin whose printed spring constant is E d h^3 / (12 l) with l its length: E I = K L."""
    return _fin(of, of.spring * 12.0 * of.length / (of.height * THICKNESS**3))


def as_chain(of: LaterFin) -> Fin:
    """Return the ten segments of the paper's simulation, with the printed spring constant at each hinge."""
    segments = 10
    chain = replace(as_sheet(of), segments=segments, hinges="between")
    return replace(chain, young_modulus=chain.young_modulus / segments)


def as_composite(of: LaterFin) -> Fin:
    """Return the fin as it was probably printed, see `COMPOSITE`."""
    return _fin(of, COMPOSITE)


def swim(of: LaterFin, fin: Fin, fish: Fish) -> tuple[float, float]:
    """Return steady speed in m/s and the largest torque at the actuator in N m of a fish with one of the fins."""
    amplitudes = harmonics(actuator_angle(of.frequency, of.duty))
    chain = build_chain(fish, fin).for_gait(Gait((JointDrive(float(abs(amplitudes[0])), of.frequency),)))
    stepper = time_stepping.Stepper(chain, _STEP, _EVERY)
    samples = round(_DURATION / stepper.sample_time)
    states, records = stepper.advance(
        stepper.start(), motion(of.frequency, amplitudes, stepper.half_step_times(samples))
    )
    last = round(math.floor(_MEASURED * of.frequency) / of.frequency / stepper.sample_time)
    way = states[-1, [dynamics.X, dynamics.Y]] - states[-1 - last, [dynamics.X, dynamics.Y]]
    torque = np.abs(records[-last:, dynamics.RECORD_HEAD]).max()
    return float(np.hypot(*way) / (last * stepper.sample_time)), float(torque)


_AS_MEASURED = f"composites as measured, {1e-6 * COMPOSITE:g} MPa"


def _readings(fish: Fish) -> dict[str, tuple[Callable[[LaterFin], Fin], Fish]]:
    """Return what the fins and their fish may have been, by name: the fin that each makes, and the fish."""
    plates = replace(fish, water=replace(fish.water, oscillating_drag=PLATE_DRAG))
    deep = replace(fish, water=replace(fish.water, model="surface_3d"))
    scaled = replace(fish, water=replace(deep.water, tip_term="scaled"))
    draggy = replace(fish, body=replace(fish.body, drag_area=2.0 * fish.body.drag_area))
    return {
        _AS_MEASURED: (as_composite, fish),
        "the same, C_N by amplitude": (as_composite, plates),
        "the same, twice the drag area": (as_composite, draggy),
        f"the same, by a motor of {1e6 * TORQUE:g} uN m that overshoots": (as_composite, replace(fish, motor=_MOTOR)),
        "the same, `surface_3d`": (as_composite, deep),
        "the same, `surface_3d`, scaled tip term": (as_composite, scaled),
        "E of 10 MPa": (lambda of: _fin(of, 10e6), fish),
        "E of 3 MPa": (lambda of: _fin(of, 3e6), fish),
        "sheet of the printed K, l the fin's length": (as_sheet, fish),
        "ten segments of the printed K": (as_chain, fish),
    }


def section(data: Path) -> Section:
    """Return the part on the later fins."""
    fins = read_fins(data / "later_fins.csv")
    printed = [fin for fin in fins if fin.frequency]
    fish = small_fish()
    swum = {name: [swim(of, make(of), where) for of in printed] for name, (make, where) in _readings(fish).items()}
    table = [_row(name, [speed for speed, _ in pairs], printed) for name, pairs in swum.items()]
    theirs = _row("*published simulation*", [fin.published for fin in printed], printed)
    moduli = [1e-6 * as_sheet(of).young_modulus for of in printed]
    ratios = [speed / of.measured for (speed, _), of in zip(swum[_AS_MEASURED], printed, strict=True)]
    torques = [1e6 * torque for _, torque in swum[_AS_MEASURED]]
    before = [fin for fin in fins if not fin.frequency]
    rho, tau = correlation(*(np.array([getattr(fin, name) for fin in before]) for name in ("measured", "published")))
    body = fish.body
    measured = " | ".join(f"*{100.0 * fin.measured:.1f}*" for fin in printed)
    text = f"""
**ICES 2014** (Clark, Wang, Tan & McKinley, IEEE ICES 2014, 227). Four fins of 1.2 mm composite, five segments in the
paper's simulation: 7.43, 4.00, 5.00 and 4.90 cm/s measured, 5.17, 5.39, 5.62 and 4.97 simulated by the authors, a rank
correlation of {abs(rho):.2f} (Kendall {abs(tau):.2f}). **Not simulated here**: the inputs of the four fins are not
printed. Figure 9 gives the lengths of two of them (10.3 and 10.9 cm), figure 10 what the best solutions had: amplitude
about 0.5 or 0.19 rad, 0.55 to 1.05 Hz, 6.6 to 10.9 cm by 2.0 to 2.6 cm, 0.1 to 0.2 GPa.

**Bioinspiration & Biomimetics 2015** (Clark, Tan & McKinley, 10, 065006). Four fins on a small fish, with frequency,
duty, length, height and spring constant printed (`tests/data/later_fins.csv`). **Read off figures**: the body's length
and height ({100.0 * _SIDE[0]:.1f} by {100.0 * _SIDE[1]:.1f} cm, figure 1) and the actuator's angle,
{math.degrees(LARGEST_ANGLE):.0f} degrees at most in {RISE_TIME:g} s and back in {FALL_TIME:g} s (figure 5; its first
four odd harmonics are swum). **Assumed**: width {100.0 * _WIDTH:.1f} cm, so {1e3 * body.mass:.0f} g; drag, lift and yaw
damping scaled by size from the preset `{FISH}` (S C_D {1e4 * body.drag_area:.1f}e-4 m^2); tan delta of TangoBlackPlus.
**Fitted**: nothing.

How stiff the fins were that swam is open. The printed spring constants, 48 to 100 uN m/rad, are those of sheets of
{min(moduli):.1f} to {max(moduli):.1f} MPa with l of equation 6 the fin's length; the authors' simulation has ten
segments with the constant at each hinge. The fins were printed as composites whose inner layer was chosen by a straight
line through measured moduli (figure 16); where that line has so few MPa, the composites were measured to have about
{1e-6 * COMPOSITE:g} MPa, so this is the likeliest. All are tried:

{table_head(["assumed", *(f"{fin.name}, cm/s" for fin in printed), "rho, tau"])}
| *measured* | {measured} | |
{theirs}
{chr(10).join(table)}

From 3 MPa on the rank correlation is 0.8: "best speed" (measured 3.8 cm/s) and "dominated" (3.5), the closest two,
change places, and all other pairs are in order, whatever the resistive force, the drag area or the torque. With the
printed constants it is lower: fins as soft as those lose the thrust of their fast beat. As composites the four come out
{min(ratios):.1f} to {max(ratios):.1f} times too fast, the two of fast beats most; twice the scaled drag area fits
better. The fast ones need up to {torques[0]:.0f} and {torques[2]:.0f} uN m ({torques[1]:.0f} and {torques[3]:.0f} the
slow ones), and the actuator has roughly {1e6 * TORQUE:g}: it is at its limit, and the authors saw that the fin did
not reach the amplitude of the simulation. Four fins tell little: 0.8 or more comes by chance once in six times."""
    return Section("Later fins", text=text)


def _row(name: str, speeds: Sequence[float], fins: Sequence[LaterFin]) -> str:
    rho, tau = correlation(np.array([fin.measured for fin in fins]), np.array(speeds))
    return f"| {name} | {' | '.join(f'{100.0 * speed:.1f}' for speed in speeds)} | {rho:.2f}, {tau:.2f} |"
