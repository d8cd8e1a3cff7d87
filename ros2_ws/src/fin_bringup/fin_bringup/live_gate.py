"""A door before the live server that opens only to who knows a token: for a computer that others can reach."""

from __future__ import annotations

import asyncio
import hmac
import threading
from contextlib import suppress
from typing import Self
from urllib.parse import parse_qs, urlsplit

_LONGEST_HEAD = 16 * 1024
"""Bytes of a request's head; a browser's has some hundred."""
_PATIENCE = 10.0
"""s in which a caller must have said what it wants."""
_REFUSED = b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class Gate:
    """Listens at an address and passes on, byte for byte, the connections whose request carries the token.

    A context manager. The request is ``GET /?token=TOKEN``, the opening of a WebSocket.

    Args:
        host: Address to listen at.
        port: Port there, 0 for any that is free.
        inner: Port of the server behind it, at 127.0.0.1.
        token: What a caller has to know.

    Raises:
        OSError: The address cannot be listened at.
    """

    def __init__(self, host: str, port: int, inner: int, token: str) -> None:
        self._inner, self._token = inner, token
        self._loop = asyncio.new_event_loop()
        try:
            self._server = self._loop.run_until_complete(
                asyncio.start_server(self._connected, host, port, limit=_LONGEST_HEAD)
            )
        except OSError:
            self._loop.close()
            raise
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, name="live gate", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Listen no more, and end every connection."""
        if self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        inner: asyncio.StreamWriter | None = None
        try:
            async with asyncio.timeout(_PATIENCE):
                head = await reader.readuntil(b"\r\n\r\n")
            if not self._knows(head):
                writer.write(_REFUSED)
                await writer.drain()
                return
            answers, inner = await asyncio.open_connection("127.0.0.1", self._inner)
            inner.write(head)
            async with asyncio.TaskGroup() as both:
                both.create_task(_pass_on(reader, inner))
                both.create_task(_pass_on(answers, writer))
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # whoever it was is gone, or says nothing that is understood
        finally:
            for end in (writer, inner):
                if end is not None:
                    with suppress(OSError):
                        end.close()

    def _knows(self, head: bytes) -> bool:
        words = head.split(b"\r\n", 1)[0].decode("latin-1").split(" ")
        given = parse_qs(urlsplit(words[1]).query).get("token", [""]) if len(words) > 1 else [""]
        return hmac.compare_digest(given[0].encode(), self._token.encode())


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(OSError):
        while data := await reader.read(64 * 1024):
            writer.write(data)
            await writer.drain()
    writer.close()
