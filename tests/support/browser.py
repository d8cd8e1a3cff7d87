"""A real headless Chromium, spoken to over its debugging pipe: no driver and no package is needed beside it."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

CHROMIUM = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)
_ANSWER_SECONDS = 300.0
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--disable-extensions"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--remote-debugging-pipe"),
)


class BrowserError(AssertionError):
    """The browser says that something went wrong, or nothing at all."""


class Browser:
    """One tab of a browser.

    Attributes:
        complaints: Errors that the page wrote to its console, threw, or was refused.
        requests: Addresses that the page asked for.
    """

    def __init__(self, process: subprocess.Popen[bytes], to: int, come_from: int) -> None:
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self._process, self._to, self._from = process, to, come_from
        self._rest = b""
        self._number = 0
        self._events: list[dict[str, Any]] = []
        self._session = ""

    def begin(self) -> Self:
        """Open the tab."""
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")
        return self

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the answer to a command of Chromium's DevTools protocol."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + _ANSWER_SECONDS
        while True:
            answer = self._next(end, method)
            if answer.get("id") == self._number:
                if "error" in answer:
                    msg = f"{method}: {answer['error']}"
                    raise BrowserError(msg)
                return dict(answer["result"])

    def _next(self, end: float, waiting_for: str) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            data = os.read(self._from, 1 << 20) if ready else b""
            if not data:
                msg = f"no answer to {waiting_for} within {_ANSWER_SECONDS:g} s, or the browser has ended"
                raise BrowserError(msg)
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        self._note(message)
        return message

    def _note(self, message: dict[str, Any]) -> None:
        kind, said = message.get("method"), message.get("params", {})
        if kind == "Network.requestWillBeSent":
            self.requests.append(said["request"]["url"])
        elif kind == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(said["exceptionDetails"])[:500])
        elif kind == "Runtime.consoleAPICalled" and said["type"] in {"error", "warning", "assert"}:
            self.complaints.append(json.dumps(said["args"])[:500])
        elif kind == "Log.entryAdded" and said["entry"]["level"] in {"error", "warning"}:
            self.complaints.append(said["entry"]["text"])

    def look(
        self,
        width: int,
        height: int,
        *,
        dark: bool = False,
        still: bool = False,
        phone: bool = False,
        ratio: float = 1.0,
    ) -> None:
        """Say how large the window is, and what whoever looks prefers."""
        self.ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=ratio, mobile=phone
        )
        features = [
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"},
            {"name": "prefers-reduced-motion", "value": "reduce" if still else "no-preference"},
            {"name": "hover", "value": "none" if phone else "hover"},
        ]
        self.ask("Emulation.setEmulatedMedia", features=features)

    def open(self, path: Path, until: str = "document.readyState === 'complete'") -> None:
        """Open a file and wait until an expression of JavaScript holds."""
        self.ask("Page.navigate", url=path.resolve().as_uri())
        self.wait_for(until)

    def wait_for(self, condition: str, seconds: float = _ANSWER_SECONDS) -> None:
        """Wait until an expression of JavaScript holds; a page that is slow to answer is asked again."""
        end = time.monotonic() + seconds
        # What a document that is only just there lacks is not true yet.
        guarded = f"(() => {{ try {{ return Boolean({condition}); }} catch {{ return false; }} }})()"
        while not self.tell(guarded):
            if time.monotonic() > end:
                msg = f"{condition} does not hold within {seconds:g} s; the page complains: {self.complaints}"
                raise BrowserError(msg)
            # The page tells when the next frame is drawn: nothing changes before.
            self.tell("new Promise((resolve) => setTimeout(resolve, 20))")

    def tell(self, expression: str) -> Any:
        """Return the value of an expression of JavaScript."""
        answer = self.ask("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            msg = f"{expression}: {answer['exceptionDetails']}"
            raise BrowserError(msg)
        return answer["result"].get("value")

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Write what is seen as PNG, or the whole page."""
        more: dict[str, Any] = {}
        if whole:
            size = self.ask("Page.getLayoutMetrics")["cssContentSize"]
            more = {"captureBeyondViewport": True, "clip": {**size, "scale": 1}}
        path.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png", **more)["data"]))

    def pdf(self, path: Path) -> None:
        """Print the page on A4."""
        data = self.ask("Page.printToPDF", preferCSSPageSize=True, printBackground=False)["data"]
        path.write_bytes(base64.b64decode(data))


@contextmanager
def browser(profile: Path, flags: Sequence[str] = (), *, graphics: bool = False) -> Iterator[Browser]:
    """Yield a tab of a browser with an empty profile of its own; with graphics it has WebGL, however it draws that."""
    assert CHROMIUM is not None
    read_commands, write_commands = os.pipe()
    read_answers, write_answers = os.pipe()
    command = [
        "bash",
        "-c",
        f'exec "$@" 3<&{read_commands} 4>&{write_answers}',
        "bash",
        CHROMIUM,
        *_FLAGS,
        *(() if graphics else ("--disable-gpu",)),
        *flags,
    ]
    process = subprocess.Popen(
        [*command, f"--user-data-dir={profile}"],
        pass_fds=(read_commands, write_answers),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.close(read_commands)
    os.close(write_answers)
    try:
        yield Browser(process, write_commands, read_answers).begin()
    finally:
        os.close(write_commands)  # the browser ends with its pipe
        try:
            process.wait(30.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        os.close(read_answers)
