"""The lateness of the servo driver as a row of a table; how it is measured is tested in the graph tests."""

from __future__ import annotations

import pytest

from fin_bringup.benchmarks import lateness


def second(p50: float, p99: float, largest: float, *, missed: int, sent: int) -> dict[str, str]:
    counts = {"missed_ticks": str(missed), "set_points_sent": str(sent)}
    return {"lateness_p50_ms": str(p50), "lateness_p99_ms": str(p99), "lateness_max_ms": str(largest), **counts}


def test_seconds_make_a_row_of_their_medians_their_largest_and_their_counts() -> None:
    seconds = [
        second(0.1, 1.0, 2.0, missed=3, sent=1000),
        second(0.3, 9.0, 20.0, missed=4, sent=1049),
        second(0.2, 1.5, 3.0, missed=4, sent=1099),
    ]
    found = lateness.summarise("firmata", seconds, 0.094, -10)
    assert found.row() == "| firmata | 0.20 | 1.50 | 20.00 | 1 of 100 | 9 % of a core | -10 |\n"


def test_too_short_a_swim_gives_no_figures() -> None:
    with pytest.raises(RuntimeError, match="1 s of swimming are too few"):
        lateness.summarise("firmata", [second(0.1, 1.0, 2.0, missed=0, sent=50)], 0.1, 0)


@pytest.mark.parametrize("seconds", ["1", "nan", "inf"])
def test_a_time_that_cannot_be_measured_in_is_refused(seconds: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert lateness.main(["--seconds", seconds]) == 2
    assert "must be at least 3" in capsys.readouterr().err
