"""What a servo gives to a fin that does not bend is what the simulator's servo gives to one on a fish that is held."""

from __future__ import annotations

import pytest

from fin_plant.fin import Fin, ProfiledFin
from fin_plant.gait import carangiform
from fin_sim.rigid_fin import rigid_fin_load
from fin_sim.swim import swim

STIFF = {"young_modulus": 2.1e11, "thickness": 1.5e-3, "segments": 1, "damping_time": 1e-4}


@pytest.mark.parametrize(
    "fin",
    [
        Fin(length=0.06, height=0.03, tip_height=0.02, **STIFF),  # type: ignore[arg-type]
        ProfiledFin(
            length=0.05,
            height=0.02,
            tip_height=0.03,
            profile_position=(0.3,),
            profile_height=(0.035,),
            **STIFF,  # type: ignore[arg-type]
        ),
    ],
)
@pytest.mark.parametrize(("amplitude", "frequency"), [(0.26, 0.9), (0.5, 1.5)])
def test_torque_and_power_are_those_of_the_simulators_servo(fin: Fin, amplitude: float, frequency: float) -> None:
    found = swim(fin, gait=carangiform(amplitude, frequency), duration=4.0, clamp="fixed")
    load = rigid_fin_load(fin, amplitude, frequency)
    after = found.time >= found.ramp_time
    assert load.torque == pytest.approx(found.largest_servo_torque, rel=0.02)
    assert load.power == pytest.approx(float(found.servo_power[after].max()), rel=0.02)


def test_a_servo_gives_four_times_the_torque_and_eight_times_the_power_at_twice_the_frequency() -> None:
    slow, fast = (rigid_fin_load(Fin(), 0.2, frequency) for frequency in (1.0, 2.0))
    assert fast.torque == pytest.approx(4.0 * slow.torque)
    assert fast.power == pytest.approx(8.0 * slow.power)
