"""The contract's messages: a gait as Float64MultiArray, the plant's state as DiagnosticStatus, stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from fin_plant.gait import COLUMNS, Gait
from fin_plant.plant_state import PlantState, State
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike


def time_message(nanoseconds: int) -> Time:
    """Return a stamp from nanoseconds since the epoch."""
    seconds, rest = divmod(int(nanoseconds), NANOSECONDS)
    return Time(sec=seconds, nanosec=rest)


def nanoseconds_of(stamp: Time) -> int:
    """Return a stamp's nanoseconds since the epoch."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def gait_message(rows: ArrayLike) -> Float64MultiArray:
    """Return the message of a gait given as rows (joints, 4)."""
    table = np.asarray(rows, dtype=float)
    joints, columns = table.shape
    message = Float64MultiArray(data=table.ravel().tolist())
    message.layout.dim = [
        MultiArrayDimension(label="joint", size=joints, stride=joints * columns),
        MultiArrayDimension(label=" ".join(COLUMNS), size=columns, stride=columns),
    ]
    return message


def gait_from_message(message: Float64MultiArray) -> Gait:
    """Return the gait that a message holds. A message without layout is read as rows of four.

    Raises:
        ValueError: The layout does not fit the data, or a value is refused.
    """
    data = np.asarray(message.data, dtype=float)
    sizes = [dim.size for dim in message.layout.dim]
    columns = len(COLUMNS)
    if message.layout.data_offset:
        msg = f"gait has data_offset {message.layout.data_offset}: send it without offset"
        raise ValueError(msg)
    if data.size == 0 or data.size % columns:
        msg = f"gait has {data.size} values: send rows of {columns} ({', '.join(COLUMNS)}), one a driven joint"
        raise ValueError(msg)
    if sizes and sizes != [data.size // columns, columns]:
        msg = f"gait's layout {sizes} does not fit its {data.size} values: needed is [joints, {columns}]"
        raise ValueError(msg)
    return Gait.from_rows(data.reshape(-1, columns))


_LEVELS = {
    State.READY: DiagnosticStatus.OK,
    State.SWIMMING: DiagnosticStatus.OK,
    State.WAITING_FOR_FIN: DiagnosticStatus.WARN,
    State.WAITING_FOR_RESET: DiagnosticStatus.WARN,
    State.FAULT: DiagnosticStatus.ERROR,
}


def key_values(values: Mapping[str, object]) -> list[KeyValue]:
    """Return a mapping as the key-values of a diagnostic message; numbers keep all their digits."""
    return [KeyValue(key=key, value=as_text(value)) for key, value in values.items()]


def as_text(value: object) -> str:
    """Return a value as messages tell it: a text as it is, a number with all its digits."""
    return value if isinstance(value, str) else repr(value)


def plant_state_message(plant_state: PlantState) -> DiagnosticStatus:
    """Return the message of a plant's state."""
    values = {
        "stamp_ns": plant_state.stamp,
        "reason": plant_state.reason,
        **plant_state.fin,
        **plant_state.details,
    }
    return DiagnosticStatus(
        level=_LEVELS[plant_state.state],
        name="plant_state",
        message=plant_state.state.value,
        hardware_id=plant_state.plant,
        values=key_values(values),
    )


def plant_state_from_message(message: DiagnosticStatus) -> PlantState:
    """Return the plant's state that a message holds.

    Raises:
        ValueError: The message is not a plant's state.
    """
    values = {item.key: item.value for item in message.values}
    try:
        state, stamp = State(message.message), int(values.pop("stamp_ns"))
    except (KeyError, ValueError) as error:
        msg = f"plant_state says {message.message!r} with keys {sorted(values)}: needed is one of {list(State)}"
        raise ValueError(msg) from error
    reason = values.pop("reason", "")
    fin = {key: value for key, value in values.items() if key.startswith("fin.")}
    details = {key: value for key, value in values.items() if not key.startswith("fin.")}
    return PlantState(state, message.hardware_id, stamp, reason, fin, details)
