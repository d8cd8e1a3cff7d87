"""Ctrl-C while a block that must not be broken off is under way."""

from __future__ import annotations

import contextlib
import ctypes
import signal
import subprocess
import sys
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING

import pytest

from fin_plant import start as start_module
from fin_plant.command import EXIT_INTERRUPTED, command
from fin_plant.start import interrupt_held_back, interrupts, start
from fin_plant.sub_commands import GROUP
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path


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


OTHER_VERSION = "is not installed as this version has it: run make setup"


def test_an_executable_of_another_version_is_one_sentence_with_what_to_do() -> None:
    with pytest.raises(SystemExit, match=f"no_such: error: fin_sim no_such {OTHER_VERSION}"):
        start("/install/fin_sim/lib/fin_sim/no_such")


@pytest.mark.parametrize("moved", ["fin_sim.no_such:main", "no_such_package.swim:main", "fin_sim.swim_command:main"])
def test_an_executable_whose_code_has_moved_is_the_same_sentence(monkeypatch: pytest.MonkeyPatch, moved: str) -> None:
    entry = EntryPoint("swim", moved, GROUP)
    monkeypatch.setattr("fin_plant.sub_commands.executables", lambda _package: {"swim": entry})
    with pytest.raises(SystemExit, match=f"swim: error: fin_sim swim {OTHER_VERSION}"):
        start("/install/fin_sim/lib/fin_sim/swim")


def test_a_library_that_an_executable_needs_and_is_not_there_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "needs_more.py").write_text("import no_such_library\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    entry = EntryPoint("swim", "needs_more:main", GROUP)
    monkeypatch.setattr("fin_plant.sub_commands.executables", lambda _package: {"swim": entry})
    with pytest.raises(ModuleNotFoundError, match="no_such_library"):
        start("/install/fin_sim/lib/fin_sim/swim")


@pytest.fixture
def listening(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Ctrl-C as it is while an executable runs, in this process, which goes on after it."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGALRM)}
    monkeypatch.setattr("sys.unraisablehook", start_module._say_unless_interrupt)
    with interrupts():
        yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for number, handler in before.items():
        signal.signal(number, handler)


class _InterruptedWhenAsked:
    @property
    def anything(self) -> None:
        signal.raise_signal(signal.SIGINT)


class _InterruptedWhenLetGo:
    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


def _errors_cleared() -> None:
    """Ask as C code does that wants no errors: whether there is such an attribute."""
    ctypes.pythonapi.PyObject_HasAttrString(ctypes.py_object(_InterruptedWhenAsked()), b"anything")


def _taken_by_a_library() -> None:
    with contextlib.suppress(BaseException):
        signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("listening")
@pytest.mark.parametrize("lose", [_errors_cleared, _InterruptedWhenLetGo, _taken_by_a_library])
def test_an_interrupt_that_a_library_loses_comes_again(
    lose: Callable[[], object], capfd: pytest.CaptureFixture[str]
) -> None:
    lost = []

    def work() -> None:
        lose()
        lost.append(True)
        wait_until(lambda: False, 30.0, "the interrupt to come again")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert lost == [True]
    assert capfd.readouterr().err == ""


@pytest.mark.usefixtures("listening")
def test_an_interrupt_that_a_command_takes_does_not_come_again() -> None:
    @command("work", when_output_closes=None)
    def work(arguments: Sequence[str] | None = None) -> int:
        signal.raise_signal(signal.SIGINT)
        return 0

    assert work([]) == EXIT_INTERRUPTED
    until_next, _ = signal.getitimer(signal.ITIMER_REAL)
    assert until_next == 0.0 or until_next > 1.0  # a test's time limit is such a timer too


@pytest.mark.usefixtures("listening")
def test_an_interrupt_that_is_on_its_way_tidies_up_what_it_passes() -> None:
    tidied = []

    @command("work", when_output_closes=None)
    def work(arguments: Sequence[str] | None = None) -> int:
        try:
            _errors_cleared()
            wait_until(lambda: False, 30.0, "the interrupt to come again")
        finally:
            tidied.append(True)
        return 0

    assert work([]) == EXIT_INTERRUPTED
    assert tidied == [True]


def test_an_interrupt_of_a_programs_own_handler_that_is_lost_ends_the_process() -> None:
    words = """
from fin_plant import start

class Lost:
    def __del__(self):
        raise KeyboardInterrupt

start._listen()
with start.interrupts():
    Lost()
"""
    done = subprocess.run([sys.executable, "-c", words], check=False, capture_output=True)
    assert (done.returncode, done.stderr) == (130, b"")
