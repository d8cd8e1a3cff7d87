"""Gaits are validated once, and what makes two of them one."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_plant.gait import Gait, JointDrive
from support.drives import drives


@given(drives, st.floats(0.0, 1.5), st.floats(0.01, 5.0))
def test_a_limited_drive_stays_within_the_sweep_and_keeps_its_bias_first(
    drive: JointDrive, sweep: float, frequency: float
) -> None:
    limited = drive.limited(sweep, frequency)
    assert abs(limited.bias) + limited.amplitude <= sweep * (1 + 1e-12)
    assert limited.frequency <= frequency
    if abs(drive.bias) + drive.amplitude <= sweep and drive.frequency <= frequency:
        assert Gait((limited,)).rows() == pytest.approx(Gait((drive,)).rows(), abs=1e-12)


@pytest.mark.parametrize("column", range(4))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e10])
def test_a_value_that_cannot_be_is_refused_with_joint_and_column(column: int, value: float) -> None:
    row = [0.1, 1.0, 0.0, 0.0]
    row[column] = value
    with pytest.raises(ValueError, match=r"joint 2: gait (amplitude|frequency|phase|bias) = "):
        Gait.from_rows([[0.1, 1.0, 0.0, 0.0], row])


@pytest.mark.parametrize("rows", [[], [[0.1, 1.0]], [0.1, 1.0, 0.0, 0.0]])
def test_rows_of_another_shape_are_refused(rows: object) -> None:
    with pytest.raises(ValueError, match=r"gait has shape|driven joints"):
        Gait.from_rows(rows)  # type: ignore[arg-type]


def paper(phase: float = 0.0, frequency: float = 0.9, amplitude: float = 0.26, bias: float = 0.0) -> Gait:
    return Gait((JointDrive(amplitude, frequency, phase, bias),))


@pytest.mark.parametrize("turns", [1, -1, 3, 50, 10_000_000])
def test_phases_that_differ_by_whole_turns_are_one_gait(turns: int) -> None:
    other = paper(0.4 + turns * 2.0 * math.pi)
    assert other.same_as(paper(0.4))
    assert not other.same_as(paper(0.41))
    assert other.joints[0].phase == pytest.approx(0.4, abs=1e-7)


def test_either_end_of_the_circle_is_one_place() -> None:
    assert JointDrive(0.1, 1.0, -math.pi) == JointDrive(0.1, 1.0, math.pi)
    assert paper(math.pi - 2e-7).same_as(paper(-math.pi + 2e-7))


def test_two_gaits_may_be_one_but_for_a_persons_rounding() -> None:
    asked, applied = (Gait((JointDrive(amplitude, 0.9, 2.0 * math.pi),)) for amplitude in (0.2618, math.radians(15.0)))
    assert applied.same_as(asked, rounding=1e-4)
    assert not applied.same_as(asked)
    assert not applied.same_as(Gait((JointDrive(0.2622, 0.9),)), rounding=1e-4)
    assert not applied.same_as(Gait((JointDrive(0.2618, 0.9, 0.1),)), rounding=1e-4)
