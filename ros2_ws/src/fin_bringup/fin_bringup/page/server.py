"""Serves the page: three files over HTTP, and a WebSocket for each page that is open.

A page that is slow gets the newest of each kind and misses what lies between.
"""

from __future__ import annotations

import asyncio
import json
import socket
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from aiohttp import WSMsgType, web

from fin_bringup.page.board import as_json

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from fin_bringup.page.access import Access

    Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

STATIC = Path(__file__).with_name("static")
_FILES = {
    "/": ("index.html", "text/html"),
    "/page.js": ("page.js", "text/javascript"),
    "/page.css": ("page.css", "text/css"),
}
_LARGEST_MESSAGE = 4096
_MOST_KEYS = 16
_MOST_PAGES = 16
_LATEST = 86_400
"""s for which a page may say that it had no connection."""
_PING = 2.0
"""s between two questions to a page whether it is still there."""
_HEADERS = {
    # Nothing of elsewhere, nobody's frame around it (a button under somebody's finger), nothing kept by the browser.
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Graph(Protocol):
    """What a server asks of the page's end of the graph: methods to be called in its thread by `submit`."""

    def submit(self, act: Callable[..., object], *arguments: object) -> None:
        """Have one of the others called in the graph's thread."""

    def join(self, viewer: int) -> None:
        """A page is there."""

    def leave(self, viewer: int) -> None:
        """It is gone."""

    def looks(self, viewer: int, look: bool) -> None:
        """Somebody looks at it, or nobody."""

    def sees(self, viewer: int, keys: list[str]) -> None:
        """It shows these buttons."""

    def press(self, viewer: int, address: str, key: str) -> None:
        """One of them was pressed."""

    def stop(self, address: str, late: int) -> None:
        """The emergency stop was pressed, so many s ago where there was no connection then."""


@dataclass
class _Viewer:
    """A page and what is yet to be told to it, the newest of each kind."""

    number: int
    address: str
    socket: web.WebSocketResponse
    waiting: dict[str, str] = field(default_factory=dict)
    something: asyncio.Event = field(default_factory=asyncio.Event)

    def put(self, kind: str, text: str) -> None:
        self.waiting[kind] = text
        self.something.set()

    async def send(self) -> None:
        """Send what is told, as fast as the page takes it."""
        with suppress(ConnectionError):
            while not self.socket.closed:
                await self.something.wait()
                self.something.clear()
                texts, self.waiting = list(self.waiting.values()), {}
                for text in texts:
                    await self.socket.send_str(text)


class Server:
    """The pages that are open, and the way from and to the graph."""

    def __init__(self, graph: Graph, access: Access, session: str, port: int) -> None:
        """Serve nobody yet.

        Args:
            graph: Whom pages see, and who acts for them.
            access: Who may.
            session: Stands for this server; a page of an earlier one loads itself anew.
            port: It listens at; part of the cookie's name, since browsers tell ports of a host not apart.
        """
        self._graph, self._access, self._session = graph, access, session
        self._cookie = f"fin_page_{port}"
        self._viewers: dict[int, _Viewer] = {}
        self._count = 0

    def application(self) -> web.Application:
        """Return the application."""
        application = web.Application(middlewares=[self._guarded])
        application.router.add_get("/socket", self._serve_socket)
        for path in _FILES:
            application.router.add_get(path, self._serve_file)
        application.on_shutdown.append(self._close)
        return application

    async def _close(self, _: web.Application) -> None:
        for viewer in list(self._viewers.values()):
            await viewer.socket.close(code=1001, message=b"the page's server ends")

    # -- who may -----------------------------------------------------------------------------------------------------

    @property
    def _guarded(self) -> Any:
        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            response: web.StreamResponse
            try:
                response = self._refused(request) or await handler(request)
            except web.HTTPException as error:
                response = web.Response(status=error.status, text=f"{error.reason}\n")
            if not response.prepared:
                response.headers.update(_HEADERS)
            return response

        return guard

    def _refused(self, request: web.Request) -> web.Response | None:
        if refusal := self._access.host_refusal(request.host):
            return web.Response(status=403, text=f"{refusal}\n")
        given = request.query.get("token", "")
        if self._access.knows(given) or self._access.knows(request.cookies.get(self._cookie, "")):
            return None
        wrong = "its token is wrong, or of an earlier start" if given else "it needs a token"
        said = f"This page is not for everybody: {wrong}.\nOpen the address that `page` has printed.\n"
        return web.Response(status=403, text=said)

    # -- requests ----------------------------------------------------------------------------------------------------

    async def _serve_file(self, request: web.Request) -> web.StreamResponse:
        name, kind = _FILES[request.path]
        response = web.Response(text=(STATIC / name).read_text("utf-8"), content_type=kind, charset="utf-8")
        given = request.query.get("token", "")
        if self._access.token and self._access.knows(given):
            response.set_cookie(self._cookie, given, httponly=True, samesite="Strict", path="/")
        return response

    async def _serve_socket(self, request: web.Request) -> web.StreamResponse:
        if refusal := self._access.origin_refusal(request.headers.get("Origin", ""), request.host):
            return web.Response(status=403, text=f"{refusal}\n")
        if len(self._viewers) >= _MOST_PAGES:
            return web.Response(status=503, text=f"{_MOST_PAGES} pages are open: close one\n")
        page = web.WebSocketResponse(heartbeat=_PING, max_msg_size=_LARGEST_MESSAGE)
        await page.prepare(request)
        self._count += 1
        viewer = _Viewer(self._count, request.remote or "unknown", page)
        self._viewers[viewer.number] = viewer
        sender = asyncio.create_task(viewer.send())
        viewer.put("hello", as_json({"kind": "hello", "session": self._session, "you": viewer.number}))
        self._graph.submit(self._graph.join, viewer.number)
        self._tell_pages()
        try:
            await self._listen(viewer)
        finally:
            del self._viewers[viewer.number]
            self._graph.submit(self._graph.leave, viewer.number)
            self._tell_pages()
            sender.cancel()
            with suppress(asyncio.CancelledError):
                await sender
        return page

    async def _listen(self, viewer: _Viewer) -> None:
        async for message in viewer.socket:
            if message.type is not WSMsgType.TEXT:
                continue
            refusal = self._act(viewer, message.data)
            if refusal:
                viewer.put("answer", as_json({"kind": "answer", "text": refusal, "good": False}))

    def _act(self, viewer: _Viewer, text: str) -> str:
        """Pass on what a page says; return what is wrong with it, or an empty text."""
        try:
            said = json.loads(text)
        except ValueError:
            said = None
        match said:
            case {"do": "stop"}:  # whatever else is said with it
                late = said.get("late")
                known = isinstance(late, int) and 0 < late <= _LATEST
                self._graph.submit(self._graph.stop, viewer.address, late if known else 0)
            case {"do": "press", "key": str(key)}:
                self._graph.submit(self._graph.press, viewer.number, viewer.address, key)
            case {"do": "see", "keys": [*keys]} if len(keys) <= _MOST_KEYS and all(isinstance(k, str) for k in keys):
                self._graph.submit(self._graph.sees, viewer.number, keys)
            case {"do": "look", "on": bool(on)}:
                self._graph.submit(self._graph.looks, viewer.number, on)
            case _:
                return "this page says what the server does not know: load it again"
        return ""

    # -- what pages are told -----------------------------------------------------------------------------------------

    def tell(self, told: Mapping[str, Any]) -> None:
        """Tell all pages, or the one named in ``to``; called in the loop's thread."""
        kind, to = str(told["kind"]), told.get("to")
        text = as_json(told)
        for viewer in list(self._viewers.values()):
            if to in {None, viewer.number}:
                viewer.put(kind, text)

    def _tell_pages(self) -> None:
        pages = [{"number": viewer.number, "address": viewer.address} for viewer in self._viewers.values()]
        self.tell({"kind": "pages", "pages": pages})


def listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens; ``localhost`` is 127.0.0.1 alone, so that port 0 is one port.

    Raises:
        OSError: The address cannot be listened at.
    """
    here = "127.0.0.1" if host == "localhost" else host
    family = socket.AF_INET6 if ":" in here else socket.AF_INET
    return socket.create_server((here, port), family=family)
