"""The terminal program for the person at the tank: what the robot waits for, and the keys to answer with.

The space bar stops the robot at any time. Nothing is confirmed by itself.
"""

from __future__ import annotations

import argparse
import os
import select
import sys
import termios
import tty
from contextlib import contextmanager
from typing import TYPE_CHECKING

import rclpy
from rich.console import Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from fin_plant import node_process, topics
from fin_plant.plant_state import PlantState, State
from fin_servo_driver.driver_client import DriverClient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from rich.console import RenderableType

_STYLES = {
    State.READY: "bold green",
    State.SWIMMING: "bold cyan",
    State.WAITING_FOR_FIN: "bold yellow",
    State.WAITING_FOR_RESET: "bold yellow",
    State.FAULT: "bold white on red",
}
_SHOWN = ("connected", "identity", "reconnects", "missed_ticks", "lateness_p99_ms", "voltage", "temperature", "fault")
_LOOK = 0.1
_WAITING = {
    "configuring": ("Press Enter to open the port and check the device. Nothing moves by that.", "configure"),
    "fin": ("Mount this fin. When it is on and nobody's hands are near the tail, press Enter.", "confirm_fin"),
    "arming": ("Hands off the tail. Press Enter to ARM the driver: from then on a gait moves it.", "activate"),
    "mark": ("Bring the fish back to its mark and let the water settle. Then press Enter.", "reset"),
}
"""What to do, and what Enter then asks for, by what the driver waits for."""
_FAULTS = (
    ("emergency stop", ("Stopped. When all is safe, press r to release the emergency stop.", "")),
    ("", ("Check cable and power; the driver reconnects by itself.", "")),
)
"""The same by a part of the fault's reason; the last one fits every reason."""


def next_step(state: PlantState | None) -> tuple[str, str]:
    """Return what the operator should do now, and what Enter stands for: the name of an action, or an empty text."""
    if state is None:
        return "Waiting for the servo driver. Start it with plant:=robot.", ""
    if state.state is State.FAULT:
        return next(step for cause, step in _FAULTS if cause in state.reason)
    return _WAITING.get(state.details.get("waiting_for", ""), ("Nothing to do. The space bar stops the robot.", ""))


def screen(state: PlantState | None, device: dict[str, str], answer: str) -> RenderableType:
    """Return what is shown."""
    advice, _ = next_step(state)
    title = Text(state.state.value if state else "NO DRIVER", style=_STYLES[state.state] if state else "bold red")
    parts: list[RenderableType] = [title]
    if state is not None and state.details.get("waiting_for") == "fin":
        parts.append(_fin_table(state.reason))
    elif state is not None and state.reason:
        parts.append(Text(state.reason))
    parts += [Text(), Text(advice, style="bold"), Text(answer, style="italic")]
    if device:
        table = Table.grid(padding=(0, 2))
        for name in _SHOWN:
            table.add_row(name, device.get(name, ""))
        parts += [Text(), table]
    keys = "[Enter] do it   [space] EMERGENCY STOP   [r] release   [d] disarm   [q] quit"
    return Panel(Group(*parts), title="servo driver", subtitle=Text(keys))


def _fin_table(reason: str) -> Table:
    """Return the fin of ``mount the fin: name value, name value`` as a table."""
    table = Table(title="Fin to mount", show_header=False)
    for item in reason.partition(": ")[2].split(", "):
        name, _, value = item.partition(" ")
        table.add_row(name, Text(value, style="bold"))
    return table


@contextmanager
def keys() -> Iterator[Callable[[float], str]]:
    """Yield a function that returns the key pressed within so many s, or an empty text."""
    descriptor = sys.stdin.fileno()
    saved = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)

    def pressed(seconds: float) -> str:
        ready, _, _ = select.select([descriptor], [], [], seconds)
        return os.read(descriptor, 1).decode(errors="replace") if ready else ""

    try:
        yield pressed
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, saved)


def act(client: DriverClient, key: str) -> str:
    """Do what a key stands for; return the driver's answer."""
    if key == " ":
        return client.emergency_stop(on=True)
    if key == "r":
        return client.emergency_stop(on=False)
    if key == "d":
        return client.change_state("deactivate")
    if key in {"\r", "\n"}:
        _, action = next_step(client.state)
        if action in {"configure", "activate"}:
            return client.change_state(action)
        return client.trigger(action) if action else "nothing to confirm"
    return ""


def run(client: DriverClient) -> int:
    """Show and ask until q is pressed."""
    answer = ""
    with keys() as pressed, Live(auto_refresh=False, screen=True) as live:
        while True:
            client.spin(_LOOK)
            live.update(screen(client.state, client.device, answer), refresh=True)
            key = pressed(0.0)
            if key == "q":
                return 0
            if key:
                answer = act(client, key)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(prog="operator", description=__doc__)
    parser.add_argument("--namespace", default=topics.NAMESPACE, help="of the fish (default: %(default)s)")
    given = parser.parse_args(arguments)
    if not sys.stdin.isatty():
        print("error: operator reads keys: run it in a terminal", file=sys.stderr)  # noqa: T201
        return node_process.EXIT_USAGE
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(node_process.FAST_DDS_PROFILE))
    rclpy.init()
    client = DriverClient(namespace=given.namespace)
    try:
        return run(client)
    except KeyboardInterrupt:
        return 128 + 2
    finally:
        client.close()


if __name__ == "__main__":
    sys.exit(main())
