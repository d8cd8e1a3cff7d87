"""What it costs to watch a study: processor time of `page` or `live` with one viewer, and what the study loses by it.

    . scripts/environment.sh; python -m fin_bringup.benchmarks.watched [--trials N] [--pairs N] [--seconds S]

Two stretches of one study are a pair, one without and one with a watcher, in turns: what else the machine does meets
both, and no study swims other fins than another. A pair tells by what it differs, many pairs how sure that is.
Processor time counts most, for the wall's is everybody's; that of the viewer, which in life is another computer's, is
left out.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import aiohttp

from fin_bringup.processes import find_executable
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

WATCHERS = ("page", "live")
_NAMESPACE = "/watched/fish"
_PORT = 8871
_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
_PATIENCE = 120.0
"""s for anything to happen."""
_SHOWN = 100
"""Messages after which a viewer has seen all that a watcher looks up when it is opened."""
_FIRST = 12
"""Trials before anything is measured: the search has begun to compute by then."""
_LIVE_PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")


@dataclass(frozen=True)
class Stretch:
    """What a stretch of a study took.

    Attributes:
        core_ms: Processor time of all its processes for each trial.
        a_second: Trials in a second of the wall's time.
        watcher: Share of a core that its watcher took meanwhile, 0 without one.
    """

    core_ms: float
    a_second: float
    watcher: float


def _processor_seconds(process: int) -> float:
    """Return the processor time of a process that runs, in s."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_A_SECOND


def _with_children(process: int) -> float:
    """Return the processor time of a process and of its children, in s."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="utf-8").split()
    return _processor_seconds(process) + sum(_processor_seconds(int(child)) for child in children)


class _Viewer:
    """A viewer that is shown everything, in a thread of its own; who is not let in comes again.

    Attributes:
        heard: Messages that came.
    """

    def __init__(self, watcher: str) -> None:
        self.heard = 0
        self._watcher = watcher
        self._loop = asyncio.new_event_loop()
        self._looking = self._loop.create_task(self._come_again())
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        """Look away."""
        self._loop.call_soon_threadsafe(self._looking.cancel)
        self._thread.join()

    def _run(self) -> None:
        with suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._looking)
        self._loop.close()

    async def _come_again(self) -> None:
        while True:
            with suppress(aiohttp.ClientError, OSError):
                await self._look()
            await asyncio.sleep(0.2)

    async def _look(self) -> None:
        async with aiohttp.ClientSession() as session:
            here = f"http://127.0.0.1:{_PORT}"
            if self._watcher == "page":
                async with session.ws_connect(f"{here}/socket", origin=here) as page:
                    await page.send_json({"do": "look", "on": True})
                    async for _ in page:
                        self.heard += 1
                return
            async with session.ws_connect(here, protocols=_LIVE_PROTOCOLS, max_msg_size=0) as viewer:
                async for message in viewer:
                    self.heard += message.type is aiohttp.WSMsgType.BINARY
                    said = json.loads(message.data) if message.type is aiohttp.WSMsgType.TEXT else {}
                    channels = [channel["id"] for channel in said.get("channels", ())]
                    if said.get("op") == "advertise" and channels:
                        wanted = [{"id": channel, "channelId": channel} for channel in channels]
                        await viewer.send_json({"op": "subscribe", "subscriptions": wanted})


@contextmanager
def _watching(watcher: str) -> Iterator[subprocess.Popen[bytes]]:
    """Have somebody watch: a watcher with one viewer, to whom something was shown."""
    space = ("--namespace", _NAMESPACE) if watcher == "page" else ()
    ros = () if watcher == "page" else ("--ros-args", "-r", f"__ns:={_NAMESPACE}")
    command = [*find_executable("fin_bringup", watcher), "--port", str(_PORT), *space, *ros]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603
    viewer = _Viewer(watcher)
    try:
        _until(lambda: viewer.heard > _SHOWN, process, f"{watcher} showed nothing")
        yield process
    finally:
        viewer.close()
        process.send_signal(signal.SIGINT)
        process.wait()


@contextmanager
def _study(folder: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Have a study run."""
    always = (f"study_folder:={folder}", f"namespace:={_NAMESPACE}", "disk.minimum_free:=0")
    command = [*find_executable("fin_bringup", "bringup"), *always, *words]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait()


def _until(condition: Callable[[], object], process: subprocess.Popen[bytes], what: str) -> None:
    """Wait until a condition holds.

    Raises:
        RuntimeError: It does not, or the process has ended.
    """
    end = time.monotonic() + _PATIENCE
    while not condition():
        if process.poll() is not None or time.monotonic() > end:
            msg = f"{what} within {_PATIENCE:g} s: run it by hand, with namespace {_NAMESPACE}"
            raise RuntimeError(msg)
        time.sleep(0.02)


def _begun(folder: Path) -> int:
    """Return how many trials have begun."""
    bags = folder / "bags"
    return sum(1 for _ in bags.iterdir()) if bags.is_dir() else 0


def _trials(folder: Path, number: int, study: subprocess.Popen[bytes]) -> None:
    """Wait until so many more trials have begun."""
    wanted = _begun(folder) + number
    _until(lambda: _begun(folder) >= wanted, study, "the study did not go on")


def _stretch(
    folder: Path, study: subprocess.Popen[bytes], trials: int, watching: subprocess.Popen[bytes] | None
) -> Stretch:
    """Return what the study's next trials take, from the beginning of one on."""
    _trials(folder, 1, study)
    began, before = time.monotonic(), _with_children(study.pid)
    watched = _processor_seconds(watching.pid) if watching else 0.0
    _trials(folder, trials, study)
    seconds = time.monotonic() - began
    share = (_processor_seconds(watching.pid) - watched) / seconds if watching else 0.0
    return Stretch(1e3 * (_with_children(study.pid) - before) / trials, trials / seconds, share)


def full_speed(watcher: str, trials: int, pairs: int) -> list[tuple[Stretch, Stretch]]:
    """Return pairs of stretches of a study as fast as it goes, without and with a watcher, of so many trials each.

    Raises:
        RuntimeError: The study or the watcher did not begin, or failed.
    """
    found = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "study"
        with _study(folder, "trials:=1000000", "measurement.duration:=10") as study:
            _trials(folder, _FIRST, study)
            for pair in range(pairs):
                alone = _stretch(folder, study, trials, None) if pair % 2 == 0 else None
                with _watching(watcher) as watching:
                    watched = _stretch(folder, study, trials, watching)
                found.append((alone or _stretch(folder, study, trials, None), watched))
    return found


def real_time(watcher: str, seconds: float) -> float:
    """Return the share of a core that a watcher takes while a fish swims in real time.

    Raises:
        RuntimeError: The study or the watcher did not begin.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "study"
        with _study(folder, "speed:=1.0", "trials:=1000") as study:
            _trials(folder, 1, study)
            with _watching(watcher) as watching:
                before, began = _processor_seconds(watching.pid), time.monotonic()
                time.sleep(seconds)
                return (_processor_seconds(watching.pid) - before) / (time.monotonic() - began)


def _more(ratios: Sequence[float]) -> str:
    """Return by how many per cent more the geometric mean of ratios is than 1, with its standard error."""
    logs = [math.log(ratio) for ratio in ratios]
    error = statistics.stdev(logs) / math.sqrt(len(logs)) if len(logs) > 1 else math.nan
    return f"{100 * math.expm1(statistics.mean(logs)):+.1f} ± {100 * error:.1f} %"


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="watched", description="Measure what it costs to watch a study.")
    parser.add_argument(
        "--trials", type=checks.read_whole_number, default=4, help="of a stretch (default: %(default)s)"
    )
    parser.add_argument("--pairs", type=checks.read_whole_number, default=20, help="default: %(default)s")
    parser.add_argument("--seconds", type=float, default=20.0, help="in real time (default: %(default)s)")
    parser.add_argument("watchers", nargs="*", default=WATCHERS, help="page, live or both")
    given = parser.parse_args(arguments)
    head = (
        "watcher",
        "core-ms a trial",
        "watched",
        "trials a second",
        "watched",
        "its share of a core",
        "in real time",
    )
    print(_row(head))  # noqa: T201
    print(_row(("---",) * len(head)))  # noqa: T201
    for watcher in given.watchers:
        pairs = full_speed(watcher, given.trials, given.pairs)
        alone, watched = zip(*pairs, strict=True)
        cells = [
            f"`{watcher}`",
            f"{statistics.median(each.core_ms for each in alone):.0f}",
            _more([b.core_ms / a.core_ms for a, b in pairs]),
            f"{statistics.median(each.a_second for each in alone):.2f}",
            _more([b.a_second / a.a_second for a, b in pairs]),
            f"{100 * statistics.median(each.watcher for each in watched):.1f} %",
            f"{100 * real_time(watcher, given.seconds):.1f} %",
        ]
        print(_row(cells), flush=True)  # noqa: T201


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main(sys.argv[1:])
