"""Many candidates as columns are judged, built and driven as each of them alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.search.many import columns_of
from fin_optimizer.search.rules import gait_of
from fin_optimizer.search.space_file import space_of
from fin_plant.fin import Fin
from fin_plant.gait import Gait
from fin_sim.batch.columns import fin_columns

if TYPE_CHECKING:
    from fin_optimizer.search.space_file import SpaceFile

AMPLITUDE = {"gait.amplitude": {"minimum": 0.1, "maximum": 0.3}}
LENGTH = {"fin.length": {"minimum": 0.05, "maximum": 0.12}}
PHASE = {"gait.joint_2.phase": {"minimum": 1.0, "maximum": 6.0}, "gait.joint_1.bias": {"minimum": 0.0, "maximum": 0.1}}
HEIGHTS = {"fin.profile_height": {"points": 2, "minimum": 0.02, "maximum": 0.05}}
SECOND = {"fin.profile_height[2]": {"minimum": 0.02, "maximum": 0.05}}
PROFILE = {"fin.profile_position": [0.3, 0.6], "fin.profile_height": [0.03, 0.04]}
SHEETS = {
    name: {"material": "PP", "thickness": f"{thickness} mm", "sheet": ["90 mm", "200 mm"]}
    for name, thickness in (("thin", 0.4), ("thick", 0.8))
}
BY_HEIGHTS = {"fin.area": {"value": "fixed", "by": "heights"}}
SPACES = [
    (1, AMPLITUDE, "gait.amplitude <= 0.2 rad", {}),
    (1, AMPLITUDE, "gait.joint_1.amplitude <= 0.2 rad", {}),
    (1, {**AMPLITUDE, **LENGTH}, "servo.rate <= 90 deg/s", {}),
    (1, LENGTH, "gait.amplitude * fin.length <= 20 mm", {}),
    (1, LENGTH, "gait.joint_1.amplitude * fin.length <= 20 mm", {}),
    (1, LENGTH, "fin.area <= 20 cm^2", {}),
    (1, LENGTH, "fin.profile_height[1] <= 0.4 * fin.length", PROFILE),
    (1, SECOND, "fin.profile_height[1] <= fin.profile_height[2]", PROFILE),
    (1, HEIGHTS, "fin.profile_height[1] <= fin.profile_height[2]", {}),
    (1, {**HEIGHTS, **LENGTH}, "fin.profile_height[2] <= 25 mm", {"ties": BY_HEIGHTS}),
    (1, LENGTH, "fin.length >= 80 mm", {"stock": SHEETS}),
    (1, {**AMPLITUDE, **LENGTH}, "fin.length >= 80 mm", {"stock": SHEETS}),
    (2, AMPLITUDE, "gait.amplitude <= 0.2 rad", {}),
    (2, AMPLITUDE, "gait.joint_2.amplitude <= 0.2 rad", {}),
    (2, LENGTH, "gait.joint_2.amplitude * fin.length <= 20 mm", {}),
    (2, PHASE, "gait.joint_2.phase >= -1.5 rad", {}),
    (2, {**PHASE, **LENGTH}, "gait.joint_1.bias <= 0.05 rad", {}),
]


def given(joints: int, searched: dict[str, Any], condition: str, more: dict[str, Any]) -> SpaceFile:
    start = {name: entry.default for name, entry in OPTIMIZER_PARAMETERS.items() if name.startswith("gait.")}
    start |= {"gait.preset": "sub_carangiform", "gait.driven_joints": 2} if joints == 2 else {}
    start |= Fin().as_parameters() | {name: value for name, value in more.items() if name in PROFILE}
    sections = {name: value for name, value in more.items() if name not in PROFILE}
    return space_of({"search": searched, "conditions": [condition], **sections}, {}, start, joints)


def candidates(found: SpaceFile) -> np.ndarray:
    low, high = found.space.bounds
    return found.space.numbers(np.random.default_rng(1).uniform(low, high, (30, len(low))))


@pytest.mark.parametrize(("joints", "searched", "condition", "more"), SPACES)
def test_many_are_judged_as_each_alone(
    joints: int, searched: dict[str, Any], condition: str, more: dict[str, Any]
) -> None:
    found = given(joints, searched, condition, more)
    numbers = candidates(found)
    alone = [place for place, row in enumerate(numbers.tolist()) if found.space.judge(found.space.values(row))]
    assert found.space.refused(numbers).tolist() == alone
    assert 0 < len(alone) < len(numbers)
    assert found.space.refused(numbers[:1]).tolist() == [0] * (0 in alone)


@pytest.mark.parametrize(("joints", "searched", "condition", "more"), SPACES)
def test_many_are_built_and_driven_as_each_alone(
    joints: int, searched: dict[str, Any], condition: str, more: dict[str, Any]
) -> None:
    found = given(joints, searched, condition, more)
    numbers = candidates(found)
    columns = columns_of(found.space, found.rules, found.start, numbers)
    sent = [found.rules.sent(found.start, found.space.values(row)) for row in numbers.tolist()]
    alone, together = fin_columns([Fin.from_parameters(each) for each in sent]), fin_columns(columns.fins)
    assert alone.keys() == together.keys()
    for name, column in alone.items():
        own = np.broadcast_to(together[name], column.shape)
        assert (own == column).all() if column.dtype.kind == "U" else own == pytest.approx(column, rel=1e-12)
    assert len(columns.fins["length"]) == columns.count == len(numbers)
    for place, each in enumerate(sent):
        gait = columns.gaits if isinstance(columns.gaits, Gait) else Gait.from_rows(columns.gaits[place])
        assert gait.same_as(gait_of(each), 1e-12)
    if not found.rules.stock:
        assert isinstance(columns.gaits, Gait) == (not any(name.startswith("gait.") for name in found.space.names))
