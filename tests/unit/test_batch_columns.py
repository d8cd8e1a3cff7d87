"""Profiles and gaits as columns of a batch: each fish has its own, in lanes."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

from fin_plant.fin import Fin, ProfiledFin
from fin_plant.gait import Gait, JointDrive
from fin_sim.batch import Status, swim_batch
from fin_sim.batch.window import whole_beats
from fin_sim.swim import swim

GAITS = [
    Gait((JointDrive(0.3, 1.3, 0.4, 0.1),)),
    Gait((JointDrive(0.2, 0.9),)),
    Gait((JointDrive(0.45, 2.6, -2.0),)),
]
PROFILES = {
    "profile_position": np.array([[0.3, 0.6, 0.65], [0.25, 0.5, 0.75], [0.1, 0.9, np.nan]]),
    "profile_height": np.array([[0.01, 0.04, 0.02], [0.03, 0.02, 0.03], [0.03, 0.01, np.nan]]),
}


@pytest.fixture
def only_lanes(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        pytest.fail("swum by the general kernel")

    monkeypatch.setattr(import_module("fin_sim.batch.swim_batch"), "swim_by_general_kernel", refuse)


def profiled(row: int) -> ProfiledFin:
    points = {name: tuple(column[row][~np.isnan(column[row])].tolist()) for name, column in PROFILES.items()}
    return ProfiledFin(**vars(Fin()) | points)


@pytest.mark.usefixtures("only_lanes")
def test_fins_with_profiles_and_gaits_of_their_own_swim_in_lanes_as_alone() -> None:
    swum = swim_batch(PROFILES, gait=np.array([gait.rows() for gait in GAITS]), duration=3.0, settle=1.0)
    assert (swum.status == Status.OK).all()
    for row, gait in enumerate(GAITS):
        alone = swim(profiled(row), gait=gait, duration=3.0)
        assert swum.mean_speed[row] == pytest.approx(alone.mean_speed, rel=1e-3)
        own = swim_batch([profiled(row)], gait=gait.rows()[None], duration=3.0, settle=1.0)
        assert own.mean_speed[0] == swum.mean_speed[row]
        assert own.servo_power[0] == swum.servo_power[row]


@pytest.mark.usefixtures("only_lanes")
def test_means_over_whole_beats_are_each_gaits_own() -> None:
    """As those over a window that is the gait's whole beats; over the given window they are others."""
    gaits = np.array([gait.rows() for gait in GAITS])
    timing = {"duration": 4.0, "settle": 1.3}
    window = swim_batch(PROFILES, gait=gaits, **timing)  # type: ignore[arg-type]
    swum = swim_batch(PROFILES, gait=gaits, whole_beats=True, **timing)  # type: ignore[arg-type]
    for row, beats in enumerate((3, 2, 7)):
        gait = GAITS[row]
        own = {"duration": 4.0, "settle": 4.0 - beats / gait.joints[0].frequency}
        alone = swim_batch([profiled(row)], gait=gaits[row : row + 1], **own)  # type: ignore[arg-type]
        shared = swim_batch([profiled(row)], gait=gait, whole_beats=True, **timing)  # type: ignore[arg-type]
        for name in ("mean_forward_speed", "thrust", "servo_power"):
            figure = getattr(swum, name)[row]
            assert figure == pytest.approx(getattr(alone, name)[0], rel=3e-4)
            assert figure == pytest.approx(getattr(shared, name)[0], rel=3e-4)
        assert abs(window.servo_power[row] / swum.servo_power[row] - 1.0) > 1e-3
    assert (window.mean_speed == swum.mean_speed).all()


def test_a_window_without_a_whole_beat_counts_as_it_is() -> None:
    begins = whole_beats(10.0, 5.0, np.array([0.0, 0.1, 0.2, 0.21, 0.5, 1.0 / 3.0]))
    assert begins == pytest.approx([5.0, 5.0, 5.0, 10.0 - 1.0 / 0.21, 6.0, 7.0])


@pytest.mark.usefixtures("only_lanes")
def test_a_gait_or_a_profile_that_cannot_be_is_refused_and_spoils_no_other() -> None:
    gaits = np.array([gait.rows() for gait in GAITS])
    gaits[1, 0, 0] = 3.2
    profiles = {name: column.copy() for name, column in PROFILES.items()}
    profiles["profile_position"][2, :2] = 0.9, 0.1
    swum = swim_batch(profiles, gait=gaits, duration=1.0)
    assert swum.status.tolist() == [Status.OK, Status.REFUSED, Status.REFUSED]
    assert "gait amplitude" in swum.reason(1)
    assert "must rise" in swum.reason(2)
    assert np.isfinite(swum.mean_speed[0])
    assert np.isnan(swum.mean_speed[1:]).all()


def test_columns_that_do_not_fit_are_refused_with_their_shapes() -> None:
    with pytest.raises(ValueError, match=r"gaits have shape \(3, 2, 4\).*\(n, 1, 4\)"):
        swim_batch({}, gait=np.zeros((3, 2, 4)))
    with pytest.raises(ValueError, match="3 gaits and 2 fins"):
        swim_batch({"length": [0.08, 0.09]}, gait=np.zeros((3, 1, 4)))
    with pytest.raises(ValueError, match=r"fin\.profile_height.*\(3,\)"):
        swim_batch({**PROFILES, "length": [0.08, 0.09]})
    with pytest.raises(ValueError, match=r"fin\.profile_height must be numbers"):
        swim_batch({"profile_position": [0.5], "profile_height": ["high"]})
    one = swim_batch({"profile_position": [0.5], "profile_height": [0.02, 0.03]}, duration=1.0)
    assert one.status.tolist() == [Status.REFUSED]
    assert "1 entries" in one.reason(0)
