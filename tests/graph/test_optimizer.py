"""The optimiser with real plants: studies that run, that fail with a reason, that are interrupted and gone on with."""

from __future__ import annotations

import csv
import itertools
import os
import signal
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import pytest
import rclpy
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from fin_optimizer.bags.reader import read_bag
from fin_optimizer.score.recorded import score_bag
from fin_optimizer.study.file_names import REPEATED_MARK
from fin_optimizer.study.records import ASKED_FOR_AGAIN, read_ledger, read_trials
from fin_optimizer.trial.plant_client import PlantClient
from fin_optimizer.trial.result import Outcome
from fin_plant import topics
from fin_plant.fin import FIN_PARAMETERS, node_table
from fin_plant.gait import PAPER_GAIT, Gait
from fin_plant.messages import plant_state_message
from fin_plant.plant_state import PlantState, State
from support.plant_tester import PlantTester
from support.waiting import PATIENCE, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from support.disk import Disk
    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph
MODULUS = "fin.young_modulus [Pa]"
PAPER_AREA = 0.08 * 0.025
"""m^2."""
SHORT = ("measurement.duration:=1.0",)
CONTROL = ("fin_optimizer", "control")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "study"


def start_bringup(start: Start, folder: Path, *arguments: str) -> StartedProcess:
    return start("fin_optimizer", "bringup", f"study_folder:={folder}", *arguments)


def start_node(start: Start, package: str, executable: str, *parameters: str) -> StartedProcess:
    words = [word for parameter in parameters for word in ("-p", parameter)]
    return start(package, executable, "--ros-args", *words)


def start_simulator(start: Start, *parameters: str) -> StartedProcess:
    """Start a fish that swims on where a busy machine puts aside the optimiser that commands it, as a bring-up does."""
    return start_node(start, "fin_sim", "simulator", "command_timeout:=10.0", *parameters)


def start_optimizer(start: Start, folder: Path, *parameters: str) -> StartedProcess:
    return start_node(start, "fin_optimizer", "optimizer", f"study_folder:={folder}", *parameters)


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "trials.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def at_once() -> None:
    """Wait for nothing."""


class StubPlant:
    """A plant that publishes its state and answers as it is told; what it does not offer is missing.

    For each fin that it is given, ``answers`` holds what it waits for before it answers, and why it refuses; an empty
    text accepts.
    """

    def __init__(self, domain: int, answers: Iterable[tuple[Callable[[], object], str]] | None = None) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node(
            "stub", namespace=topics.NAMESPACE, context=self._context, start_parameter_services=False
        )
        states = self._node.create_publisher(topics.PLANT_STATE.type, topics.PLANT_STATE.name, topics.PLANT_STATE.qos)
        states.publish(plant_state_message(PlantState(State.READY, "stub", 1)))
        if answers is not None:
            self._answers = iter(answers)
            self._node.create_service(SetParametersAtomically, "~/set_parameters_atomically", self._answer)
            self._node.create_service(Trigger, "~/request_reset", lambda _, response: response)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin)

    def _answer(
        self, _: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        wait, refusal = next(self._answers)
        wait()
        response.result = SetParametersResult(successful=not refusal, reason=refusal)
        return response

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def client(ros_domain: int) -> Iterator[PlantTester]:
    with PlantTester(ros_domain) as tester:
        yield tester


@pytest.mark.parametrize("says", [(State.READY,), (State.FAULT,), ()], ids=["rest", "fault", "nothing more"])
def test_who_leaves_a_swimming_plant_waits_until_it_is_at_rest_or_gone(ros_domain: int, says: Sequence[State]) -> None:
    context, heard = rclpy.Context(), []  # type: ignore[var-annotated]
    rclpy.init(context=context, domain_id=ros_domain)
    optimizer, plant = (
        rclpy.create_node(name, namespace=topics.NAMESPACE, context=context) for name in ("optimizer", "plant")
    )
    plant.create_subscription(topics.GAIT.type, topics.GAIT.name, heard.append, topics.GAIT.qos)
    states = plant.create_publisher(topics.PLANT_STATE.type, topics.PLANT_STATE.name, topics.PLANT_STATE.qos)
    subject = PlantClient(optimizer, topics.NAMESPACE)

    def publishers() -> frozenset[str]:
        subject.look(time.monotonic())
        return subject.publishers

    wait_until(publishers, 20, "the plant")
    subject.send(PAPER_GAIT)
    states.publish(plant_state_message(PlantState(State.SWIMMING, "stub", 1)))
    subject.send(Gait.from_rows([[0.0, 0.9, 0.0, 0.0]]))
    subject._listen_while(lambda: not subject.swims, 60.0)
    leaving = threading.Thread(target=subject.farewell)
    leaving.start()
    leaving.join(0.3)
    assert leaving.is_alive()
    for state in says:
        states.publish(plant_state_message(PlantState(state, "stub", 2)))
    if not says:
        plant.destroy_publisher(states)
    leaving.join()
    assert not subject.swims or not subject.publishers
    optimizer.destroy_node()
    plant.destroy_node()
    rclpy.shutdown(context=context)


def test_a_short_study_runs_to_its_end_and_leaves_everything(start: Start, folder: Path) -> None:
    study = start_bringup(start, folder, "trials:=4", "seed:=2", "measurement.settle:=0.5", *SHORT)
    assert study.wait(90) == 0
    rows = table(folder)
    assert [row["outcome"] for row in rows] == ["OK"] * 4
    best = max(rows, key=lambda row: float(row["speed [m/s]"]))
    shown = f"E {float(best[MODULUS]) / 1e9:.4g} GPa swims {float(best['speed [m/s]']) * 100:#.4g} cm/s"
    assert f"best of 4 trials: {shown}" in study.output()
    assert (folder / "speed_over_modulus.png").read_bytes().startswith(b"\x89PNG")
    for row in rows:
        check_bag(folder, row)
    fish = read_ledger(folder)[1]
    assert fish.keys() == {"plant", *node_table("fin_sim", "simulator").deciding_swims} - FIN_PARAMETERS.keys()


def check_bag(folder: Path, row: dict[str, str]) -> None:
    """The bag holds every message of the window, gives the live score to the last digit, and says what it is."""
    scored, bag = score_bag(folder / row["bag"])
    assert repr(scored.value) == row["speed [m/s]"]
    assert (scored.samples, row["samples"]) == (101, "101")
    assert bag.complete
    # 0.5 s before the window, 1 s in it, at 100 Hz, and what came before and after.
    assert all(bag.counts[f"/fish/{name}"] >= 150 for name in ("joint_states", "pose", "velocity", "thrust"))
    assert bag.metadata["trial.number"] == row["trial"]
    assert bag.metadata["fin.young_modulus"] == row[MODULUS]
    assert bag.metadata["study.seed"] == "2"
    assert {"git.commit", "version.numpy", "version.fin_optimizer", "gait.joint_1"} <= bag.metadata.keys()


def test_a_study_in_two_parts_tries_the_fins_of_one_in_a_single_part(start: Start, tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    start_simulator(start, "speed:=0.0")
    for study, last in ((whole, "trial 0002"), (parts, "trial 0000")):  # neither comes to its picture
        begun = start_optimizer(start, study, "trials:=100", *SHORT)
        begun.wait_for_output(last)
        begun.interrupt()
    swum = len(table(parts))
    again = start_optimizer(start, parts, f"trials:={max(swum, 3)}", *SHORT)
    assert again.wait(90) == 0
    assert f"going on after {swum} trial" in again.output()
    for column in (MODULUS, "speed [m/s]"):
        first, second = ([row[column] for row in table(each) if row["outcome"] == "OK"][:3] for each in (whole, parts))
        assert first == second
    other = start_optimizer(start, parts, "trials:=3", "seed:=2", *SHORT)
    assert other.wait(60) == 2
    assert "was begun with other settings: seed is 1 there and 2 here" in other.output()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("gait.frequency:=8.0", "frequency 8 Hz asked, 5 Hz swum"),
        ("gait.amplitude:=0.4", "amplitude 0.4 rad asked, 0.261799 rad swum"),
    ],
)
def test_a_gait_beyond_the_plants_limits_is_refused_before_anything_is_proposed(
    start: Start, folder: Path, asked: str, said: str
) -> None:
    study = start_bringup(start, folder, "trials:=2", asked, *SHORT)
    assert study.wait(60) == 1
    assert said in study.output()
    assert table(folder) == []
    assert list((folder / "bags").iterdir()) == []


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long)]
)
def test_a_signal_in_the_middle_leaves_every_bag_readable_and_the_journal_complete(
    start: Start, folder: Path, number: signal.Signals, code: int
) -> None:
    study = start_bringup(start, folder, "trials:=1000", "speed:=4")
    study.wait_for_output("trial 0001")
    # The third swim is under way when its bag has its first chunk, which is written once a second.
    wait_until(lambda: list(folder.glob("bags/trial_0002_*/*.mcap")), 20, "the third trial's bag")
    study.signal(number)
    assert study.wait(30) == code
    assert not study.group_alive()
    rows = table(folder)
    assert [row["outcome"] for row in rows[:2]] == ["OK", "OK"]
    assert rows[-1]["outcome"] == "INTERRUPTED"
    assert "in phase" in rows[-1]["reason"]
    bags = sorted(folder.glob("bags/*"))
    assert len(bags) == len(rows)
    assert all(read_bag(bag).complete for bag in bags)
    assert f"go on with study_folder:={os.path.relpath(folder, study.log.parents[1] / 'work')}" in study.output()


def test_an_optimiser_that_is_stopped_switches_the_gait_off(start: Start, folder: Path, client: PlantTester) -> None:
    start_simulator(start)
    optimizer = start_optimizer(start, folder, "trials:=2")
    client.wait_for_state(State.SWIMMING)
    optimizer.signal(signal.SIGINT)
    ready = client.wait_for_state(State.READY)
    assert ready.reason == "", "the plant stopped by its own time-out"
    assert optimizer.wait() == 130


def test_without_a_plant_the_trial_fails_and_names_the_topic(start: Start, folder: Path, ros_domain: int) -> None:
    optimizer = start_optimizer(start, folder, "timeout.find:=0.5", "failures_in_a_row:=3", "trials:=1", *SHORT)
    assert optimizer.wait(60) == 1
    assert [row["outcome"] for row in table(folder)] == ["INTERRUPTED"] * 3
    said = f"nobody publishes topic /fish/plant_state; no other node is seen at all, with ROS_DOMAIN_ID={ros_domain}, "
    assert said in table(folder)[0]["reason"]
    assert "3 trials in a row FAILED or were INTERRUPTED" in optimizer.output()
    start_simulator(start, "speed:=0.0")
    again = start_optimizer(start, folder, "timeout.find:=20.0", "failures_in_a_row:=3", "trials:=1", *SHORT)
    again.wait_for_output("trial 0003")
    again.interrupt()  # before its picture, which takes as long as all the rest
    assert table(folder)[-1]["outcome"] == "OK"
    assert len({row[MODULUS] for row in table(folder)}) == 1, "a plant that was not there used up no fin"


def test_what_is_seen_instead_of_the_plant_is_named(start: Start, folder: Path, ros_domain: int) -> None:
    """First a plant whose state goes to who listens already only, then one in another namespace as well."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = rclpy.create_node("mine", namespace=topics.NAMESPACE, context=context)
    try:
        publisher = node.create_publisher(topics.PLANT_STATE.type, topics.PLANT_STATE.name, 1)
        words = ("timeout.find:=2.0", "failures_in_a_row:=1", "trials:=1")
        assert start_optimizer(start, folder, *words).wait(60) == 1
        lacks = (
            "/fish/mine publishes topic /fish/plant_state, but not transient local (it is volatile), which is needed"
        )
        assert lacks in table(folder)[0]["reason"]
        node.destroy_publisher(publisher)
        other = start("fin_sim", "simulator", "--ros-args", "-r", "__ns:=/fish2")
        other.wait_for_output("kernel ready")
        assert start_optimizer(start, folder, *words).wait(60) == 1
        assert (
            "nobody publishes topic /fish/plant_state; published is /fish2/plant_state by /fish2/simulator: "
            "did you mean plants:=[/fish2]?"
        ) in table(folder)[1]["reason"]
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def test_a_plant_without_services_fails_the_trial_and_names_them(start: Start, folder: Path, ros_domain: int) -> None:
    with StubPlant(ros_domain):
        optimizer = start_optimizer(start, folder, "timeout.find:=1.0", "failures_in_a_row:=1")
        assert optimizer.wait(60) == 1
    expected = "service /fish/stub/set_parameters_atomically and /fish/stub/request_reset missing"
    assert expected in table(folder)[0]["reason"]


def test_a_fin_that_the_plant_refuses_is_infeasible_and_not_tried_again(
    start: Start, folder: Path, ros_domain: int
) -> None:
    with StubPlant(ros_domain, itertools.repeat((at_once, "fin.young_modulus is not in stock"))):
        optimizer = start_optimizer(start, folder, "trials:=3")
        assert optimizer.wait(60) == 1
    rows = table(folder)
    assert [(row["outcome"], row["reason"]) for row in rows] == [
        ("INFEASIBLE", "fin.young_modulus is not in stock")
    ] * 3
    assert len({row[MODULUS] for row in rows}) == 3
    assert "no trial gave a score" in optimizer.output()


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next_fins(
    start: Start, folder: Path, ros_domain: int
) -> None:
    asked_again = threading.Event()
    with StubPlant(ros_domain, [(lambda: asked_again.wait(PATIENCE), "not in stock"), (at_once, "")]):
        words = ("timeout.reply:=3.0", "timeout.plant:=0.5", "failures_in_a_row:=2")
        optimizer = start_optimizer(start, folder, *words)
        optimizer.wait_for_output("trial 0000")
        asked_again.set()
        assert optimizer.wait(60) == 1
    rows = table(folder)
    assert [row["outcome"] for row in rows] == ["INTERRUPTED", "INTERRUPTED"]
    assert "set the fin: no answer" in rows[0]["reason"]
    assert "wait for the fin: " in rows[1]["reason"], "it was accepted"


@pytest.mark.long
def test_a_study_is_not_gone_on_with_by_another_fish(start: Start, folder: Path, client: PlantTester) -> None:
    start_simulator(start, "speed:=0.0")
    assert start_optimizer(start, folder, "trials:=1", *SHORT).wait(60) == 0
    area = client.get_parameter("body.drag_area")
    bag = read_bag(folder / table(folder)[0]["bag"])
    assert (bag.metadata["plant"], bag.metadata["body.drag_area"]) == ("simulator", repr(area))
    assert client.set_parameters({"body.drag_area": 2.0 * area, "speed": 10.0}).successful
    other = start_optimizer(start, folder, "trials:=2", *SHORT)
    assert other.wait(60) == 1
    expected = (
        f"optimizer: error: the study was begun with another fish: body.drag_area is {area} there and {2.0 * area} here"
    )
    assert expected in other.output()
    assert client.set_parameters({"body.drag_area": area, "command_timeout": 4.0}).successful
    assert start_optimizer(start, folder, "trials:=2", *SHORT).wait(60) == 0
    assert [row["outcome"] for row in table(folder)] == ["OK", "INTERRUPTED", "OK"]
    assert table(folder)[1][MODULUS] == table(folder)[2][MODULUS]


def test_two_plants_in_one_namespace_fail_the_trial(start: Start, folder: Path, ros_domain: int) -> None:
    start_simulator(start).wait_for_output("kernel ready")
    with StubPlant(ros_domain, []):
        optimizer = start_optimizer(
            start, folder, "timeout.find:=2.0", "failures_in_a_row:=2", "attempts:=10", "trials:=1"
        )
        optimizer.wait(60)
    assert "has 2 publishers (/fish/simulator, /fish/stub)" in optimizer.output()


@pytest.mark.parametrize(
    ("comes_back", "reason"),
    [
        (False, "wait for the fin: nobody publishes topic /fish/plant_state any more (waited 2 s)"),
        (True, "wait for the fin: who publishes topic /fish/plant_state now was started after the fin had been set"),
    ],
)
def test_a_driver_that_ends_while_somebody_mounts_a_fin_fails_the_trial(
    start: Start, folder: Path, client: PlantTester, comes_back: bool, reason: str
) -> None:
    driver = start_node(start, "fin_servo_driver", "servo_driver")
    patience = "timeout.find:=60.0" if comes_back else "timeout.find:=2.0"
    optimizer = start_optimizer(start, folder, patience, "failures_in_a_row:=1")
    client.wait_until(lambda: len(client.received(topics.PLANT_STATE)) > 1, "the state with the fin that is wanted")
    driver.interrupt()
    if comes_back:
        start_node(start, "fin_servo_driver", "servo_driver")
    assert optimizer.wait(30) == 1
    assert [row["reason"].startswith(reason) for row in table(folder)] == [True]


@pytest.mark.parametrize(
    ("name", "reason"),
    [("body.drag_area", "plant_state says SWIMMING anew"), ("fin.density", "the fin mounted has fin.density = ")],
)
def test_a_fish_that_is_changed_during_its_swim_fails_the_trial(
    start: Start, folder: Path, client: PlantTester, name: str, reason: str
) -> None:
    start_simulator(start)
    changed = {name: client.get_parameter(name) * 1.1}
    optimizer = start_optimizer(start, folder, "failures_in_a_row:=1")
    # Before that it would take the second swim for the first one.
    client.wait_until(lambda: client.diagnostic("phase") == "measure", "an optimiser that has seen the fish swim")
    assert client.set_parameters(changed).successful
    assert optimizer.wait(30) == 1
    assert reason in table(folder)[0]["reason"]


def test_the_services_start_pause_and_stop_a_study(start: Start, folder: Path, call: Callable[[str], Any]) -> None:
    start_simulator(start, "speed:=0.0")
    optimizer = start_optimizer(start, folder, "trials:=1000", "autostart:=false", "measurement.duration:=1.0")
    optimizer.wait_for_output("1000 fins, seed 1")
    assert call("optimizer/pause").message == "nothing to pause: holding until ~/start is called"
    first = start(*CONTROL, "start")
    assert (first.wait(), first.output()) == (0, "started\n")
    optimizer.wait_for_output("trial 0001")
    again = start(*CONTROL, "start")
    assert (again.wait(), again.output()) == (1, "nothing to start: running\n")
    assert call("optimizer/pause").success
    wait_until(lambda: call("optimizer/pause").success is False, 20, "the study to hold")
    held = optimizer.output().count("\ntrial ")
    assert call("optimizer/start").success
    optimizer.wait_for_output(f"trial {held:04d}")
    assert call("optimizer/stop").success
    assert optimizer.wait() == 0
    assert "best of" in optimizer.output()
    assert {row["outcome"] for row in table(folder)} <= {"OK", "INTERRUPTED"}


def test_the_trial_under_way_and_the_last_one_are_swum_again_when_somebody_asks(
    start: Start, folder: Path, client: PlantTester, call: Callable[[str], Any]
) -> None:
    start_simulator(start, "speed:=0.05")  # so slow that a swim is under way until somebody has asked
    optimizer = start_optimizer(start, folder, "trials:=2", "autostart:=false", "measurement.duration:=2.0")
    optimizer.wait_for_output("2 fins, seed 1")
    assert call("optimizer/repeat").message == "nothing to repeat: no trial yet"
    assert call("optimizer/start").success
    client.wait_for_state(State.SWIMMING)
    assert call("optimizer/repeat").message == "trial 0000 is swum again"
    client.wait_for_state(State.READY)
    client.wait_for_state(State.SWIMMING)
    assert call("optimizer/pause").success
    assert client.set_parameters({"speed": 3.0}).successful
    optimizer.wait_for_output("trial 0001")
    wait_until(lambda: call("optimizer/pause").success is False, 20, "the study to hold")
    again = start(*CONTROL, "repeat")
    assert (again.wait(), again.output()) == (0, "trial 0001 is swum again, once the study goes on\n")
    assert call("optimizer/start").success
    assert optimizer.wait() == 0
    trials = read_trials(folder)  # on a busy machine with swims among them whose gait came late
    asked_for = [trial for trial in trials if trial.reason.endswith(ASKED_FOR_AGAIN)]
    assert [(trial.number, trial.candidate, trial.outcome) for trial in asked_for] == [
        (0, 0, Outcome.INTERRUPTED),
        (1, 0, Outcome.INTERRUPTED),
    ]
    assert [trial.candidate for trial in trials if trial.outcome is Outcome.OK] == [0, 1]
    assert [trial for trial in trials if (folder / trial.bag / REPEATED_MARK).is_file()] == asked_for


def test_control_without_an_optimiser_says_what_it_sees(start: Start, folder: Path) -> None:
    control = start(*CONTROL, "stop", "--namespace", "/nowhere")
    assert control.wait() == 1
    said = (
        "control: error: no optimiser found within 5 s: nobody offers service /nowhere/optimizer/stop; "
        "no other node is seen"
    )
    assert said in control.output()
    start_optimizer(start, folder, "autostart:=false").wait_for_output("holding")
    again = start(*CONTROL, "stop", "--namespace", "/nowhere")
    assert again.wait() == 1
    assert "offered is /fish/optimizer/stop: give --namespace /fish" in again.output()


@pytest.mark.long
def test_a_disk_that_fills_up_ends_the_study_without_loss_and_more_room_lets_it_go_on(
    start: Start, tmp_path: Path, disk: Disk
) -> None:
    start_simulator(start, "speed:=0.0")
    whole, cut = tmp_path / "whole", disk.path / "study"
    assert start_optimizer(start, whole, "trials:=8", *SHORT).wait(90) == 0
    refused = start_optimizer(start, cut, "trials:=8", *SHORT)
    assert refused.wait(60) == 1
    assert "MB free, needed are 200.0 MB (parameter disk.minimum_free): make room" in refused.output()
    full = start_optimizer(start, cut, "trials:=8", "disk.minimum_free:=0.0", *SHORT)
    assert full.wait(90) == 1
    assert "No space left on device" in full.output()
    done = [trial for trial in read_trials(cut) if trial.outcome is Outcome.OK]
    assert 0 < len(done) < 8
    assert all(score_bag(cut / trial.bag)[0].value == trial.score for trial in done)
    disk.mount("-o", "remount,size=16m")
    assert start_optimizer(start, cut, "trials:=8", "disk.minimum_free:=0.0", *SHORT).wait(90) == 0
    scored = [row for row in table(cut) if row["outcome"] == "OK"]
    for column in (MODULUS, "speed [m/s]"):
        assert [row[column] for row in scored] == [row[column] for row in table(whole)]


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ["hill_climber", "genetic", "cma_es"])
def test_modulus_and_length_are_searched_together_at_fixed_area(start: Start, folder: Path, algorithm: str) -> None:
    words = (f"search.algorithm:={algorithm}", "search.length.minimum:=0.06", "search.length.maximum:=0.1")
    assert start_bringup(start, folder, "trials:=6", *words, *SHORT).wait(90) == 0
    rows = table(folder)
    assert [row["outcome"] for row in rows] == ["OK"] * 6
    lengths = [float(row["fin.length [m]"]) for row in rows]
    assert all(0.06 <= length <= 0.1 for length in lengths)
    assert len(set(lengths)) > 1
    for row in rows:
        swum = read_bag(folder / row["bag"]).metadata
        assert float(swum["fin.length"]) == float(row["fin.length [m]"])
        assert float(swum["fin.length"]) * float(swum["fin.height"]) == pytest.approx(PAPER_AREA)


def test_a_second_optimiser_on_the_same_study_is_refused(start: Start, folder: Path) -> None:
    first = start_optimizer(start, folder, "autostart:=false")
    first.wait_for_output("30 fins")
    second = start_optimizer(start, folder)
    assert second.wait() == 2
    assert f"optimizer: error: another optimiser is working on {folder}" in second.output()


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        ("trials:=0", "trials = 0 is outside the allowed range [1, 1e+06]"),
        ("trails:=3", "trails is not a parameter: did you mean trials"),
        ("fin.thickness:=0.01", "fin.thickness"),
        ("search.young_modulus.minimum:=5.0e9", "range of fin.young_modulus is upside down"),
        ("study_folder:=/proc/study", "study_folder /proc/study cannot be used"),
    ],
)
def test_a_parameter_that_cannot_be_is_refused_at_the_start(
    start: Start, folder: Path, parameter: str, message: str
) -> None:
    extra = ("fin.length:=0.009",) if "thickness" in parameter else ()
    optimizer = start_optimizer(start, folder, parameter, *extra)
    assert optimizer.wait() == 2
    assert f"optimizer: error: {message}" in optimizer.output()


def test_a_bring_up_that_is_killed_leaves_no_node_behind(start: Start, folder: Path) -> None:
    process = start_bringup(start, folder, "trials:=1000")
    wait_until(lambda: len(children_of(process.pid)) == 2, 20.0, lambda: f"two nodes; it said:\n{process.tail()}")
    nodes = children_of(process.pid)
    process.kill()
    gone = [Path(f"/proc/{node}/exe") for node in nodes]
    wait_until(lambda: not any(path.exists() for path in gone), 20.0, lambda: f"the end of the nodes {nodes}")


def children_of(parent: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


def test_a_simulator_that_dies_ends_the_bring_up_and_is_named(start: Start, folder: Path) -> None:
    study = start_bringup(start, folder, "trials:=1000")
    study.wait_for_output("trial 0001")
    children = Path(f"/proc/{study.pid}/task/{study.pid}/children").read_text().split()
    simulator, optimizer = sorted(children, key=lambda pid: "simulator" not in command_of(pid))
    os.kill(int(simulator), signal.SIGKILL)
    assert study.wait(30) == 1
    assert "bringup: error: simulator was killed by SIGKILL before the study did; the last it said:" in study.output()
    assert "kernel ready" in study.output().rpartition("the last it said:")[2]
    assert not Path(f"/proc/{optimizer}").exists()
    assert all(read_bag(bag).complete for bag in folder.glob("bags/*"))


def command_of(pid: str) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text()


@pytest.mark.parametrize(
    ("argument", "message"),
    [("trial:=3", "did you mean trials"), ("plant:=boat", "plant:=boat is not known"), ("30", "name:=value")],
)
def test_bring_up_refuses_what_it_does_not_know_and_starts_nothing(start: Start, argument: str, message: str) -> None:
    study = start("fin_optimizer", "bringup", argument)
    assert study.wait() == 2
    assert message in study.output()
