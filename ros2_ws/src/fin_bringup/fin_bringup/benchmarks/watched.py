"""What it costs to watch a study: processor time of `page` or `live` with one viewer, and what the study loses by it.

    . scripts/environment.sh; python -m fin_bringup.benchmarks.watched [--trials N] [--pairs N] [--seconds S]

Studies without and with a watcher take turns, so that what else the machine does meets both. Processor time counts, for
the wall's is everybody's; that of the viewer, which in life is another computer's, is left out.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import aiohttp

from fin_bringup.benchmarks.trials import throughput
from fin_bringup.processes import find_executable
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

WATCHERS = ("page", "live")
_NAMESPACE = "/watched/fish"
_PORT = 8871
_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
_START_SECONDS = 120.0
_LIVE_PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")


@dataclass(frozen=True)
class Study:
    """What a study took.

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


async def _look(watcher: str) -> None:
    """Be a viewer that is shown everything, until cancelled."""
    async with aiohttp.ClientSession() as session:
        here = f"http://127.0.0.1:{_PORT}"
        if watcher == "page":
            async with session.ws_connect(f"{here}/socket", origin=here) as page:
                await page.send_json({"do": "look", "on": True})
                async for _ in page:
                    pass
        else:
            there = session.ws_connect(here, protocols=_LIVE_PROTOCOLS, max_msg_size=0)
            async with there as viewer:
                async for message in viewer:
                    said = json.loads(message.data) if message.type is aiohttp.WSMsgType.TEXT else {}
                    channels = [channel["id"] for channel in said.get("channels", ())]
                    if said.get("op") == "advertise" and channels:
                        wanted = [{"id": channel, "channelId": channel} for channel in channels]
                        await viewer.send_json({"op": "subscribe", "subscriptions": wanted})


@contextmanager
def _watching(watcher: str | None) -> Iterator[subprocess.Popen[bytes] | None]:
    """Have somebody watch: a watcher with one viewer, who comes again until he is let in."""
    if watcher is None:
        yield None
        return
    space = ("--namespace", _NAMESPACE) if watcher == "page" else ()
    ros = () if watcher == "page" else ("--ros-args", "-r", f"__ns:={_NAMESPACE}")
    command = [*find_executable("fin_bringup", watcher), "--port", str(_PORT), *space, *ros]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603
    loop = asyncio.new_event_loop()
    looking: asyncio.Task[None]

    async def look() -> None:
        while True:
            try:
                await _look(watcher)
            except (aiohttp.ClientError, OSError):
                await asyncio.sleep(0.2)

    def run() -> None:
        nonlocal looking
        looking = loop.create_task(look())
        try:
            loop.run_until_complete(looking)
        except asyncio.CancelledError:
            return

    viewer = threading.Thread(target=run)
    viewer.start()
    try:
        yield process
    finally:
        loop.call_soon_threadsafe(looking.cancel)
        viewer.join()
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


def _until_swimming(folder: Path, study: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + _START_SECONDS
    while not any(folder.glob("bags/*")):
        if study.poll() is not None or time.monotonic() > end:
            msg = (
                f"the study did not begin within {_START_SECONDS:g} s: run it by hand, bringup namespace:={_NAMESPACE}"
            )
            raise RuntimeError(msg)
        time.sleep(0.05)


def full_speed(watcher: str | None, trials: int) -> Study:
    """Return what a study as fast as it goes took, from its first trial on.

    Raises:
        RuntimeError: It did not begin, or failed.
    """
    with tempfile.TemporaryDirectory() as place, _watching(watcher) as watching:
        folder = Path(place) / "study"
        with _study(folder, f"trials:={trials}", "measurement.duration:=10") as study:
            _until_swimming(folder, study)
            before, began = _with_children(study.pid), time.monotonic()
            watched = _processor_seconds(watching.pid) if watching else 0.0
            after = before
            while study.poll() is None:
                try:
                    after = max(after, _with_children(study.pid))  # less once a node has ended
                except (FileNotFoundError, ProcessLookupError):
                    break  # a node of it has just ended
                time.sleep(0.1)
            share = (_processor_seconds(watching.pid) - watched) / (time.monotonic() - began) if watching else 0.0
            if study.wait():
                msg = f"the study ended with exit code {study.returncode}"
                raise RuntimeError(msg)
        return Study(1e3 * (after - before) / trials, throughput(folder).trials_a_second, share)


def real_time(watcher: str, seconds: float) -> float:
    """Return the share of a core that a watcher takes while a fish swims in real time.

    Raises:
        RuntimeError: The study did not begin.
    """
    with tempfile.TemporaryDirectory() as place, _watching(watcher) as watching:
        folder = Path(place) / "study"
        with _study(folder, "speed:=1.0", "trials:=1000") as study:
            _until_swimming(folder, study)
            time.sleep(3.0)  # until the viewer is let in
            assert watching is not None  # noqa: S101 - asked for above
            before, began = _processor_seconds(watching.pid), time.monotonic()
            time.sleep(seconds)
            return (_processor_seconds(watching.pid) - before) / (time.monotonic() - began)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="watched", description="Measure what it costs to watch a study.")
    parser.add_argument("--trials", type=checks.read_whole_number, default=60, help="of a study (default: %(default)s)")
    parser.add_argument("--pairs", type=checks.read_whole_number, default=3, help="of studies (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=20.0, help="in real time (default: %(default)s)")
    parser.add_argument("watchers", nargs="*", default=WATCHERS, help="page, live or both")
    given = parser.parse_args(arguments)
    head = ("watcher", "core-ms a trial", "watched", "more", "trials a second", "watched", "fewer")
    print(_row((*head, "its share of a core", "in real time")))  # noqa: T201
    print(_row(("---",) * 9))  # noqa: T201
    for watcher in given.watchers:
        studies: dict[str | None, list[Study]] = {None: [], watcher: []}
        for _ in range(given.pairs):
            for who, each in studies.items():
                each.append(full_speed(who, given.trials))
        cost, more = (statistics.median(one.core_ms for one in each) for each in studies.values())
        fast, slower = (statistics.median(one.a_second for one in each) for each in studies.values())
        share, real = statistics.median(one.watcher for one in studies[watcher]), real_time(watcher, given.seconds)
        cells = [f"`{watcher}`", f"{cost:.0f}", f"{more:.0f}", f"{100 * (more / cost - 1):+.1f} %", f"{fast:.2f}"]
        cells += [f"{slower:.2f}", f"{100 * (1 - slower / fast):+.1f} %", f"{100 * share:.1f} %", f"{100 * real:.1f} %"]
        print(_row(cells), flush=True)  # noqa: T201


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main(sys.argv[1:])
