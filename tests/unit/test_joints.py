"""JointStates read all at once tell what each tells alone, whatever a plant puts into them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_optimizer.bags.messages import BagError, decode, message_types
from fin_optimizer.score.joints import JOINT_STATE_TYPE, joint_columns
from support.bags import SECOND

if TYPE_CHECKING:
    from collections.abc import Sequence

NUMBERS = st.floats(-1e3, 1e3)


def message(stamp: int, frame: str, names: Sequence[str], *numbers: Sequence[float]) -> bytes:
    types = message_types().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp, SECOND)), frame)
    told = types[JOINT_STATE_TYPE](header, list(names), *(np.array(each, dtype=np.float64) for each in numbers))
    return bytes(message_types().serialize_cdr(told, JOINT_STATE_TYPE))


@st.composite
def streams(draw: st.DrawFn) -> list[bytes]:
    """Return messages of one plant, or of one that changes what it tells."""
    text = st.text("abc_é1", max_size=9)
    names = draw(st.lists(text, max_size=5))
    told = [draw(st.sampled_from([0, len(names)])) for _ in range(3)]
    frame, messages = draw(text), []
    for index in range(draw(st.integers(1, 6))):
        if draw(st.integers(0, 9)) == 0:
            names = [draw(text) for _ in names]
        numbers = [draw(st.lists(NUMBERS, min_size=count, max_size=count)) for count in told]
        messages.append(message(index * SECOND + draw(st.integers(0, 999)), frame, names, *numbers))
    return messages


@given(streams())
def test_columns_hold_what_the_messages_tell(messages: list[bytes]) -> None:
    rows = [
        (int(stamp), list(each.names), *(list(told) for told in numbers))
        for each in joint_columns(messages)
        for stamp, *numbers in zip(each.stamps, each.position, each.velocity, each.effort, strict=True)
    ]
    alone = [decode(data, JOINT_STATE_TYPE) for data in messages]
    expected = [
        (
            each.header.stamp.sec * SECOND + each.header.stamp.nanosec,
            each.name,
            *(list(told) for told in (each.position, each.velocity, each.effort)),
        )
        for each in alone
    ]
    assert rows == expected


def test_a_plant_whose_messages_are_alike_is_read_at_once() -> None:
    alike = [
        message(index, "base", ["tail_joint_1", "fin_hinge_1"], [0.1, index], [0.2, 1.0], []) for index in range(9)
    ]
    (columns,) = joint_columns(alike)
    assert columns.position[:, 1].tolist() == list(range(9))
    assert columns.effort.shape == (9, 0)
    other = message(10, "base", ["tail_joint_1", "fin_hinge_2"], [0.1, 1.0], [0.2, 1.0], [])
    assert len(joint_columns([*alike, other])) == 10


def test_what_is_no_joint_state_is_refused() -> None:
    with pytest.raises(BagError, match="is no sensor_msgs/msg/JointState"):
        joint_columns([b"\x00\x01\x00\x00" + bytes(5)])
