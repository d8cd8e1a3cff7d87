"""Hands commands from the node to the thread that drives the tail: only the newest counts."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fin_servo_driver.tail import Command


class Mailbox:
    """Holds the newest command; a newer one takes the place of one that was not yet taken."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._command: Command | None = None

    def put(self, command: Command) -> None:
        """Leave a command."""
        with self._lock:
            self._command = command

    def put_back(self, command: Command) -> None:
        """Leave a command that was taken out, unless a newer one has come."""
        with self._lock:
            self._command = self._command or command

    def take(self) -> Command | None:
        """Take the command out, None if there is none."""
        with self._lock:
            command, self._command = self._command, None
        return command
