"""What the driver's diagnostics say: the worst thing first, and nothing that is not known."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fin_servo_driver.diagnosis import ERROR, OK, WARN, describe
from fin_servo_driver.health import Health
from fin_servo_driver.tail import Phase

WELL = Health(phase=Phase.FOLLOWING, identity="a board", ticks=50)


def said(health: Health, *, watchdog_off: bool = False) -> tuple[int, str]:
    level, text, _ = describe(health, [], rated_operations=1000, watchdog_off=watchdog_off)
    return level, text


def test_a_device_that_is_well_says_what_the_tail_does() -> None:
    assert said(WELL) == (OK, "following the gait")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"operations": {1: 1000, 2: 1001}}, "relay 2 is beyond its rated 1000 operations: replace it"),
        ({"temperature": 65.0}, "a servo has 65 degrees Celsius: let it cool"),
        ({"fault": "id 1: overload"}, "id 1: overload"),
        ({"refusal": "joint 1 stands at 3000"}, "joint 1 stands at 3000"),
    ],
)
def test_what_should_be_looked_after_is_a_warning(change: dict[str, object], text: str) -> None:
    assert said(replace(WELL, **change)) == (WARN, text)  # type: ignore[arg-type]


def test_a_watchdog_that_is_off_is_warned_of_all_the_time() -> None:
    assert said(WELL, watchdog_off=True) == (WARN, "the command watchdog is off: stay at the power switch")


def test_a_lost_device_outweighs_everything() -> None:
    lost = replace(WELL, connected=False, reason="the cable is out", fault="hot", temperature=80.0)
    assert said(lost, watchdog_off=True) == (ERROR, "the cable is out")


def test_values_that_are_not_reported_are_said_to_be_so_and_lateness_is_of_the_last_second() -> None:
    latenesses = [0.0] * 98 + [0.001, 0.003]
    _, _, values = describe(replace(WELL, operations={3: 7}), latenesses, rated_operations=1, watchdog_off=False)
    assert (values["voltage"], values["temperature"]) == ("not reported", "not reported")
    assert (values["lateness_p50_ms"], values["lateness_max_ms"]) == (0.0, 3.0)
    assert values["relay_3_operations"] == 7
    assert values["armed"] is True
    assert describe(WELL, [], rated_operations=1, watchdog_off=False)[2]["lateness_max_ms"] == 0.0
