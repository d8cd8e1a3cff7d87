"""A fish with its drive and its tracker: what follows from their parameters for a swim of a commanded gait."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from fin_optimizer.calibration.settings import AHEAD, GAIN_LEFT, GAIN_RIGHT, OFFSET, OWN, SPEED_FACTOR, STIFFNESS_FACTOR
from fin_plant.fin import Fin
from fin_sim import dynamics, time_stepping
from fin_sim.chain import build_chain
from fin_sim.fish import Fish

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_optimizer.calibration.settings import Settings
    from fin_optimizer.calibration.swims import Swim
    from fin_plant.parameters import Value
    from fin_sim.chain import Reactive

    Array = NDArray[np.float64]

_BEATS_BEFORE = 2.0
_STEPS_A_BEAT, _STEPS_A_BEAT_OF_A_FLEXIBLE_FIN = 50.0, 250.0


@dataclass(frozen=True)
class Knots:
    """What a servo does at each commanded bias that was recorded; linear in between, constant beyond.

    Attributes:
        bias: Commanded, rad, rising.
        amplitude_factor: True over commanded amplitude.
        frequency: Tail beats, Hz; 0 where it is as a swim says.
    """

    bias: tuple[float, ...]
    amplitude_factor: tuple[float, ...]
    frequency: tuple[float, ...]

    def at(self, bias: float) -> tuple[float, float]:
        """Return amplitude factor and frequency in Hz at a commanded bias in rad."""
        factor, frequency = (np.interp(bias, self.bias, each) for each in (self.amplitude_factor, self.frequency))
        return float(factor), float(frequency)


@dataclass(frozen=True)
class Model:
    """A fish, its drive and what the tracker sees of it.

    Attributes:
        fish: Every parameter of the simulator.
        own: Every parameter of `OWN`.
        knots: Of the drive.
    """

    fish: Mapping[str, Value]
    own: Mapping[str, float]
    knots: Knots

    def true_bias(self, commanded: float) -> float:
        """Return the tail's true bias for a commanded one, both in rad."""
        gain = self.own[GAIN_RIGHT if commanded > 0.0 else GAIN_LEFT]
        return self.own[OFFSET] + gain * commanded

    @property
    def ahead(self) -> float:
        """Tracked point ahead of the centre of mass, m."""
        return self.own[AHEAD]

    @property
    def speed_factor(self) -> float:
        """Forward speed as recorded over the true one."""
        return self.own[SPEED_FACTOR]


def model_of(
    settings: Settings, coordinates: Array, biases: tuple[float, ...], frequencies: tuple[float, ...]
) -> Model:
    """Return the model of a vector of coordinates: of each fitted parameter, then the factor at each bias if fitted."""
    count = len(settings.fitted)
    values = {each.name: each.value(float(at)) for each, at in zip(settings.fitted, coordinates, strict=False)}
    factors = tuple(map(float, coordinates[count:])) or (1.0,) * len(biases)
    own = {name: values.get(name, settings.fixed.get(name, none)) for name, (none, _) in OWN.items()}
    fish = {**settings.fish, **{name: value for name, value in values.items() if name not in OWN}}
    return Model(fish, own, Knots(biases, factors, frequencies))


class Tank:
    """A model ready to swim: its chains' tables, prepared once for many swims."""

    def __init__(self, model: Model) -> None:
        """Prepare; raises ValueError for a fish that the simulator refuses."""
        self.model = model
        self._fish = Fish.from_parameters(model.fish)
        if self._fish.driven_joints != 1:
            msg = f"the fish has {self._fish.driven_joints} driven joints, a calibration knows those of one only"
            raise ValueError(msg)
        self._steppers: dict[tuple[float, str], time_stepping.Stepper] = {}

    def _stepper(self, swim: Swim, frequency: float) -> time_stepping.Stepper:
        key = (frequency, repr(swim.fin))  # of which some are lists
        if key not in self._steppers:
            values = {**self.model.fish, **swim.fin}
            modulus = self.model.own[STIFFNESS_FACTOR] * cast("float", values["fin.young_modulus"])
            fin = Fin.from_parameters({**values, "fin.young_modulus": modulus})
            chain = build_chain(self._fish, fin, reactive=cast("Reactive", values["reactive"]))
            steps = _STEPS_A_BEAT_OF_A_FLEXIBLE_FIN if len(chain.links) > 1 else _STEPS_A_BEAT
            self._steppers[key] = time_stepping.Stepper(chain, 1.0 / (steps * frequency))
        return self._steppers[key]

    def swim(self, swim: Swim, start: Array, times: Array) -> Array:
        """Return the fish's motion at ``times`` from a start.

        Args:
            swim: What was commanded.
            start: Forward and sideways velocity, m/s, yaw rate, rad/s, and the beat's phase, rad, at time 0, (4,).
            times: s, shape (T,), rising from 0 on.

        Returns:
            Shape (T, 6): x, y, heading from 0, forward and sideways velocity, yaw rate. NaN from a moment on at which
            the computation broke off.
        """
        frequency = self.model.knots.at(swim.bias)[1]
        if swim.frequency_commanded or not frequency:
            frequency = swim.frequency
        stepper = self._stepper(swim, frequency)
        samples = int(times[-1] / stepper.step) + 1
        state = stepper.start()
        body = slice(dynamics.SURGE, dynamics.YAW_RATE + 1)
        try:
            if len(stepper.chain.links) > 1:
                # Nobody records how a fin is bent: as after some beats of this gait at this speed.
                earlier = round(_BEATS_BEFORE / frequency / stepper.step)
                state[body] = start[:3]
                stepper.advance(state, self._motion(swim, frequency, stepper.half_step_times(earlier), start[3]))
                state[: dynamics.BODY_STATES] = 0.0
            state[body] = start[:3]
            motion = self._motion(swim, frequency, stepper.half_step_times(samples), start[3])
            states, _ = stepper.advance(state, motion)
        except time_stepping.StepError:
            return np.full((len(times), dynamics.BODY_STATES), np.nan)
        place = times / stepper.step
        before = np.minimum(place.astype(np.int64), samples - 1)
        part = (place - before)[:, None]
        kept = states[:, : dynamics.BODY_STATES]
        result: Array = (1.0 - part) * kept[before] + part * kept[before + 1]
        return result

    def _motion(self, swim: Swim, frequency: float, times: Array, phase: float) -> Array:
        """Return angle, rate and acceleration of the driven joint, shape (T, 1, 3); as whole beats before."""
        amplitude, turning = self.model.knots.at(swim.bias)[0] * swim.amplitude, 2.0 * math.pi * frequency
        sine, cosine = (amplitude * wave(turning * times + phase) for wave in (np.sin, np.cos))
        motion = np.stack((self.model.true_bias(swim.bias) + sine, turning * cosine, -turning * turning * sine), axis=1)
        return motion[:, None, :]
