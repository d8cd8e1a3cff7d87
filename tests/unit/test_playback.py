"""When the messages of a bag are played: known positions, no waiting for years, and a clock that never goes back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_optimizer.bags.messages import header_stamp, shift_header
from fin_optimizer.player.playback import LONGEST_SILENCE, STEP, Playback
from support.bags import SECOND, START, velocity

HOUR = 3600 * SECOND


def played(*stamps: int) -> Playback:
    return Playback([("/a", stamp, b"") for stamp in stamps])


def test_messages_keep_their_distances_whatever_the_order_of_their_recording() -> None:
    playback = played(START + SECOND, START, START + 3 * SECOND)
    assert [playback.position(number) for number in range(3)] == [0, SECOND, 3 * SECOND]
    assert (playback.length, playback.jumps) == (3 * SECOND, [])
    assert [playback.first_at(position) for position in (0, 1, SECOND, 4 * SECOND)] == [0, 1, 1, 3]
    assert playback.clock(2 * SECOND) == START + 2 * SECOND
    assert playback.round_length(SECOND) == 2 * SECOND + STEP


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        ((0, START, START + SECOND), "53.9 years without a message after 0.0 s"),
        ((START, START + SECOND, START + 25 * HOUR), "1.0 days without a message after 1.0 s"),
        ((START + HOUR, START, START + SECOND), "60.0 min without a message after 1.0 s"),
    ],
)
def test_a_message_far_from_the_others_costs_no_time(stamps: tuple[int, ...], said: str) -> None:
    playback = played(*stamps)
    assert playback.length == SECOND + STEP
    assert [str(jump) for jump in playback.jumps] == [said]


def test_a_silence_that_a_person_would_wait_for_is_kept() -> None:
    assert played(START, START + LONGEST_SILENCE).length == LONGEST_SILENCE
    assert played(START, START + LONGEST_SILENCE + 1).length == STEP


def test_nothing_has_no_length() -> None:
    assert (played().length, played().clock(0), played().first_at(0)) == (0, 0, 0)


@given(st.lists(st.integers(0, 2**63), min_size=1, max_size=20), st.lists(st.floats(0, 1), min_size=2, max_size=20))
def test_the_clock_rises_and_is_never_behind_what_was_played(stamps: list[int], parts: list[float]) -> None:
    playback = played(*stamps)
    positions = sorted(round(part * playback.length) for part in parts)
    clocks = [playback.clock(position) for position in positions]
    assert clocks == sorted(clocks)
    for position, clock in zip(positions, clocks, strict=True):
        due = [stamp for number, (stamp, *_) in enumerate(playback.messages) if playback.position(number) <= position]
        assert max(due) <= clock
    assert playback.clock(playback.length) < playback.clock(0) + playback.round_length(0)


def test_a_header_is_moved_and_nothing_else() -> None:
    before = velocity(START + 999_999_999, 0.25)
    assert shift_header(before, 2) == velocity(START + SECOND + 1, 0.25)
    assert header_stamp(shift_header(before, HOUR)) == START + 999_999_999 + HOUR
