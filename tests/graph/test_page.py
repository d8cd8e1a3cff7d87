"""The page at the tank before real nodes: what it is told, what its buttons do, and who may press them."""

from __future__ import annotations

import asyncio
import json
import re
import signal
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import aiohttp
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from fin_bringup.page.action_log import ActionLog
from fin_bringup.page.fish_streams import UNMARKED, FishStreams
from fin_bringup.page.graph import GraphClient
from fin_optimizer.study.records import ASKED_FOR_AGAIN, read_trials
from fin_plant import topics
from fin_plant.node_process import starting_ros
from fin_servo_driver.emulator.devices import Firmata
from support.page_client import PageClient, address_of
from support.robot_client import plugged_in
from support.waiting import PATIENCE, wait_until

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable
    from pathlib import Path

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]


def run(scene: Callable[[], Awaitable[Any]]) -> None:
    async def whole() -> None:
        await scene()

    asyncio.run(whole())


@asynccontextmanager
async def two(address: str) -> AsyncIterator[tuple[PageClient, PageClient]]:
    async with PageClient(address) as one, PageClient(address) as other:
        yield one, other


def start_page(start: Start, *arguments: str) -> tuple[StartedProcess, str]:
    page = start("fin_bringup", "page", "--port", "0", *arguments)
    return page, address_of(page)


def start_study(start: Start, folder: Path, speed: str = "1.0", *arguments: str) -> tuple[StartedProcess, ...]:
    plant = start("fin_sim", "simulator", "--ros-args", "-r", "__ns:=/fish", "-p", f"speed:={speed}")
    given = [f"study_folder:={folder}", "disk.minimum_free:=0", *arguments]
    words = [word for each in given for word in ("-p", each)]
    return plant, start("fin_optimizer", "optimizer", "--ros-args", "-r", "__ns:=/fish", *words)


def told(page: PageClient) -> str:
    """Return what the page says that was done."""
    return "\n".join(event["text"] for event in page.snapshot["events"])


def test_a_study_in_the_simulator_is_watched_paused_stopped_and_released(start: Start, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    start_study(start, folder, "0.0", "trials:=1000", "autostart:=false")
    page, address = start_page(start)

    async def scene() -> None:
        async with two(address) as (one, other):
            await one.until(lambda: one.snapshot["plant"].get("state") == "READY", "a plant")
            await one.press("start")
            await one.until(lambda: "best " in one.snapshot["study"]["text"], "a score")
            await one.until(lambda: one.newest.get("search", {}).get("trials", 0) > 1, "two scores")
            await one.until(lambda: (one.newest.get("frame") or {}).get("speed"), "a speed")
            assert len(one.newest["frame"]["tail"]) > 2
            await other.press("pause")
            await one.until(lambda: one.offer("start"), "a study that holds")
            await other.press("repeat")
            await one.until(lambda: "is swum again, once the study goes on" in told(one), "a trial that is swum again")
            await other.send(do="stop")
            await one.until(lambda: (one.snapshot["stop"] or {}).get("state") == "heard", "an answer to the stop")
            assert "heard by /fish/simulator, after" in one.snapshot["stop"]["text"]
            await one.until(lambda: one.snapshot["plant"]["state"] == "FAULT", "a stopped fish")
            await one.press("release")
            await other.until(lambda: other.snapshot["plant"]["state"] == "READY", "a released fish")
            assert len(one.newest["pages"]["pages"]) == 2

    run(scene)
    assert page.interrupt() == 128 + signal.SIGINT
    assert "Traceback" not in page.output()
    log = (folder / "page.log").read_text()
    repeated = re.search(r"pressed: Repeat trial (\d+)", log)
    assert repeated is not None
    marked = [trial.number for trial in read_trials(folder) if trial.reason.endswith(ASKED_FOR_AGAIN)]
    assert marked == [int(repeated[1])]
    for done in ("pressed: Start", "pressed: Pause after this trial", "pressed: EMERGENCY STOP", "released"):
        assert done in log
    assert all(len(line.split("\t")) == 3 for line in log.splitlines())


def test_a_trial_that_ends_as_the_next_one_begins_is_on_the_page(ros_domain: int) -> None:
    snapshots: list[dict[str, Any]] = []
    with starting_ros():
        teller = Node("optimizer", namespace="/fish")
    candidate, progress = (
        teller.create_publisher(topic.type, topic.name, topic.qos) for topic in (topics.CANDIDATE, topics.PROGRESS)
    )
    page = GraphClient("/fish", "session", ActionLog(print), snapshots.append, lambda: None)
    try:
        wait_until(lambda: candidate.get_subscription_count() and progress.get_subscription_count(), PATIENCE, "a page")
        for trial in range(20):
            for outcome in ("RUNNING", "FAILED"):
                values = [KeyValue(key="trial", value=str(trial)), KeyValue(key="outcome", value=outcome)]
                candidate.publish(DiagnosticStatus(values=values))
                assert candidate.wait_for_all_acked(Duration(seconds=10))
        page.start()
        page.submit(page.join, 1)
        wait_until(lambda: any(each.get("trials") == 20 for each in snapshots), PATIENCE, "20 trials")
    finally:
        page.close()
        teller.destroy_node()
        rclpy.try_shutdown()


def test_a_fish_whose_markers_are_seen_last_is_not_drawn_from_its_joints_before(ros_domain: int) -> None:
    with starting_ros():
        fish = Node("simulator", namespace="/fish")
    joints = fish.create_publisher(topics.JOINT_STATES.type, topics.JOINT_STATES.name, topics.JOINT_STATES.qos)
    streams = FishStreams("/fish")

    def tail(now: float) -> int | None:
        """Return how many points the tail has that is shown, once there is one."""
        streams.attend(now, listen=True)
        joints.publish(JointState(position=[0.0] * 7))
        frame = streams.frame({"fin.length": "0.08"})
        return None if frame is None else len(frame["tail"])

    try:
        wait_until(lambda: fish.count_subscribers("/fish/markers") == 1, PATIENCE, "a page", lambda: tail(0.0))
        assert joints.get_subscription_count() == 0
        wait_until(lambda: tail(UNMARKED), PATIENCE, "a fish without markers")
        markers = fish.create_publisher(topics.MARKERS.type, topics.MARKERS.name, topics.MARKERS.qos)
        body = Marker(type=Marker.SPHERE)
        meanwhile = lambda: markers.publish(MarkerArray(markers=[body, Marker(type=Marker.CUBE)]))  # noqa: E731
        wait_until(lambda: tail(UNMARKED) == 2, PATIENCE, "its markers", meanwhile)
        wait_until(lambda: joints.get_subscription_count() == 0, PATIENCE, "an end of the joints")
    finally:
        streams.close()
        fish.destroy_node()
        rclpy.try_shutdown()


def test_a_person_leads_a_robot_to_ready_on_a_page_and_an_old_page_does_not(start: Start, tmp_path: Path) -> None:
    def start_driver(port: Path) -> StartedProcess:
        words = ("-r", "__ns:=/fish", "-p", "robot_file:=firmata", "-p", f"port:={port}")
        return start("fin_servo_driver", "servo_driver", "--ros-args", *words)

    _, address = start_page(start)

    async def scene(port: Path) -> None:
        driver = start_driver(port)
        async with two(address) as (one, other):
            await one.press("configure")
            await one.until(lambda: one.offer("confirm_fin"), "a fin to mount")
            assert one.snapshot["plant"]["mount"]["length"] == "80.0 mm"
            key = await one.press("confirm_fin")
            await one.until(lambda: one.offer("activate"), "an unarmed robot")
            await other.send(do="press", key=key)  # the other page's finger was slower
            await other.until(lambda: "asked no more" in other.newest.get("answer", {}).get("text", ""), "a refusal")
            old = one.offer("activate")
            assert old is not None
            driver.kill()
            await one.until(lambda: one.snapshot["graph"]["lost"], "a lost graph")
            assert one.snapshot["offers"] == []
            start_driver(port)
            await one.press("configure")
            await one.press("confirm_fin")
            await one.until(lambda: one.offer("activate"), "an unarmed robot again")
            await other.send(do="press", key=old["key"])
            await other.until(lambda: other.counts.get("answer", 0) > 1, "another refusal")
            assert "asked no more" in other.newest["answer"]["text"]
            assert one.offer("activate"), "armed by a page of before"
            await one.press("activate")
            await one.until(lambda: one.snapshot["plant"]["state"] == "READY", "a robot that is ready")
            await other.send(do="stop")
            await one.until(lambda: (one.snapshot["stop"] or {}).get("state") == "heard", "an answer to the stop")
            await one.press("release")
            await one.press("confirm_mark")
            await one.until(lambda: one.snapshot["plant"]["state"] == "READY", "a robot that is ready again")
            await one.press("deactivate")
            await one.until(lambda: one.offer("activate"), "an unarmed robot at the end")

    with plugged_in(Firmata(), tmp_path, keep=True) as port:
        run(lambda: scene(port.path))


def test_on_the_network_a_token_is_needed_and_a_foreign_page_gets_no_socket(start: Start) -> None:
    _, address = start_page(start, "--host", "0.0.0.0")  # noqa: S104
    base, _, token = address.partition("/?token=")

    async def scene() -> None:
        async with aiohttp.ClientSession() as nobody:
            for path in ("/", "/page.js", "/socket", f"/?token={token[:-1]}"):
                async with nobody.get(f"{base}{path}") as answer:
                    assert answer.status == 403
                    assert "token" in await answer.text()
        async with PageClient(address) as page:
            assert page.newest["hello"]["you"] == 1
        with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
            async with PageClient(address, origin="http://elsewhere.example"):
                pass

    run(scene)


def test_a_stop_that_nobody_hears_is_said_so(start: Start) -> None:
    _, address = start_page(start)

    async def scene() -> None:
        async with PageClient(address) as page:
            await page.until(lambda: page.snapshot.get("graph", {}).get("lost"), "a lost graph")
            await page.send(do="stop", late=95)
            await page.until(lambda: (page.snapshot["stop"] or {}).get("state") == "lost", "no answer")
            assert page.snapshot["stop"]["text"].startswith("SENT LATE, 95 s after it was pressed; ")
            assert "NO ANSWER TO THE EMERGENCY STOP" in json.dumps(page.snapshot["stop"])

    run(scene)


def test_a_port_that_is_taken_is_one_sentence(start: Start) -> None:
    _, address = start_page(start)
    port = address.rpartition(":")[2]
    other = start("fin_bringup", "page", "--port", port)
    assert other.wait() == 2
    said = other.output().strip().splitlines()
    assert len(said) == 1
    assert f"cannot listen at localhost:{port}: Address already in use; give another" in said[0]
