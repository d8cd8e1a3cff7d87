"""What the operator is told to do, how a fin is shown, and how a servo is calibrated at the bench."""

from __future__ import annotations

import io
import math
import sys
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from fin_plant.fin import FIN_PARAMETERS, Fin
from fin_plant.plant_state import PlantState, State
from fin_servo_driver import calibrate_servo, robot_file
from fin_servo_driver.calibration import Calibration, Leave
from fin_servo_driver.emulator.devices import Firmata
from fin_servo_driver.fin_instruction import instruction, material, sizes
from fin_servo_driver.robot_file import ServoJoint
from fin_servo_driver.robot_states import NOT_THERE
from support.waiting import wait_until
from support.wire import Wire

operator = pytest.importorskip("fin_servo_driver.operator")

if TYPE_CHECKING:
    from pathlib import Path

JOINT = ServoJoint(9, 1500, 1, 573, 1200, 1800)


def state(name: State, reason: str = "", waiting_for: str = "") -> PlantState:
    return PlantState(name, "robot", 1, reason, {}, {"waiting_for": waiting_for})


@pytest.mark.parametrize(
    ("given", "says", "action"),
    [
        (None, "Waiting for the servo driver", ""),
        (state(State.WAITING_FOR_RESET, "port /dev/x is absent", "configuring"), "open the port", "configure"),
        (state(State.FAULT, "the emergency stop is latched"), "press r", ""),
        (state(State.FAULT, f"the emergency stop is latched; {NOT_THERE}"), "has not reached the device", ""),
        (state(State.FAULT, f"the emergency stop is latched; {NOT_THERE}"), "use the switch", ""),
        (state(State.WAITING_FOR_RESET, "2 plants publish", "being alone"), "End the other plant", ""),
        (state(State.FAULT, "/dev/x was lost"), "reconnects by itself", ""),
        (state(State.FAULT, "the driver's I/O thread has failed: KeyError(3)"), "start it anew", ""),
        (state(State.WAITING_FOR_FIN, waiting_for="fin"), "Mount this fin", "confirm_fin"),
        (state(State.WAITING_FOR_RESET, waiting_for="arming"), "ARM", "activate"),
        (state(State.WAITING_FOR_RESET, waiting_for="mark"), "back to its mark", "confirm_mark"),
        (state(State.READY), "Nothing to do", ""),
        (state(State.SWIMMING), "The space bar stops", ""),
    ],
)
def test_the_operator_is_told_what_to_do(given: PlantState | None, says: str, action: str) -> None:
    advice, chosen = operator.next_step(given)
    assert says in advice
    assert chosen == action


def waiting_for_fin(**sizes_of_fin: float) -> PlantState:
    """Return the state of a driver that waits for this fin."""
    values = {f"fin.{name}": value for name, value in sizes_of_fin.items()}
    wanted = {**{name: parameter.default for name, parameter in FIN_PARAMETERS.items()}, **values}
    details = {f"wanted.{name}": v if isinstance(v, str) else repr(v) for name, v in wanted.items()}
    reason = f"mount the fin: {instruction(Fin.from_parameters(wanted))}"
    return PlantState(State.WAITING_FOR_FIN, "robot", 1, reason, {}, {"waiting_for": "fin", **details})


def shown(given: PlantState | None, width: int = 100, height: int = 30, silence: float = 0.0, answer: str = "") -> str:
    """Return what a terminal of this size shows."""
    console = Console(width=width, height=height, file=io.StringIO(), record=True)
    device = {"connected": "True", "identity": "Firmata protocol 2.5", "voltage": "not reported", "fault": ""}
    console.print(operator.screen(given, device, answer, silence))
    return "\n".join(console.export_text().splitlines()[:height])


def test_the_fin_is_shown_as_a_person_would_cut_it() -> None:
    text = shown(waiting_for_fin(young_modulus=2.35e9, length=0.07, height=0.03, tip_height=0.05), answer="done")
    for part in ("2.35 GPa (about polycarbonate)", "70.0 mm", "30.0 mm at 0.0 mm - 50.0 mm at 70.0 mm", "0.208 mm"):
        assert part in text
    assert "EMERGENCY STOP" in text
    assert "not reported" not in text


def test_a_material_whose_name_has_a_comma_is_shown_in_one_line() -> None:
    assert "E = 3.5 MPa (about silicone rubber, 60 Shore A)" in shown(waiting_for_fin(young_modulus=3.5e6))


@pytest.mark.parametrize(
    "given",
    [
        None,
        waiting_for_fin(young_modulus=3.5e6, height=0.03, tip_height=0.05),
        state(State.FAULT, "the emergency stop is latched: release it with ~/estop false"),
        state(State.READY),
    ],
)
def test_a_terminal_of_forty_columns_shows_what_to_do_and_every_key(given: PlantState | None) -> None:
    text = " ".join(shown(given, 40, 24).replace("│", " ").split())
    for part in (operator.next_step(given)[0], "SPACE BAR: EMERGENCY STOP", "[Enter]", "[r]", "[d]", "[q] quit"):
        assert part in text
    assert "~/estop" not in text


def test_where_no_driver_speaks_it_is_shown_what_is_seen_instead_below_the_keys() -> None:
    console = Console(width=60, record=True, file=io.StringIO())
    console.print(operator.screen(None, {}, "", seen="nobody publishes topic /fish/plant_state"))
    text = console.export_text()
    assert text.index("EMERGENCY STOP") < text.index("nobody publishes topic /fish/plant_state")


def test_a_driver_that_has_fallen_silent_is_not_shown_as_it_was() -> None:
    text = shown(state(State.READY), silence=7.0)
    assert "NO ANSWER" in text
    assert "Nothing from the driver for 7 s" in text
    assert "READY" not in text
    assert "READY" in shown(state(State.READY), silence=1.5)


class FakeClient:
    """Notes what is asked."""

    def __init__(self) -> None:
        self.state: PlantState | None = waiting_for_fin()
        self.answer = ""
        self.asked: list[str] = []
        self.silent = 0.0

    def ask(self, action: str) -> None:
        self.asked.append(action)

    def emergency_stop(self, *, on: bool) -> None:
        self.asked.append("STOP" if on else "release")

    def silence(self) -> float:
        return self.silent


@pytest.fixture
def client() -> FakeClient:
    return FakeClient()


@pytest.fixture
def keyboard(client: FakeClient) -> Any:
    """Return a keyboard before which a step stands since 0 s."""
    found = operator.Keyboard(client)
    found.look(0.0)
    return found


def test_enter_confirms_the_step_that_is_shown(keyboard: Any, client: FakeClient) -> None:
    assert not keyboard.typed("\n", 2.0)
    client.state = state(State.WAITING_FOR_RESET, waiting_for="arming")
    keyboard.look(2.1)
    keyboard.typed("\r", 4.0)
    assert client.asked == ["confirm_fin", "activate"]


@pytest.mark.parametrize("times", [[2.0, 2.05], [2.0, 2.3, 2.6, 2.9, 3.2, 3.5, 3.8], [2.0, 2.95]])
def test_an_enter_that_bounces_or_is_held_down_does_not_arm(
    keyboard: Any, client: FakeClient, times: list[float]
) -> None:
    for now in times:
        keyboard.typed("\n\n", now)
        client.state = state(State.WAITING_FOR_RESET, waiting_for="arming")
        keyboard.look(now + 0.01)
    assert client.asked == ["confirm_fin"]


def test_an_enter_that_comes_with_a_new_step_does_nothing(keyboard: Any, client: FakeClient) -> None:
    client.state = state(State.WAITING_FOR_RESET, waiting_for="arming")
    keyboard.look(5.0)
    keyboard.typed("\n", 5.6)
    assert client.asked == []
    assert "read it, then press Enter again" in client.answer
    keyboard.typed("\n", 7.0)
    assert client.asked == ["activate"]


def test_enter_confirms_nothing_of_a_driver_that_has_fallen_silent(keyboard: Any, client: FakeClient) -> None:
    client.silent = 4.0
    keyboard.look(9.0)
    keyboard.typed("\n", 12.0)
    assert (client.asked, client.answer) == ([], "nothing to confirm")


@pytest.mark.parametrize("text", [" ", "\n ", "xx y\n", "\x1b[ d", "     "])
def test_a_space_among_whatever_was_hit_stops_and_nothing_else_counts(
    keyboard: Any, client: FakeClient, text: str
) -> None:
    assert not keyboard.typed(text, 9.0)
    assert client.asked == ["STOP"]


@pytest.mark.parametrize("text", ["x", "\x1b", "\x1b[A", "\x1b[3~", "\x1bd", "\x1bq", "7", "\t", "\ufffd", "ä"])
def test_a_key_that_is_not_known_does_nothing_and_says_so(keyboard: Any, client: FakeClient, text: str) -> None:
    assert not keyboard.typed(text, 9.0)
    assert client.asked == []
    assert "does nothing; there is [Enter]" in client.answer


@pytest.mark.parametrize(
    ("text", "asked"), [("r", "release"), ("R", "release"), ("d", "deactivate"), ("DD", "deactivate")]
)
def test_capital_letters_count_too(keyboard: Any, client: FakeClient, text: str, asked: str) -> None:
    assert not keyboard.typed(text, 9.0)
    assert client.asked == [asked]


def test_q_leaves_but_asks_again_while_the_driver_is_armed(keyboard: Any, client: FakeClient) -> None:
    client.state = state(State.SWIMMING)
    assert not keyboard.typed("q", 10.0)
    assert "the space bar will not stop it" in client.answer
    assert not keyboard.typed("q", 30.0)
    assert keyboard.typed("q", 31.0)
    client.state = waiting_for_fin()
    assert keyboard.typed("Q", 99.0)


def test_sizes_are_in_millimetres() -> None:
    assert sizes(Fin()) == {
        "material": "E = 2 GPa",
        "length": "80.0 mm",
        "height": "25.0 mm",
        "thickness": "0.208 mm",
    }
    profiled = Fin.from_parameters({"fin.profile_position": [0.5], "fin.profile_height": [0.04]})
    assert "25.0 mm at 0.0 mm - 40.0 mm at 40.0 mm - 25.0 mm at 80.0 mm" in instruction(profiled)


def test_a_material_is_named_only_where_it_is_near() -> None:
    assert material(3.6e6) == "E = 3.6 MPa (about silicone rubber, 60 Shore A)"
    assert material(1.4e9) == "E = 1.4 GPa (about polypropylene)"
    assert material(1.0e9) == "E = 1 GPa"


# -- calibration -----------------------------------------------------------------------------------------------------


def calibration() -> Calibration:
    return Calibration(JOINT, 1500.0, 544.0, 2400.0)


def obey(subject: Calibration, *lines: str) -> str:
    return [subject.obey(line) for line in lines][-1]


def test_centre_scale_direction_and_range_come_from_what_is_measured() -> None:
    subject = calibration()
    obey(subject, "= 1450", "c", "= 1300", "a 15", "- 50", "l", "= 1650", "h")
    assert subject.joint.centre == 1450.0
    assert subject.joint.direction == -1
    assert subject.joint.units_per_radian == pytest.approx(150.0 / math.radians(15.0))
    assert (subject.joint.lowest, subject.joint.highest) == (1250.0, 1650.0)
    assert subject.joint.angle_at(1300.0) == pytest.approx(-math.radians(15.0))
    assert subject.summary().endswith("degrees to the right")


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("= 100", r"position 100 is outside the device's range \[544, 2400\]"),
        ("= nan", "no finite number"),
        ("+ inf", "no finite number"),
        ("a 15", "too small to measure by"),
        ("= 1400 ", None),
        ("jump", "'jump' is no command"),
        ("=", "is no command"),
        ("= abc", "'abc' is no number"),
        ("h", "must lie between"),
    ],
)
def test_a_line_that_cannot_be_is_refused_and_changes_nothing(line: str, complaint: str | None) -> None:
    subject = calibration()
    if complaint is None:
        subject.obey(line)
        return
    before = (subject.joint, subject.position)
    with pytest.raises(ValueError, match=complaint):
        subject.obey(line)
    assert (subject.joint, subject.position) == before


@given(st.lists(st.text(alphabet="+-=calhxy 0123456789.e", max_size=8), max_size=20))
def test_no_line_breaks_it_or_leads_beyond_the_device(lines: list[str]) -> None:
    subject = calibration()
    for line in lines:
        try:
            subject.obey(line)
        except ValueError:
            continue
        assert 544.0 <= subject.position <= 2400.0
        assert subject.joint.lowest < subject.joint.centre < subject.joint.highest


@pytest.mark.parametrize(("line", "store"), [("s", True), ("q", False)])
def test_there_are_two_ways_to_leave(line: str, store: bool) -> None:
    with pytest.raises(Leave) as leave:
        calibration().obey(line)
    assert leave.value.store is store


def test_the_program_stores_what_was_measured_and_lets_go_of_the_servo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.yaml"
    robot_file.save(robot_file.load(robot_file.find("firmata")), path)
    board = Firmata()
    monkeypatch.setattr(calibrate_servo, "SerialLine", lambda *_: Wire(board))

    class Person(io.StringIO):
        def __next__(self) -> str:  # type: ignore[override]
            """Wait until the servo has turned before the next command."""
            line = super().__next__()
            wanted = {"c\n": 1520.0, "a 8\n": 1600.0}.get(line)
            if wanted is not None:
                wait_until(lambda: board.outputs.get(9) == wanted, 5.0, f"{wanted} us")
            return line

    monkeypatch.setattr(sys, "stdin", Person("= 1520\nc\nnonsense\n= 1600\na 8\ns\n"))
    assert calibrate_servo.main([str(path)]) == 0
    said = capsys.readouterr().out
    assert "no: 'nonsense' is no command" in said
    assert "stored in" in said
    joint = robot_file.load(path).servos[0]
    assert joint.centre == 1520.0
    assert joint.units_per_radian == pytest.approx(80.0 / math.radians(8.0))
    assert not board.outputs


def test_a_port_in_use_is_an_error_with_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.yaml"
    robot_file.save(robot_file.load(robot_file.find("firmata")), path)
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    assert calibrate_servo.main([str(path), "--port", str(tmp_path / "none")]) == 1
    assert "is absent: is the device plugged in?" in capsys.readouterr().err
    assert calibrate_servo.main([str(path), "--joint", "3"]) == 1
    assert "--joint 3 is not one of the robot's servos, 1 to 1" in capsys.readouterr().err
