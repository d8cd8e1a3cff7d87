"""The terminal program for the person at the tank: what the robot waits for, and the keys to answer with.

The space bar stops the robot at any time. Nothing is confirmed by itself, nor by a key that bounces or is stuck: Enter
counts for a step only after the step was on the screen, and Enter at rest, for a second.
"""

from __future__ import annotations

import argparse
import math
import os
import select
import signal
import sys
import termios
import time
import tty
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.columns import Columns
from rich.console import Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from fin_plant import node_process, topics
from fin_plant.command import EXIT_USAGE, tell_error
from fin_plant.plant_state import State
from fin_servo_driver.driver_client import SpunDriverClient
from fin_servo_driver.fin_instruction import sizes, wanted_fin
from fin_servo_driver.next_step import (
    CALM,
    NOTHING_ASKED,
    SILENT,
    SWITCH,
    advice_says_all,
    next_step,
    question,
    too_new,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rich.console import RenderableType

    from fin_plant.fin import Fin
    from fin_plant.plant_state import PlantState
    from fin_servo_driver.driver_client import DriverClient

_STYLES = {
    State.READY: "bold green",
    State.SWIMMING: "bold cyan",
    State.WAITING_FOR_FIN: "bold yellow",
    State.WAITING_FOR_RESET: "bold yellow",
    State.FAULT: "bold white on red",
}
_SHOWN = ("connected", "identity", "reconnects", "missed_ticks", "lateness_p99_ms", "voltage", "temperature", "fault")
_LOOK = 0.05
_LEAVE_SECONDS = 5.0
_KEYS = ("[Enter] do it", "[r] release", "[d] disarm", "[q] quit")
_NO_KEY = f"does nothing; there is {'  '.join(_KEYS)}"
_STOP = "SPACE BAR: EMERGENCY STOP"


def screen(
    state: PlantState | None, device: dict[str, str], answer: str, silence: float = 0.0, seen: str = ""
) -> RenderableType:
    """Return what is shown, the most important first: a small terminal shows no more than its top.

    Args:
        state: What the driver said last.
        device: Values of its device's diagnostics.
        answer: To what was asked last.
        silence: s since the driver's last word.
        seen: What is seen instead of a driver that has not said anything yet.
    """
    if silence > SILENT:
        lost = f"Nothing from the driver for {silence:.0f} s. {SWITCH}"
        return _panel([Text("NO ANSWER", style=_STYLES[State.FAULT]), Text(lost, style="bold"), _answer(answer)])
    advice, _ = next_step(state)
    title = Text(state.state.value if state else "NO DRIVER", style=_STYLES[state.state] if state else "bold red")
    parts: list[RenderableType] = [title]
    if state is not None and state.details.get("waiting_for") == "fin":
        parts.append(_fin_table(wanted_fin(state.details)))
    elif state is not None and state.reason and not advice_says_all(state):
        parts.append(Text(state.reason))
    parts += [Text(advice, style="bold"), _answer(answer)]
    table = Table.grid(padding=(0, 2))
    for name in _SHOWN:
        if device.get(name, "") not in {"", "not reported"}:
            table.add_row(name, device[name])
    return _panel(parts, table, Text(seen if state is None else ""))


def _answer(answer: str) -> Text:
    return Text(answer, style="italic")


def _panel(parts: list[RenderableType], *below: RenderableType) -> Panel:
    keys: list[RenderableType] = [Text(_STOP, style="bold white on red"), Columns(map(Text, _KEYS), padding=(0, 3))]
    return Panel(Group(*parts, Text(), *keys, Text(), *below), title="servo driver")


def _fin_table(fin: Fin) -> Table:
    table = Table(title="Fin to mount", show_header=False)
    for name, value in sizes(fin).items():
        table.add_row(name, Text(value, style="bold"))
    return table


@contextmanager
def keys() -> Iterator[Callable[[], str | None]]:
    """Yield a function that returns what was typed since it was called last; None when the terminal is gone."""
    descriptor = sys.stdin.fileno()
    saved = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)

    def typed() -> str | None:
        ready, _, _ = select.select([descriptor], [], [], 0.0)
        if not ready:
            return ""
        return os.read(descriptor, 1024).decode(errors="replace") or None

    try:
        yield typed
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, saved)


class Keyboard:
    """What keys do. Time is handed in, so that nothing here waits."""

    def __init__(self, client: DriverClient) -> None:
        """Start with nothing asked."""
        self._client = client
        self._step: tuple[str, ...] = ("", "")
        self._step_since = self._last_enter = self._leave_since = -math.inf

    def look(self, now: float) -> None:
        """Note at ``now`` s what the driver waits for, as it is shown from now on."""
        state = self._client.state
        silent = self._client.silence() > SILENT
        step = question(None if silent else state)
        if step != self._step:
            self._step, self._step_since = step, now

    def typed(self, text: str, now: float) -> bool:
        """Do what was typed at ``now`` s stands for; return whether to leave.

        A space anywhere in it stops the robot, and nothing else of it counts. A cursor or function key, which comes as
        several characters, counts as one unknown key.
        """
        if " " in text:
            self._client.emergency_stop(on=True)
            return False
        if text.startswith("\x1b"):
            self._client.answer = f"this key {_NO_KEY}"
            return False
        for key in dict.fromkeys(text.lower().replace("\r", "\n")):
            if key == "q":
                return self._leave(now)
            self._press(key, now)
        return False

    def _press(self, key: str, now: float) -> None:
        if key == "r":
            self._client.emergency_stop(on=False)
        elif key == "d":
            self._client.ask("deactivate")
        elif key == "\n":
            self._enter(now)
        else:
            self._client.answer = f"{key!r} {_NO_KEY}"

    def _enter(self, now: float) -> None:
        bounced = now - self._last_enter < CALM
        self._last_enter = now
        action = self._step[0]
        if bounced:
            return
        if not action:
            self._client.answer = NOTHING_ASKED
        elif refusal := too_new(now - self._step_since):
            self._client.answer = refusal
        else:
            self._client.ask(action)

    def _leave(self, now: float) -> bool:
        """Ask once more where somebody may rely on the space bar."""
        state = self._client.state
        moves = state is not None and state.state in {State.READY, State.SWIMMING}
        if not moves or self._client.silence() > SILENT or now - self._leave_since < _LEAVE_SECONDS:
            return True
        self._leave_since = now
        self._client.answer = "The driver stays armed and the space bar will not stop it: q again leaves, d disarms"
        return False


def run(client: SpunDriverClient, signals: Sequence[int]) -> int:
    """Show and ask until q is pressed, the terminal is gone or a signal has come; return the exit code."""
    keyboard = Keyboard(client)
    look_due, seen = time.monotonic() + CALM, ""
    with keys() as typed, Live(auto_refresh=False, screen=True) as live:
        while not signals:
            client.spin(_LOOK)
            now = time.monotonic()
            if client.state is None and now >= look_due:
                look_due, seen = now + CALM, client.seen()
            live.update(screen(client.state, client.device, client.answer, client.silence(), seen), refresh=True)
            keyboard.look(now)
            text = typed()
            if text is None or (text and keyboard.typed(text, now)):
                return 0
    return 128 + signals[0]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(prog="operator", description=__doc__)
    parser.add_argument("--namespace", default=topics.NAMESPACE, help="of the fish (default: %(default)s)")
    given = parser.parse_args(arguments)
    if not sys.stdin.isatty():
        tell_error("operator", "it reads keys: run it in a terminal")
        return EXIT_USAGE
    # Noted only: an exception out of a signal's handler is lost where it meets one of rclpy's callbacks.
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, lambda came, _frame: signals.append(came))
    with node_process.starting_ros():
        client = SpunDriverClient(namespace=given.namespace)
    try:
        return run(client, signals)
    finally:
        client.close()


if __name__ == "__main__":
    sys.exit(main())
