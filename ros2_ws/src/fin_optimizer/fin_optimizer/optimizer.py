"""The optimiser's node: proposes fins, has the plant swim them, scores and records each swim, and says how it goes."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from enum import Enum
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from fin_optimizer import report
from fin_optimizer.bag import BagError
from fin_optimizer.curve import simulated_speed
from fin_optimizer.graph import OPTIMIZER, OPTIMIZER_PARAMETERS, SIMULATOR, SIMULATOR_PARAMETERS
from fin_optimizer.observation import Observation
from fin_optimizer.plan import Plan
from fin_optimizer.plant_client import PlantClient
from fin_optimizer.progress import display, show_best
from fin_optimizer.provenance import provenance
from fin_optimizer.recorder import Recorder
from fin_optimizer.score import ScoreError, score
from fin_optimizer.trial import Action, Outcome, Result, Trial
from fin_plant import node_process, topics
from fin_plant.messages import key_values
from fin_plant.node_parameters import NodeParameters

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from rclpy.publisher import Publisher

    from fin_optimizer.study import TrialRecord
    from fin_plant.topics import Topic

_GAIT_PERIOD = 0.25
"""s; the plant's command_timeout is twice that."""
_HEALTH_PERIOD = 1.0
_LOOK_PERIOD = 0.02
"""s between two looks at facts that come without a callback: the graph, and time itself."""
_SWIM_LOOK_PERIOD = 0.002
"""s between two looks at the newest velocity: a swim far faster than real time must not go on after its window."""
_IDLE_PERIOD = 0.1
_DISCOVERY = 0.5
"""s before the first trial: a second plant must have been seen before the first one is spoken to."""


class Mode(Enum):
    """What the optimiser is about."""

    HOLDING = "holding: call ~/start"
    RUNNING = "running"
    PAUSING = "pausing after this trial"
    STOPPING = "stopping"
    DONE = "done"


class Optimizer:
    """The node: turns a trial's actions into messages, calls and files, and a trial's end into the next one."""

    def __init__(self) -> None:
        """Declare parameters, open the study, offer topics and services.

        Raises:
            ValueError: A parameter that is refused, or a study that cannot be gone on with.
        """
        self.node = Node(OPTIMIZER, namespace=topics.NAMESPACE)
        self._plan = Plan(NodeParameters(self.node, OPTIMIZER_PARAMETERS, validate=Plan).values)
        self._study = self._plan.study()
        self._mode = Mode.RUNNING if self._plan.values["autostart"] else Mode.HOLDING
        self._exit_code: int | None = None
        self._trial: Trial | None = None
        self._record: TrialRecord | None = None
        self._failures_in_a_row = 0
        self._asked_parameters = False
        self._gait_due: float | None = None
        self._health_due = self._look_due = 0.0
        self._start_at = time.monotonic() + _DISCOVERY
        self._plant = PlantClient(self.node)
        self._recorder = Recorder(self.node)
        self._facts = Observation(self.node, self._plant, self._recorder)
        self._metadata = self._study_metadata()
        self._offer()
        self._display = display(sys.stdout, self._total, self._study.settled())
        self._greet()

    @property
    def _total(self) -> int:
        return self._plan.count("trials")

    def _offer(self) -> None:
        def publisher(topic: Topic[Any]) -> Publisher:
            return self.node.create_publisher(topic.type, topic.name, topic.qos)

        self._candidate_topic = publisher(topics.CANDIDATE)
        self._score_topic = publisher(topics.SCORE)
        self._progress_topic = publisher(topics.PROGRESS)
        self._diagnostics_topic = publisher(topics.DIAGNOSTICS)
        self.node.create_service(Trigger, "~/start", self._on_start)
        self.node.create_service(Trigger, "~/pause", self._on_pause)
        self.node.create_service(Trigger, "~/stop", self._on_stop)

    def _greet(self) -> None:
        self._display.say(f"study {_near(self._study.folder)}: {self._total} trials, seed {self._plan.count('seed')}")
        if done := len(self._study.trials):
            self._display.say(f"going on after {done} trials, {show_best(self._study.best())}")
        for note in self._study.notes:
            self._display.say(f"note: {note}")

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

    # -- the loop ----------------------------------------------------------------------------------------------------

    def step(self) -> float:
        """Do what is due; return how long the executor may wait for a callback."""
        now = time.monotonic()
        self._repeat_gait(now)
        if now >= self._health_due:
            self._health_due = now + _HEALTH_PERIOD
            self._publish_health()
        if self._mode is Mode.STOPPING:
            self._cancel("~/stop was called")
            self._finish(node_process.EXIT_OK)
        elif self._trial is not None:
            return self._advance(now, self._trial)
        elif self._mode is Mode.PAUSING:
            self._mode = Mode.HOLDING
        elif self._mode is Mode.RUNNING and now >= self._start_at:
            self._begin_trial()
            return 0.0
        return _IDLE_PERIOD

    def _advance(self, now: float, trial: Trial) -> float:
        """Take the trial as far as the facts allow; return how long to wait for new ones."""
        if self._plant.changed or now >= self._look_due:
            self._plant.changed = False
            before = None
            while trial.result is None and trial.phase != before:
                before = trial.phase
                for action in trial.update(now, self._facts):
                    self._carry_out(action)
            period = _SWIM_LOOK_PERIOD if trial.window is not None else _LOOK_PERIOD
            self._look_due = time.monotonic() + period
            self._display.show(trial.phase, f"{trial.swum(self._facts):.0f} s" if trial.window is not None else "")
        if trial.result is not None:
            self._end_trial(trial.result)
            return 0.0
        return max(0.0, self._look_due - time.monotonic())

    def _begin_trial(self) -> None:
        if self._study.settled() >= self._total:
            self._finish(node_process.EXIT_OK)
            return
        candidate, values = self._study.next_candidate(self._plan.search)
        record = self._study.propose(candidate, values)
        self._record = self._study.start(record.number)
        self._facts.bag_error, self._facts.result = "", None
        namespace = self.node.get_namespace()
        self._trial = Trial(namespace, self._plan.fin_of(values), self._plan.measurement, self._plan.timeouts)
        self._facts.trial = self._trial
        self._look_due = 0.0
        self._display.begin(self._record)
        self._publish_candidate(self._record)

    def _end_trial(self, result: Result) -> None:
        if self._record is None:
            return
        record = self._study.finish(self._record.number, result)
        self._trial = self._facts.trial = self._record = None
        self._display.end(record, self._study.settled(), self._study.best())
        self._publish_candidate(record)
        self._publish_progress()
        if record.score is not None:
            self._score_topic.publish(Float64(data=record.score))
            self._learn_simulator()
        self._failures_in_a_row = self._failures_in_a_row + 1 if record.outcome is Outcome.FAILED else 0
        if self._failures_in_a_row >= self._plan.count("failures_in_a_row") and not record.interrupted:
            self._display.say(f"error: {self._failures_in_a_row} trials in a row FAILED: the study is left here")
            self._finish(node_process.EXIT_FAILURE)

    def _learn_simulator(self) -> None:
        """Ask a simulated plant, once, which fish it swims: the report draws the sweep of the same fish."""
        simulated = self._plant.state is not None and self._plant.state.plant == SIMULATOR
        if simulated and not self._asked_parameters:
            self._asked_parameters = True
            self._plant.ask_parameters(tuple(SIMULATOR_PARAMETERS))

    def _cancel(self, reason: str) -> None:
        if self._trial is None:
            return
        for action in self._trial.cancel(reason):
            self._carry_out(action)
        if self._trial.result is not None:
            self._end_trial(self._trial.result)

    # -- a trial's actions -------------------------------------------------------------------------------------------

    def _carry_out(self, action: Action) -> None:
        if self._trial is None or self._record is None:
            return
        match action:
            case Action.SET_FIN:
                self._plant.set_fin(self._trial.fin)
            case Action.RESET | Action.RECOVER:
                self._plant.reset()
            case Action.GAIT_ON:
                self._gait_due = 0.0
                self._repeat_gait(time.monotonic())
            case Action.GAIT_OFF:
                self._gait_due = None
                self._plant.send(self._plan.no_gait)
            case Action.OPEN_BAG | Action.CLOSE_BAG:
                try:
                    if action is Action.OPEN_BAG:
                        self._recorder.open(self._study.folder / self._record.bag, self._bag_metadata(self._record))
                    else:
                        self._recorder.close()
                except BagError as error:
                    self._facts.bag_error = str(error)
            case Action.SCORE:
                self._facts.result = self._scored(self._trial)

    def _repeat_gait(self, now: float) -> None:
        if self._gait_due is not None and now >= self._gait_due:
            self._gait_due = now + _GAIT_PERIOD
            self._plant.send(self._plan.gait)

    def _scored(self, trial: Trial) -> Result:
        if trial.window is None:
            return Result(Outcome.FAILED, "the fish never swam")
        try:
            scored = score(*self._recorder.velocity_samples(), trial.window, block=self._plan.measurement.block)
        except ScoreError as error:
            return Result(Outcome.FAILED, error.reason)
        spread = scored.spread if math.isfinite(scored.spread) else None
        return Result(Outcome.OK, score=scored.value, spread=spread, samples=scored.samples)

    def _study_metadata(self) -> dict[str, str]:
        settings = {f"study.{name}": str(value) for name, value in self._study.settings.flat().items()}
        gait = {f"gait.joint_{i}": repr(joint) for i, joint in enumerate(self._plan.gait.joints, start=1)}
        return {**provenance(), **settings, **gait, **self._plan.measurement.metadata()}

    def _bag_metadata(self, record: TrialRecord) -> dict[str, str]:
        state = self._plant.state
        trial = {"trial.number": str(record.number), "trial.candidate": str(record.candidate)}
        plant = {"plant": state.plant, **state.fin} if state is not None else {}
        return {**trial, **plant, **self._metadata}

    # -- reports -----------------------------------------------------------------------------------------------------

    def _publish_candidate(self, record: TrialRecord) -> None:
        values = {
            "trial": record.number,
            "candidate": record.candidate,
            **record.values,
            "outcome": record.outcome.value,
        }
        if record.score is not None:
            values["score [m/s]"] = record.score
        if record.reason:
            values["reason"] = record.reason
        level = DiagnosticStatus.WARN if record.outcome in {Outcome.FAILED, Outcome.INFEASIBLE} else DiagnosticStatus.OK
        shown = f"trial {record.number}: {report.show_values(record.values)}"
        self._candidate_topic.publish(
            DiagnosticStatus(level=level, name="candidate", message=shown, values=key_values(values))
        )

    def _progress_values(self) -> dict[str, object]:
        best = self._study.best()
        values: dict[str, object] = {
            "mode": self._mode.value,
            "phase": self._trial.phase if self._trial is not None else "",
            "candidates_settled": self._study.settled(),
            "candidates_wanted": self._total,
            "trials": len(self._study.trials),
            "folder": str(self._study.folder),
        }
        if best is not None and best.score is not None:
            values |= {f"best {name}": value for name, value in best.values.items()}
            values["best score [m/s]"] = best.score
        return values

    def _progress_status(self, name: str) -> DiagnosticStatus:
        level = DiagnosticStatus.WARN if self._failures_in_a_row else DiagnosticStatus.OK
        message = f"{self._study.settled()} of {self._total}, {show_best(self._study.best())}"
        return DiagnosticStatus(level=level, name=name, message=message, values=key_values(self._progress_values()))

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
        self._write_table()
        best = self._study.best()
        if best is not None and best.score is not None:
            self._draw()
            scored = sum(trial.score is not None for trial in self._study.trials)
            words = f"{report.show_values(best.values)} swims {report.show_speed(best.score)}"
            self._display.say(f"best of {scored} trials: {words}")
        else:
            self._display.say("no trial gave a score")
            code = code or node_process.EXIT_FAILURE
        self._display.say(f"results: {_near(self._study.folder)}/ ({', '.join(self._results())})")
        if self._plan.values["exit_when_done"]:
            self._exit_code = code

    def _results(self) -> Sequence[str]:
        names = (report.CSV_FILE, report.FIGURE_FILE, "journal.log", "bags")
        return [name for name in names if (self._study.folder / name).exists()]

    def _write_table(self) -> None:
        report.write_table(
            self._study.folder / report.CSV_FILE, self._study.trials, self._study.settings.space.dimensions
        )

    def _draw(self) -> None:
        plan, curve = self._plan, None
        if self._plant.parameters:
            curve = report.sweep(
                plan.dimension,
                simulated_speed(plan.dimension.name, plan.fin, plan.gait, plan.measurement, self._plant.parameters),
            )
        joint = plan.gait.joints[0]
        title = (
            f"fin {plan.fin.length * 100:g} x {plan.fin.height * 100:g} cm x {plan.fin.thickness * 1000:g} mm, "
            f"{joint.frequency:g} Hz, swims of {plan.measurement.duration:g} s"
        )
        path = self._study.folder / report.FIGURE_FILE
        report.write_figure(path, self._study.trials, self._study.best(), plan.dimension, curve=curve, title=title)

    def finished(self) -> int | None:
        """Return the exit code once the study is done."""
        return self._exit_code

    def close(self) -> None:
        """Leave everything safe: the gait off, the bag closed, the journal and the table complete."""
        with contextlib.ExitStack() as last:
            last.callback(self._study.close)
            last.callback(self._recorder.destroy)
            last.callback(self._write_table)
            last.callback(self._say_how_to_go_on)
            last.callback(self._display.close)
            last.callback(self._plant.farewell)
            self._cancel("the optimiser was stopped")

    def _say_how_to_go_on(self) -> None:
        if self._mode is not Mode.DONE:
            count, folder = len(self._study.trials), _near(self._study.folder)
            self._display.say(f"stopped after {count} trials, all in the journal; go on with study_folder:={folder}")


def _near(folder: Path) -> str:
    """Return the folder as seen from the current directory, where that is shorter."""
    return min(str(folder), os.path.relpath(folder), key=len)


def main(args: list[str] | None = None) -> int:
    """Run the optimiser node."""
    return node_process.run(Optimizer, args)


if __name__ == "__main__":
    sys.exit(main())
