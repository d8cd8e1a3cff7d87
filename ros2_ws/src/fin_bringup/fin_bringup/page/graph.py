"""The page's end of the graph: listens, asks and stops, in a thread of its own.

Everything that the board knows is changed in this thread alone: the executor's callbacks, and what pages do, which
comes as tasks of the executor.
"""

from __future__ import annotations

import itertools
import threading
import time
import traceback
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

from fin_bringup.page.board import Board, Missed, Stop, ended, to_stop
from fin_bringup.page.fish_streams import FishStreams
from fin_bringup.page.offers import PAUSE, RELEASE, REPEAT, START, Guard, Offer
from fin_optimizer.parameters import OPTIMIZER, SIMULATOR
from fin_plant import topics
from fin_plant.discovery import around, look_around
from fin_servo_driver.driver_client import DRIVER, STOP, DriverClient, stop_request
from fin_servo_driver.requests import Answer, Request, Requests

if TYPE_CHECKING:
    from collections.abc import Callable

    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
    from rclpy.client import Client

    from fin_bringup.page.action_log import ActionLog
    from fin_bringup.page.board import Measured

_FRAME_PERIOD = 0.1
_TELL_PERIOD = 0.2
_LOOK_PERIOD = 0.5
_SPIN = 0.05
_STUDY_SECONDS = 5.0
"""s in which the optimiser must answer."""
_EACH_TRIAL = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
)
"""The end of a trial must not be lost to the beginning of the next one, which follows at once."""
_STUDY_ACTIONS = (START, PAUSE, REPEAT)


class GraphClient:
    """Listens to a fish and its study, and acts for pages."""

    def __init__(
        self,
        namespace: str,
        session: str,
        log: ActionLog,
        tell: Callable[[dict[str, Any]], object],
        failed: Callable[[], object],
    ) -> None:
        """Start to listen; rclpy must be initialised. Nothing happens before `start`.

        Args:
            namespace: Of the fish and its optimiser.
            session: Stands for the page's server.
            log: Notes what pages do.
            tell: Called in this client's thread with what pages are to show.
            failed: Called in this client's thread if it ends by a defect.
        """
        self.node = Node("page", namespace=namespace)
        self._streams = FishStreams(namespace)
        self._board, self._guard, self._log, self._tell = Board(session), Guard(), log, tell
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        self._driver = DriverClient(self.node, answered=self._on_answer)
        self._stops: dict[str, Client] = {}
        for name in (DRIVER, SIMULATOR):
            self._stop_of(self._full_name(name))
        self._requests = Requests(self._on_answer)
        self._study = {name: self.node.create_client(Trigger, f"{OPTIMIZER}/{name}") for name in _STUDY_ACTIONS}
        self._asked: dict[str, tuple[str, str]] = {}
        self._stop_numbers = itertools.count(1)
        self._viewers: dict[int, bool] = {}
        self._state: object = None
        self._version = -1
        self._folder, self._missed = "", Missed()
        self._ended = threading.Event()
        self._frame_due = self._tell_due = self._look_due = 0.0
        self._listen()
        self._thread = threading.Thread(target=self._run, name="graph")
        self._failed = failed

    def _full_name(self, node: str) -> str:
        return f"{self.node.get_namespace().rstrip('/')}/{node}"

    def _stop_of(self, plant: str) -> Client:
        """Return the client of a plant's emergency stop: made before it is needed, for discovery takes a moment."""
        if plant not in self._stops:
            self._stops[plant] = self.node.create_client(SetBool, f"{plant}/{topics.EMERGENCY_STOP_SERVICE}")
        return self._stops[plant]

    def _listen(self) -> None:
        for topic, heard, qos in (
            (topics.DIAGNOSTICS, self._on_diagnostics, topics.DIAGNOSTICS.qos),
            (topics.PROGRESS, self._on_progress, topics.PROGRESS.qos),
            (topics.CANDIDATE, self._on_candidate, _EACH_TRIAL),
        ):
            self.node.create_subscription(topic.type, topic.name, heard, qos)

    # -- the thread --------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Run the thread."""
        self._thread.start()

    def close(self) -> None:
        """End the thread, and leave the graph."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._executor.shutdown()
        self._streams.close()
        self.node.destroy_node()

    def submit(self, act: Callable[..., object], *arguments: object) -> None:
        """Have a method of this client called in its thread, at once; for any thread."""
        self._executor.create_task(lambda: act(*arguments))

    def _run(self) -> None:
        try:
            while not self._ended.is_set():
                self._executor.spin_once(timeout_sec=_SPIN)
                self._step(time.monotonic())
        except Exception:  # noqa: BLE001  (a defect; pages are to say that nothing comes any more)
            traceback.print_exc()
            self._failed()

    def _step(self, now: float) -> None:
        self._driver.see_to_requests()
        self._requests.see_to()
        if self._driver.state is not self._state and self._driver.state is not None:
            self._state = self._driver.state
            self._board.plant_is(self._driver.state, now)
            self._streams.begin(self._driver.state.stamp)
            self._tell_due = 0.0
        self._board.device = self._driver.device
        if now >= self._look_due:
            self._look_due = now + _LOOK_PERIOD
            self._look(now)
        if self._looking and now >= self._frame_due:
            self._frame_due = now + _FRAME_PERIOD
            if frame := self._streams.frame(self._driver.state.fin if self._driver.state else {}):
                self._board.picture(now)
                self._tell(frame)
        if now >= self._tell_due:
            self._tell_due = now + _TELL_PERIOD
            self._tell_all(now)

    @property
    def _looking(self) -> bool:
        return any(self._viewers.values())

    def _tell_all(self, now: float) -> None:
        if not self._viewers:
            return
        self._tell(self._board.snapshot(now))
        if self._version != self._board.search_version:
            self._version = self._board.search_version
            self._tell(self._board.search())

    def _look(self, now: float) -> None:
        """See who is on the graph."""
        plants, studies = (self._processes(topic.name) for topic in (topics.PLANT_STATE, topics.PROGRESS))
        self._board.see(plants, studies, "" if plants or studies else around(look_around(self.node)))
        for plant in plants:
            self._stop_of(plant)
        self._streams.attend(now, listen=self._looking)
        if (folder := self._board.folder) and self._viewers:
            if folder != self._folder:
                self._folder = folder
                self._log.study_in(folder)
            if self._missed.due(folder, self._board.lacking, now):
                threading.Thread(target=self._read_trials, args=(folder,), name="journal", daemon=True).start()

    def _processes(self, topic: str) -> dict[str, str]:
        """Return the nodes that publish a topic here, and what stands for the process of each."""
        infos = self.node.get_publishers_info_by_topic(self.node.resolve_topic_name(topic))
        return {f"{i.node_namespace.rstrip('/')}/{i.node_name}": bytes(i.endpoint_gid).hex() for i in infos}

    def _read_trials(self, folder: str) -> None:
        """Read the trials that were not heard, where the study is on this computer."""
        from fin_optimizer.study.journal import StudyError  # noqa: PLC0415  (Optuna takes a second to load)
        from fin_optimizer.study.records import read_trials  # noqa: PLC0415

        try:
            trials = read_trials(Path(folder), lambda _: None)
        except (OSError, StudyError):
            return  # of another computer, or not written yet
        told = ended((trial.number, trial.outcome.value, trial.measured) for trial in trials)
        self.submit(self._take_trials, folder, told)

    def _take_trials(self, folder: str, trials: dict[int, Measured]) -> None:
        if folder == self._board.folder:
            self._board.trials_were(trials)
            self._missed.were_read(self._board.lacking)

    # -- what is heard -----------------------------------------------------------------------------------------------

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now, home = time.monotonic(), self._full_name("")
        for status in message.status:
            node = str(status.name).partition(": ")[0]
            if node == self._board.plant_name:
                self._board.plant_says(now)
            elif node == self._full_name(OPTIMIZER):
                self._on_progress(status)
            elif node.startswith(home):
                self._board.other_heard(now)

    def _on_progress(self, message: DiagnosticStatus) -> None:
        self._board.study_is(_values(message), message.message, time.monotonic())

    def _on_candidate(self, message: DiagnosticStatus) -> None:
        self._board.trial_is(_values(message), message.message, time.monotonic())

    # -- what pages do -----------------------------------------------------------------------------------------------

    def join(self, viewer: int) -> None:
        """Note a page that is looked at."""
        self._viewers[viewer] = True
        self._version = -1
        self._tell_due = self._look_due = 0.0

    def leave(self, viewer: int) -> None:
        """Note that a page is gone."""
        self._viewers.pop(viewer, None)
        self._guard.leave(viewer)

    def looks(self, viewer: int, look: bool) -> None:
        """Note whether somebody looks at a page."""
        if viewer in self._viewers:
            self._viewers[viewer] = look

    def sees(self, viewer: int, keys: list[str]) -> None:
        """Note which buttons a page shows."""
        self._guard.seen(viewer, keys, time.monotonic())

    def press(self, viewer: int, address: str, key: str) -> None:
        """Do what a button stands for, if the press counts."""
        now = time.monotonic()
        offers = self._board.offers(now)
        if refusal := self._guard.refusal(viewer, key, offers, now):
            self._log.note(address, f"refused: {refusal}")
            self._tell({"kind": "answer", "to": viewer, "text": refusal, "good": False})
            return
        offer = next(each for each in offers if each.key == key)
        self._happened(address, f"pressed: {offer.label}")
        if not self._do(offer):
            self._happened(address, self._driver.answer, good=False)
            return
        self._guard.press(key, address)
        self._asked[offer.action] = (key, address)

    def _do(self, offer: Offer) -> bool:
        """Ask for what a button stands for; return False where something else is not answered yet."""
        if offer.action in _STUDY_ACTIONS:
            lost = f"{offer.action}: no answer from the optimiser within {_STUDY_SECONDS:g} s"
            deadline = time.monotonic() + _STUDY_SECONDS
            self._requests.send(Request(offer.action, self._study[offer.action], Trigger.Request(), deadline, lost))
        elif offer.action == RELEASE:
            self._requests.send(stop_request(self._stop_of(self._board.plant_name), on=False))
        else:
            return self._driver.ask(offer.action)
        return True

    def stop(self, address: str, late: int = 0) -> None:
        """Latch the emergency stop of every plant that is there; of those that may be where none is.

        Args:
            address: Of the page.
            late: s for which the page had no connection to send it by.
        """
        self._driver.drop_unsent()
        found = {name: client.service_is_ready() for name, client in self._stops.items()}
        asked = to_stop(found, self._board.plants, self._board.plant_name)
        self._board.stop = Stop(next(self._stop_numbers), _clock(), address, list(asked), late)
        for name in asked:
            self._requests.send(stop_request(self._stop_of(name), on=True))
        when = f", {late} s ago without a connection" if late else ""
        self._happened(address, f"pressed: EMERGENCY STOP{when}")

    def _on_answer(self, answer: Answer) -> None:
        now, node = time.monotonic(), answer.service.rpartition("/")[0]
        took = "" if answer.seconds is None else f" ({1e3 * answer.seconds:.1f} ms)"
        if answer.name == STOP:
            self._take_stop(node, answer)
            address = self._board.stop.address if self._board.stop else ""
        else:
            key, address = self._asked.pop(answer.name, ("", ""))
            self._guard.answered(key, now, accepted=answer.accepted)
            if answer.name == RELEASE and answer.accepted:
                self._board.stop = None
        self._happened(address, f"{node}: {answer.text}{took}", good=answer.accepted)

    def _take_stop(self, node: str, answer: Answer) -> None:
        stop = self._board.stop
        if stop is None:
            return
        if node in stop.waiting:
            stop.waiting.remove(node)
        if answer.accepted and answer.seconds is not None:
            stop.heard[node] = f"after {1e3 * answer.seconds:.1f} ms, at {_clock()}"
        else:
            stop.lost.append(f"{node}: {answer.text}")

    def _happened(self, address: str, text: str, *, good: bool = True) -> None:
        self._log.note(address, text)
        self._board.happened(_clock(), address, text, good=good)
        self._tell_due = 0.0
        self._tell_all(time.monotonic())


def _values(status: DiagnosticStatus) -> dict[str, str]:
    return {item.key: item.value for item in status.values}


def _clock() -> str:
    return datetime.now().astimezone().strftime("%H:%M:%S.%f")[:-3]
