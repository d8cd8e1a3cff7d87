"""The optimiser's node: proposes fins, has the plant swim them, scores and records each swim, and says how it goes."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from functools import partial
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from std_srvs.srv import Trigger

from fin_optimizer.announcer import Announcer
from fin_optimizer.bags.disk_space import shortage
from fin_optimizer.bags.messages import BagError
from fin_optimizer.bags.repair import repair_bags
from fin_optimizer.goals import BETWEEN_CONSTRAINTS
from fin_optimizer.mode import Mode
from fin_optimizer.parameters import OPTIMIZER, OPTIMIZER_PARAMETERS
from fin_optimizer.plan import StudyPlan
from fin_optimizer.progress import display, show_best
from fin_optimizer.study import final_report
from fin_optimizer.study.candidate import is_for_another
from fin_optimizer.study.journal import StudyError
from fin_optimizer.study.provenance import provenance
from fin_optimizer.study.records import ASKED_FOR_AGAIN, VALUES
from fin_optimizer.study.report import CSV_FILE
from fin_optimizer.study.resume_check import check_scores
from fin_optimizer.thinking import Thinking
from fin_optimizer.trial.result import Outcome, Result
from fin_optimizer.trial.swimmer import Conditions, Swimmer
from fin_optimizer.words import near, trial_name
from fin_plant import node_process, topics
from fin_plant.checks import counted
from fin_plant.command import EXIT_FAILURE, EXIT_OK, error_line
from fin_plant.messages import key_values
from fin_plant.node_parameters import NodeParameters

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.publisher import Publisher

    from fin_optimizer.study.candidate import TrialRecord
    from fin_plant.topics import Topic

_HEALTH_PERIOD = 1.0
_SHOW_PERIOD = 0.1
_IDLE_PERIOD = 0.1
_ARRIVAL = 5.0
"""s in which several fish, started beside the optimiser, may appear without a word about it."""
_FIRST_WORD = 15.0
"""s for which the first trial waits at most for a plant's first word, which tells the limits of the gait."""
_DISCOVERY = 0.5
"""s before the first trial: a second plant must have been seen before the first one is spoken to."""


_NO_SCORE = {Outcome.FAILED, Outcome.INTERRUPTED}
"""Of a trial that is made again."""


class Optimizer:
    """The node: gives each fish its next trial, keeps the journal, and says how the study goes."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Declare parameters, open the study, offer topics and services.

        Args:
            clock: Time in s, which never goes back.

        Raises:
            ValueError: A parameter that is refused, or a study that cannot be gone on with.
        """
        self._clock = clock
        self.node = Node(OPTIMIZER, namespace=topics.NAMESPACE)
        given = NodeParameters(self.node, OPTIMIZER_PARAMETERS, validate=StudyPlan.from_parameters).values
        self._plan = StudyPlan.from_parameters(given)
        self._study = self._plan.study()
        self._mode = Mode.RUNNING if self._plan.autostart else Mode.HOLDING
        self._exit_code: int | None = None
        self._failures_in_a_row = 0
        self._health_due = self._show_due = 0.0
        self._start_at = clock() + _DISCOVERY
        self._metadata = self._study_metadata()
        namespaces = self._plan.plants or [self.node.get_namespace()]
        self._swimmers = [
            Swimmer.of(self.node, each, self._conditions(), self._plan.minimum_free, clock) for each in namespaces
        ]
        self._announcers = {each: Announcer(self.node, each) for each in namespaces}
        self._records: dict[Swimmer, TrialRecord] = {}
        self._unwritten: dict[Swimmer, Result] = {}
        self._left_out: dict[str, str] = {}
        self._left_out_at = 0.0
        self._offer()
        several = len(self._swimmers) > 1
        self._display = display(sys.stdout, self._total, self._study.settled(), several=several, clock=clock)
        self._thinking = Thinking(self._plan.search, self._plan.stop_regret, self._display)
        self._greet()

    @property
    def _total(self) -> int:
        return self._plan.trials

    def _offer(self) -> None:
        def publisher(topic: Topic[Any]) -> Publisher:
            return self.node.create_publisher(topic.type, topic.name, topic.qos)

        self._progress_topic = publisher(topics.PROGRESS)
        self._diagnostics_topic = publisher(topics.DIAGNOSTICS)
        self.node.create_service(Trigger, "~/start", self._on_start)
        self.node.create_service(Trigger, "~/pause", self._on_pause)
        self.node.create_service(Trigger, "~/stop", self._on_stop)
        self.node.create_service(Trigger, "~/repeat", self._on_repeat)

    def _greet(self) -> None:
        self._display.say(f"study {near(self._study.folder)}: {counted(self._total, 'fin')}, seed {self._plan.seed}")
        if done := len(self._study.trials):
            self._display.say(f"going on after {counted(done, 'trial')}, {show_best(self._study.best())}")
            for repair in repair_bags(self._study.folder, or_nothing=True):
                self._display.say(f"note: {repair}")
            for note in check_scores(self._study.folder, self._study.trials):
                self._display.say(f"warning: {note}")
        for note in self._study.notes:
            self._display.say(f"note: {note}")
        if self._mode is Mode.HOLDING:
            service = f"{self.node.get_fully_qualified_name()}/start"
            self._display.say(f"holding: begin with `control start` of fin_optimizer, or by a call of {service}")

    # -- services ----------------------------------------------------------------------------------------------------

    def _on_start(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._mode in {Mode.HOLDING, Mode.PAUSING}
        response.message = "started" if response.success else f"nothing to start: {self._mode.value}"
        if response.success:
            self._mode = Mode.RUNNING
            self._failures_in_a_row = 0
        return response

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._mode in {Mode.RUNNING, Mode.PAUSING}
        response.message = "pausing after this trial" if response.success else f"nothing to pause: {self._mode.value}"
        if response.success:
            self._mode = Mode.PAUSING
        return response

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._mode is not Mode.DONE
        response.message = "stopping" if response.success else "the study is done"
        if response.success:
            self._mode = Mode.STOPPING
        return response

    def _on_repeat(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        busy = [swimmer for swimmer in self._swimmers if swimmer.trial is not None]
        if self._mode in {Mode.STOPPING, Mode.DONE} or not self._study.trials:
            response.success = False
            response.message = "nothing to repeat: " + (self._mode.value if self._study.trials else "no trial yet")
            return response
        try:
            number = self._repeat(busy)
        except StudyError as error:
            self._give_up(str(error))
            response.success, response.message = False, str(error)
            return response
        when = "" if self._mode is Mode.RUNNING else ", once the study goes on"
        response.success, response.message = True, f"{trial_name(number)} is swum again{when}"
        self._display.say(f"{response.message}: ~/repeat was called")
        return response

    def _repeat(self, busy: Sequence[Swimmer]) -> int:
        """Let the newest trial under way, or else the last one that ended, be swum again; return its number.

        Raises:
            StudyError: The disk refused.
        """
        if not busy:
            number = len(self._study.trials) - 1
            self._study.repeat(number)
            self._publish_progress()
            return number
        swimmer = max(busy, key=lambda each: self._records[each].number)
        number, failures = self._records[swimmer].number, self._failures_in_a_row
        if result := swimmer.cancel(ASKED_FOR_AGAIN, self._clock()):
            self._unwritten[swimmer] = result
            self._end_trials()
            self._failures_in_a_row = failures  # somebody's wish is none
        self._study.repeat(number)
        return number

    # -- the loop ----------------------------------------------------------------------------------------------------

    def step(self) -> float:
        """Do what is due; return how long the executor may wait for a callback."""
        try:
            return self._step(self._clock())
        except StudyError as error:
            self._give_up(str(error))
            return _IDLE_PERIOD

    def _step(self, now: float) -> float:
        if now >= self._health_due:
            self._health_due = now + _HEALTH_PERIOD
            self._publish_health()
        wait = _IDLE_PERIOD
        for swimmer in self._swimmers:
            if result := swimmer.advance(now):
                self._unwritten[swimmer] = result
                self._end_trials()
                wait = 0.0
            wait = min(wait, swimmer.pause(now))
        busy = [swimmer for swimmer in self._swimmers if swimmer.trial is not None]
        if busy and now >= self._show_due:
            self._show_due = now + _SHOW_PERIOD
            self._display.show(busy[0].phase, busy[0].note)
            for swimmer in busy:
                if waiting := swimmer.waits_for(now):
                    self._display.say(f"{swimmer.namespace} waits: {waiting} (answer with fin_servo_driver's operator)")
        if self._mode is Mode.STOPPING:
            self._cancel("~/stop was called")
            self._finish(EXIT_OK)
        elif self._mode is Mode.PAUSING and not busy:
            self._mode = Mode.HOLDING
        elif self._mode is Mode.RUNNING and now >= self._start_at and len(busy) < len(self._swimmers):
            held = self._thinks()
            return self._begin_trials(now, wait) if held is None else held
        return wait

    def _begin_trials(self, now: float, wait: float) -> float:
        """Give every fish without a trial its next one; return how long to wait then, in s."""
        for swimmer in self._swimmers:
            if swimmer.trial is not None or not self._takes_part(swimmer):
                continue
            if swimmer.plant.state is None and now - self._start_at < min(_FIRST_WORD, self._plan.timeouts.find):
                continue  # its limits are looked at before anything is proposed
            if refusal := swimmer.cut_gait or swimmer.untold:
                self._give_up(f"{swimmer.namespace}: {refusal}")
                return _IDLE_PERIOD
            if missing := shortage(self._study.folder, self._plan.minimum_free):
                self._give_up(missing)
                return _IDLE_PERIOD
            is_left = partial(is_for_another, plant=swimmer.namespace, plants=self._taking_part())
            following = self._study.next_candidate(self._plan.search, self._total, is_left=is_left)
            if following is None:  # what it depends on is still swimming
                continue
            record = self._study.propose(*following, swimmer.namespace)
            self._begin(swimmer, self._study.start(record.number))
            self._display.begin(record)
            wait = 0.0
        if self._left_out and len(self._left_out) == len(self._swimmers):
            self._all_left_out()
        return wait

    def _thinks(self) -> float | None:
        """Return how long to wait as no trial is due: the study is complete, or the search simulates; else None."""
        if self._study.settled() >= self._total:
            self._complete("the study is complete")
            return _IDLE_PERIOD
        if self._thinking.goes_on(self._study.history):
            return 0.0
        if not self._thinking.knows_enough(self._study.history):
            return None
        if all(swimmer.trial is None for swimmer in self._swimmers):
            self._complete("enough is known")
        return _IDLE_PERIOD

    def _complete(self, why: str) -> None:
        """End the study; a search that simulates says how sure it is of its best."""
        self._cancel(why)
        if conclusion := self._thinking.conclusion(self._study.history):
            self._display.say(f"{why}; {conclusion}")
        self._finish(EXIT_OK)

    def _begin(self, swimmer: Swimmer, record: TrialRecord) -> None:
        started = record.started.isoformat() if record.started is not None else ""
        gait = self._plan.gait_of(record.values)
        joints = {f"gait.joint_{i}": repr(joint) for i, joint in enumerate(gait.joints, start=1)}
        told = {
            "trial.candidate": str(record.candidate),
            VALUES: json.dumps(record.values),
            "trial.started": started,
            **self._metadata,
            **joints,
        }
        self._records[swimmer] = record
        fin, bag = self._plan.fin_of(record.values), self._study.folder / record.bag
        swimmer.begin(record.number, fin, bag, told, (gait, self._plan.measurement_of(gait)))
        self._announcers[swimmer.namespace].tell(record)

    def _taking_part(self) -> list[str]:
        return [swimmer.namespace for swimmer in self._swimmers if swimmer.namespace not in self._left_out]

    def _takes_part(self, swimmer: Swimmer) -> bool:
        """Whether the fish gets trials. The only one always does: what ails it is the trial's to find and to tell."""
        if len(self._swimmers) == 1:
            return True
        trouble = swimmer.trouble
        before = self._left_out.get(swimmer.namespace, "")
        if trouble and not before and self._clock() - self._start_at < _ARRIVAL:
            return False  # it may still be starting
        if trouble and not before:
            self._left_out[swimmer.namespace] = trouble
            self._left_out_at = self._clock()
            self._display.say(f"{swimmer.namespace} does not take part: {trouble}")
        elif before and not trouble:
            del self._left_out[swimmer.namespace]
            self._display.say(f"{swimmer.namespace} takes part")
        return not trouble

    def _all_left_out(self) -> None:
        busy = any(swimmer.trial is not None for swimmer in self._swimmers)
        if not busy and self._clock() - self._left_out_at > self._plan.timeouts.find:
            self._give_up(f"no fish is left: {'; '.join(self._left_out.values())}")

    def _end_trials(self) -> None:
        """Write the results into the journal; one that it refuses is tried again later."""
        while self._unwritten:
            self._end_trial(*next(iter(self._unwritten.items())))

    def _end_trial(self, swimmer: Swimmer, result: Result) -> None:
        record = self._study.finish(self._records[swimmer].number, result)
        del self._records[swimmer], self._unwritten[swimmer]
        while swimmer.notes:
            self._display.say(swimmer.notes.pop(0))
        self._display.end(record, self._study.settled(), self._study.best())
        self._announcers[swimmer.namespace].tell(record)
        self._publish_progress()
        self._failures_in_a_row = self._failures_in_a_row + 1 if record.outcome in _NO_SCORE else 0
        stopped = self._mode not in {Mode.RUNNING, Mode.PAUSING}
        if swimmer.other_fish and not stopped:
            self._give_up(f"{swimmer.other_fish}. Use the same, or another study_folder")
        elif self._failures_in_a_row >= self._plan.failures_in_a_row and not stopped:
            self._give_up(f"{self._failures_in_a_row} trials in a row FAILED or were INTERRUPTED")

    def _cancel(self, reason: str) -> None:
        now = self._clock()
        for swimmer in self._swimmers:
            if result := swimmer.cancel(reason, now):
                self._unwritten[swimmer] = result
        self._end_trials()

    def _give_up(self, why: str) -> None:
        """Leave the study where it is, with every fish at rest, because it cannot go on."""
        if self._mode is Mode.DONE:
            return
        self._mode = Mode.DONE
        self._display.say(error_line(OPTIMIZER, f"{why}: the study is left here"))
        with contextlib.suppress(StudyError):  # the same disk may refuse the same again
            self._cancel(why)
        self._finish(EXIT_FAILURE)

    def _conditions(self) -> Conditions:
        plan = self._plan
        return Conditions(
            plan.gait,
            plan.gait.at_rest,
            plan.measurement,
            plan.timeouts,
            plan.settings.goals,
            differences=self._study.keep_or_compare,
        )

    def _study_metadata(self) -> dict[str, str]:
        settings = {f"study.{name}": str(value) for name, value in self._study.settings.flat().items()}
        return {**provenance(), **settings}

    # -- reports -----------------------------------------------------------------------------------------------------

    def _progress_values(self) -> dict[str, object]:
        best, goals = self._study.best(), self._study.settings.goals
        values: dict[str, object] = {
            "mode": self._mode.value,
            "phase": ", ".join(swimmer.phase for swimmer in self._swimmers if swimmer.trial is not None),
            "left out": ", ".join(self._left_out),
            "candidates_settled": self._study.settled(),
            "candidates_wanted": self._total,
            "trials": len(self._study.trials),
            "folder": str(self._study.folder),
            "objective": goals.objective,
            "constraints": BETWEEN_CONSTRAINTS.join(each.text for each in goals.constraints),
        }
        values |= {
            f"unusable stamps {name}": n for swimmer in self._swimmers for name, n in swimmer.unusable_stamps.items()
        }
        if best is not None and best.score is not None:
            values |= {f"best {name}": value for name, value in best.values.items()}
            values["best score [m/s]"] = best.score
        return values

    def _progress_status(self, name: str) -> DiagnosticStatus:
        level = DiagnosticStatus.WARN if self._failures_in_a_row else DiagnosticStatus.OK
        message = f"{self._study.settled()} of {counted(self._total, 'fin')}, {show_best(self._study.best())}"
        values = key_values(self._progress_values())
        study = self._study.folder.name
        return DiagnosticStatus(level=level, name=name, message=message, hardware_id=study, values=values)

    def _publish_progress(self) -> None:
        self._progress_topic.publish(self._progress_status("progress"))

    def _publish_health(self) -> None:
        message = DiagnosticArray(status=[self._progress_status(f"{self.node.get_fully_qualified_name()}: study")])
        message.header.stamp = self.node.get_clock().now().to_msg()
        self._diagnostics_topic.publish(message)

    # -- the end -----------------------------------------------------------------------------------------------------

    def _finish(self, code: int) -> None:
        """Write the report, say what was found, and end the process if it should end with the study."""
        self._mode = Mode.DONE
        self._publish_progress()
        self._display.close()
        for line in [*final_report.write_report(self._study), *final_report.findings(self._study)]:
            self._display.say(line)
        if self._study.best() is None:
            code = code or EXIT_FAILURE
        if self._plan.exit_when_done:
            self._exit_code = code

    def finished(self) -> int | None:
        """Return the exit code once the study is done."""
        return self._exit_code

    def close(self) -> None:
        """Leave everything safe: the gaits off, the bags closed, the journal and the table complete."""
        with contextlib.ExitStack() as last:
            last.callback(self._study.close)
            for swimmer in self._swimmers:
                last.callback(self._close_swimmer, swimmer)
            last.callback(self._write_last_table)
            last.callback(self._say_how_to_go_on)
            last.callback(self._display.close)
            for swimmer in self._swimmers:
                last.callback(swimmer.plant.farewell)
            try:
                self._cancel("the optimiser was stopped")
            except StudyError as error:
                self._display.say(error_line(OPTIMIZER, error))

    def _close_swimmer(self, swimmer: Swimmer) -> None:
        try:
            swimmer.destroy()
        except BagError as error:
            self._display.say(error_line(OPTIMIZER, error))

    def _write_last_table(self) -> None:
        try:
            final_report.write_table(self._study)
        except OSError as error:
            self._display.say(error_line(OPTIMIZER, f"{CSV_FILE} cannot be written: {error.strerror or error}"))

    def _say_how_to_go_on(self) -> None:
        if self._mode is not Mode.DONE:
            for line in final_report.how_to_go_on(self._study):
                self._display.say(line)


def main(args: list[str] | None = None) -> int:
    """Run the optimiser node."""
    return node_process.run(Optimizer, args)


if __name__ == "__main__":
    sys.exit(main())
