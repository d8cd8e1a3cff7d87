"""Ctrl-C while a block that must not be broken off is under way."""

from __future__ import annotations

import signal

import pytest

from fin_plant.start import interrupt_held_back, start


def test_an_interrupt_waits_for_the_end_of_the_block() -> None:
    reached = []
    before = signal.getsignal(signal.SIGINT)

    def block() -> None:
        with interrupt_held_back():
            signal.raise_signal(signal.SIGINT)
            reached.append("the end of the block")
        reached.append("what comes after it")

    with pytest.raises(KeyboardInterrupt):
        block()
    assert reached == ["the end of the block"]
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    assert signal.getsignal(signal.SIGINT) is before


def test_a_block_without_an_interrupt_ends_as_any_other() -> None:
    with interrupt_held_back():
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_an_executable_of_another_version_is_one_sentence_with_what_to_do() -> None:
    with pytest.raises(
        SystemExit, match="no_such: error: fin_sim no_such is not installed as this version has it: run make setup"
    ):
        start("/install/fin_sim/lib/fin_sim/no_such")
