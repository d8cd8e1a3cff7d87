"""A network between a browser and a server that can go dead: connections stay open, and nothing gets through."""

from __future__ import annotations

import socket
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


class Network:
    """Passes on what comes at a port of this computer to another port; each direction in a thread of its own."""

    def __init__(self, port: int) -> None:
        self._alive = threading.Event()
        self._alive.set()
        self._to = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._open = [self._listener]
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def port(self) -> int:
        """Where it is reached."""
        return int(self._listener.getsockname()[1])

    def die(self) -> None:
        """Hold back whatever comes from now on, as a network does that is gone: it may come later."""
        self._alive.clear()

    def revive(self) -> None:
        """Pass on what was held back, and all that comes."""
        self._alive.set()

    def close(self) -> None:
        """End all connections."""
        self._alive.set()
        for each in self._open:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._to))
                self._open += [near, far]
                for source, target in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=(source, target), daemon=True).start()

    def _pass_on(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                self._alive.wait()
                target.sendall(data)
            self._alive.wait()
            target.shutdown(socket.SHUT_WR)


@contextmanager
def network(port: int) -> Iterator[Network]:
    """Yield a network to a port of this computer."""
    between = Network(port)
    try:
        yield between
    finally:
        between.close()
