"""A browser's end of the page at the tank for tests: a WebSocket, and what came on it."""

from __future__ import annotations

import asyncio
import json
import re
import time
from typing import TYPE_CHECKING, Any, Self

import aiohttp

from support.waiting import PATIENCE

if TYPE_CHECKING:
    from collections.abc import Callable

    from support.processes import StartedProcess

_ADDRESS = re.compile(r"page: (http://\S+)")


def address_of(page: StartedProcess) -> str:
    """Return the address that the process has printed, its token included."""
    page.wait_for_output("until Ctrl-C")
    found = _ADDRESS.search(page.output())
    assert found is not None, page.output()
    return found[1]


class PageClient:
    """A page that is open; an asynchronous context manager."""

    def __init__(self, address: str, origin: str | None = None) -> None:
        base, _, token = address.partition("/?token=")
        self._base, self._token = base, token
        self._origin = base if origin is None else origin
        self._session = aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True))
        self._reader: asyncio.Task[None] | None = None
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._came = asyncio.Event()
        self.newest: dict[str, Any] = {}
        self.counts: dict[str, int] = {}

    async def __aenter__(self) -> Self:
        try:
            await self._open()
        except BaseException:
            await self._session.close()
            raise
        return self

    async def _open(self) -> None:
        if self._token:
            async with self._session.get(f"{self._base}/?token={self._token}") as answer:
                assert answer.status == 200
        self._socket = await self._session.ws_connect(f"{self._base}/socket", headers={"Origin": self._origin})
        self._reader = asyncio.create_task(self._read(self._socket))
        await self.until(lambda: "hello" in self.newest, "a greeting")

    async def __aexit__(self, *_: object) -> None:
        if self._socket is not None:
            await self._socket.close()
        if self._reader is not None:
            await self._reader
        await self._session.close()

    async def _read(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        async for message in socket:
            told = json.loads(message.data)
            self.newest[told["kind"]] = told
            self.counts[told["kind"]] = self.counts.get(told["kind"], 0) + 1
            if told["kind"] == "snapshot":
                await self.send(do="see", keys=[offer["key"] for offer in told["offers"]])
            self._came.set()
        self._came.set()

    @property
    def closed(self) -> bool:
        """Whether the server has closed the socket."""
        return self._socket is None or self._socket.closed

    async def send(self, **message: object) -> None:
        """Say something, as the page's script does."""
        if self._socket is not None and not self._socket.closed:
            await self._socket.send_json(message)

    async def until(self, condition: Callable[[], object], what: str) -> None:
        """Wait until the condition holds of what came."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert not self.closed or "hello" not in self.newest, f"the socket was closed before {what}"
            self._came.clear()
            left = end - time.monotonic()
            assert left > 0.0, f"still waiting for {what}; newest: {self.newest}"
            try:
                await asyncio.wait_for(self._came.wait(), min(left, 0.1))
            except TimeoutError:
                continue

    @property
    def snapshot(self) -> dict[str, Any]:
        """What was told last, but for pictures."""
        told: dict[str, Any] = self.newest.get(
            "snapshot", {"offers": [], "events": [], "plant": {}, "study": {}, "trial": {}}
        )
        return told

    def offer(self, action: str) -> dict[str, Any] | None:
        """Return the button with this action, None where there is none."""
        return next((offer for offer in self.snapshot["offers"] if offer["action"] == action), None)

    def _times_of(self, text: str) -> list[str]:
        return [event["time"] for event in self.snapshot["events"] if event["text"] == text]

    def _followed_by(self, text: str) -> str:
        """Return what was told right after the newest event with this text, empty where nothing was."""
        told = [event["text"] for event in self.snapshot["events"]]
        return next(iter(told[len(told) - told[::-1].index(text) :]), "") if text in told else ""

    async def press(self, action: str) -> str:
        """Press a button once it may be pressed, as a person does, who waits for what came of it; return its key."""
        while True:
            await self.until(lambda: self.offer(action), f"a button for {action}")
            offer = self.offer(action)
            if offer is None:
                continue
            text = f"pressed: {offer['label']}"
            before = self._times_of(text)
            self.newest.pop("answer", None)
            await self.send(do="press", key=offer["key"])

            def answered(text: str = text, before: list[str] = before) -> object:
                return "answer" in self.newest or (self._times_of(text) != before and self._followed_by(text))

            await self.until(answered, f"what came of {action}")
            refusal = self.newest.get("answer", {}).get("text", "")
            if "has not answered yet" in self._followed_by(text):  # to what was pressed before
                continue
            if "new step" not in refusal and "asked no more" not in refusal:
                return str(offer["key"])
