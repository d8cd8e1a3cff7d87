"""What is seen of a device from tick to tick: how it is, and where its joints are."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fin_servo_driver.tail import Phase

if TYPE_CHECKING:
    from collections.abc import Mapping

ENDED = "the driver's I/O thread has ended"
"""Why a device is not connected that was disabled in order when the driver had done with it."""


@dataclass(frozen=True)
class Sample:
    """Joint angles at one tick.

    Attributes:
        time: s of the monotonic clock.
        angles: rad, from the head to the tail.
        measured: Whether the servos have reported them; otherwise they are what was sent.
    """

    time: float
    angles: tuple[float, ...]
    measured: bool


@dataclass(frozen=True)
class Health:
    """What the thread has seen; a snapshot.

    Attributes:
        connected: Whether the device is there.
        phase: Of the tail.
        still: Whether the tail stands, and nothing moves it of what was commanded by ``commanded``.
        commanded: s of the monotonic clock at which the newest command was received that the tail has been given.
        identity: What the device says of itself.
        reason: Why it is not connected.
        reconnects: How often it came back, from a sleep of the computer too.
        connected_since: s of the monotonic clock.
        ticks: Set-points sent.
        missed: Ticks that were skipped because the thread was late.
        dropped: Set-points not sent because the line was behind or stalled.
        limited: Set-points that a limit has changed.
        timeouts: How often the commander fell silent.
        voltage: V, None where it is not reported.
        temperature: Degrees Celsius, None where it is not reported.
        fault: What the device complains about, or has complained about in the last seconds.
        refusal: Why the tail did not start at the last command, empty since it has.
        operations: Of each relay's channel.
    """

    connected: bool = True
    phase: Phase = Phase.DISARMED
    still: bool = True
    commanded: float = -math.inf
    identity: str = ""
    reason: str = ""
    reconnects: int = 0
    connected_since: float = 0.0
    ticks: int = 0
    missed: int = 0
    dropped: int = 0
    limited: int = 0
    timeouts: int = 0
    voltage: float | None = None
    temperature: float | None = None
    fault: str = ""
    refusal: str = ""
    operations: Mapping[int, int] = field(default_factory=dict)
