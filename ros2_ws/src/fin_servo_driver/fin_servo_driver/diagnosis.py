"""What the driver's diagnostics say, from what it has counted. Nothing here knows ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_servo_driver.tail import Phase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_servo_driver.health import Health

OK, WARN, ERROR = 0, 1, 2
"""Levels, as diagnostic_msgs numbers them."""
_HOT = 65.0
_MILLISECONDS = 1e3


@dataclass
class Counters:
    """What happened to the gaits that came.

    Attributes:
        refused: Gaits that were not followed.
        clamped: Gaits that were followed inside a limit.
        last_refusal: Why the last one was refused.
        refused_since: Gaits that were refused since the last one that was followed, as long as the tail followed it.
        refusal_since: Why the last of these was.
    """

    refused: int = 0
    clamped: int = 0
    last_refusal: str = ""
    refused_since: int = 0
    refusal_since: str = ""

    def refuse(self, reason: str, *, follows: bool = False) -> None:
        """Note a refused gait, and whether the tail still follows another one."""
        self.refused += 1
        if follows:
            self.refused_since += 1
            self.refusal_since = reason
        self.last_refusal = reason

    def follow(self) -> None:
        """Note a gait that is followed."""
        self.refused_since = 0

    def clamp(self, *, changed: bool) -> None:
        """Note whether a limit has changed a gait."""
        self.clamped += changed

    def values(self) -> dict[str, object]:
        """Return the counts by name, as the simulator names them where it has them."""
        return {"gaits_refused": self.refused, "gaits_limited": self.clamped, "last_refusal": self.last_refusal}


def describe(
    health: Health, latenesses: Sequence[float], *, rated_operations: int, watchdog_off: bool
) -> tuple[int, str, dict[str, object]]:
    """Return level, text and values of the device's diagnostics.

    Args:
        health: What the I/O thread has seen.
        latenesses: How late in s the ticks since the last call were.
        rated_operations: Of a relay, after which it warns.
        watchdog_off: Whether the command watchdog was switched off.
    """
    level, text = OK, health.phase.value
    worn = [channel for channel, count in health.operations.items() if count > rated_operations]
    if watchdog_off:
        level, text = WARN, "the command watchdog is off: stay at the power switch"
    if worn:
        level, text = WARN, f"relay {worn[0]} is beyond its rated {rated_operations} operations: replace it"
    if health.temperature is not None and health.temperature >= _HOT:
        level, text = WARN, f"a servo has {health.temperature:g} degrees Celsius: let it cool"
    if health.fault or health.refusal:
        level, text = WARN, health.fault or health.refusal
    if not health.connected:
        level, text = ERROR, health.reason
    p50, p99, largest = np.percentile(latenesses or [0.0], [50.0, 99.0, 100.0])
    values: dict[str, object] = {
        "connected": health.connected,
        "identity": health.identity,
        "phase": health.phase.value,
        "armed": health.phase is not Phase.DISARMED,
        "reconnects": health.reconnects,
        "set_points_sent": health.ticks,
        "missed_ticks": health.missed,
        "dropped_set_points": health.dropped,
        "limited_set_points": health.limited,
        "command_timeouts": health.timeouts,
        "lateness_p50_ms": round(float(p50) * _MILLISECONDS, 3),
        "lateness_p99_ms": round(float(p99) * _MILLISECONDS, 3),
        "lateness_max_ms": round(float(largest) * _MILLISECONDS, 3),
        "voltage": "not reported" if health.voltage is None else health.voltage,
        "temperature": "not reported" if health.temperature is None else health.temperature,
        "fault": health.fault,
    }
    values |= {f"relay_{channel}_operations": count for channel, count in health.operations.items()}
    return level, text, values
