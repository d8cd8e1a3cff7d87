"""What a page at the tank is told and offered, whether a press counts, who may, and what is written down."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fin_bringup.page import offers
from fin_bringup.page.access import Access, is_here
from fin_bringup.page.action_log import LOG_FILE, ActionLog, line
from fin_bringup.page.board import MISSED, SILENT, STREAM_SILENT, Board, Missed, Stop, as_json, ended, to_stop
from fin_bringup.page.fish_shape import Piece, Shape, Speedometer, from_joints, from_pieces
from fin_bringup.page.offers import Guard, of_plant, of_study
from fin_optimizer.mode import Mode
from fin_optimizer.study.file_names import SETTINGS_FILE
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.plant_state import EMERGENCY, RELEASE, PlantState, State
from fin_servo_driver.next_step import CALM

if TYPE_CHECKING:
    from pathlib import Path

PLANT = {"/fish/servo_driver": "a"}
STUDY = {"/fish/optimizer": "b"}


def robot(state: State, waiting_for: str = "", reason: str = "", stamp: int = 1) -> PlantState:
    return PlantState(state, "robot", stamp, reason, {}, {"waiting_for": waiting_for})


def waiting_for_fin(length: float = 0.08) -> PlantState:
    values = {name: parameter.default for name, parameter in FIN_PARAMETERS.items()} | {"fin.length": length}
    wanted = {f"wanted.{name}": v if isinstance(v, str) else repr(v) for name, v in values.items()}
    return PlantState(State.WAITING_FOR_FIN, "robot", 1, "mount the fin: ...", {}, {"waiting_for": "fin", **wanted})


def progress(mode: Mode = Mode.RUNNING, **values: str) -> dict[str, str]:
    return {"mode": mode.value, "trials": "3", "folder": "/runs/study", **values}


@pytest.fixture
def board() -> Board:
    """A board that has just heard a robot that waits for a fin, and a study."""
    board = Board("session")
    board.see(PLANT, STUDY, "")
    board.plant_is(waiting_for_fin(), 0.0)
    board.study_is(progress(), "1 of 30 fins", 0.0)
    return board


def actions(board: Board, now: float) -> list[str]:
    return [offer.action for offer in board.offers(now)]


# -- what is told ------------------------------------------------------------------------------------------------------


def test_a_page_is_told_what_to_mount_and_offers_to_say_that_it_is_done(board: Board) -> None:
    told = json.loads(as_json(board.snapshot(0.1)))
    assert told["plant"]["mount"]["length"] == "80.0 mm"
    assert "press the button" in told["plant"]["advice"]
    assert [offer["action"] for offer in told["offers"]] == ["confirm_fin", "pause"]
    assert told["graph"]["lost"] is False


def test_before_anything_is_heard_a_page_says_what_is_seen_instead() -> None:
    board = Board("session")
    board.see({}, {}, "no other node is seen at all")
    told = board.snapshot(0.0)
    assert told["graph"] == {
        "lost": True,
        "text": "Nothing is heard of a fish or a study yet: no other node is seen at all",
    }
    assert told["offers"] == []
    assert board.search()["scores"] == []


def test_a_silent_plant_is_not_live_and_offers_nothing_while_its_study_goes_on(board: Board) -> None:
    later = SILENT + 0.1
    board.study_is(progress(), "2 of 30 fins", later)
    told = json.loads(as_json(board.snapshot(later)))
    assert told["plant"]["live"] is False
    assert "has said nothing for 2 s. The robot may still move" in told["plant"]["advice"]
    assert told["study"]["live"] is True
    assert actions(board, later) == ["pause"]


def test_a_word_in_the_diagnostics_keeps_a_state_alive_that_has_not_changed_for_an_hour(board: Board) -> None:
    board.plant_says(3600.0)
    assert "confirm_fin" in actions(board, 3600.0 + SILENT)
    assert actions(board, 3600.0 + SILENT + 0.1) == []


def test_a_plant_that_is_seen_no_more_is_gone_at_once(board: Board) -> None:
    board.see({}, STUDY, "")
    assert actions(board, 0.1) == ["pause"]
    assert "/fish/servo_driver is gone." in json.dumps(board.snapshot(0.1))


def test_a_graph_that_was_seen_to_swim_is_lost_after_a_second_of_nothing(board: Board) -> None:
    board.plant_is(robot(State.SWIMMING), 10.0)
    board.study_is(progress(), "", 10.0)
    for tenth in range(6):
        board.picture(10.0 + 0.1 * tenth)
    assert not board.lost(10.5 + STREAM_SILENT)
    assert board.lost(10.5 + STREAM_SILENT + 0.01)
    assert "Nothing has come from the graph for 1 s" in json.dumps(board.snapshot(11.6))
    board.other_heard(11.7)
    assert not board.lost(11.7)


def test_a_stopped_fish_that_shows_no_pictures_is_not_missed_before_its_word_is_late(board: Board) -> None:
    for _ in range(9):
        board.picture(0.0)
    board.plant_is(robot(State.FAULT, RELEASE, EMERGENCY), 0.0)
    assert not board.lost(SILENT)
    assert board.lost(SILENT + 0.1)


def test_trials_are_kept_by_number_and_a_study_without_a_score_says_so(board: Board) -> None:
    board.trial_is({"trial": "0", "outcome": "RUNNING"}, "trial 0000", 0.0)
    assert board.search()["scores"] == []
    board.trial_is({"trial": "0", "outcome": "FAILED", "reason": "no velocity"}, "trial 0000", 0.0)
    assert board.search()["scores"] == [(0, None, False)]
    told = json.loads(as_json(board.snapshot(0.0)))
    assert told["trial"]["reason"] == "no velocity"
    board.trial_is({"trial": "1", "outcome": "OK", "score [m/s]": "0.0266"}, "trial 0001", 0.0)
    assert board.search()["scores"] == [(0, None, False), (1, pytest.approx(2.66), True)]
    assert board.search()["best"] == [None, pytest.approx(2.66)]
    assert board.search()["label"] == "mean forward speed (cm/s)"
    assert json.loads(as_json(board.snapshot(0.0)))["trial"]["score"] == "2.660 cm/s"


def test_why_a_trial_has_no_score_is_told_beside_the_next_one_and_not_twice(board: Board) -> None:
    def unscored() -> object:
        return json.loads(as_json(board.snapshot(0.0)))["trial"]["unscored"]

    board.trial_is({"trial": "0", "outcome": "FAILED", "reason": "no velocity"}, "trial 0000: E 2 GPa", 0.0)
    assert unscored() == ""
    board.trial_is({"trial": "1", "outcome": "RUNNING"}, "trial 0001: E 3 GPa", 0.0)
    assert unscored() == "trial 0000: E 2 GPa failed: no velocity"
    board.trial_is({"trial": "1", "outcome": "OK", "score [m/s]": "0.02"}, "trial 0001: E 3 GPa", 0.0)
    assert unscored() == "trial 0000: E 2 GPa failed: no velocity"
    board.study_is(progress(folder="/runs/other"), "", 1.0)
    assert unscored() == ""


@pytest.mark.parametrize(("trials", "button"), [("0", "Start"), ("3", "Go on")])
def test_a_study_that_holds_names_the_button_that_it_waits_for(board: Board, trials: str, button: str) -> None:
    board.study_is(progress(Mode.HOLDING, trials=trials), "", 0.0)
    told = json.loads(as_json(board.snapshot(0.0)))
    assert told["study"]["mode"] == f"stands still: press {button}"
    assert button in {offer["label"] for offer in told["offers"]}


def test_a_simulated_fish_that_stopped_has_no_cable_to_check(board: Board) -> None:
    reason = "a joint has folded; call ~/request_reset"
    board.plant_is(PlantState(State.FAULT, "simulator", 1, reason), 0.0)
    told = json.loads(as_json(board.snapshot(0.0)))["plant"]
    assert "cable" not in told["advice"]
    assert told["reason"] == reason


def test_trials_before_the_page_are_read_at_once_and_what_is_missed_later_after_a_while() -> None:
    missed = Missed()
    assert missed.due("/runs/study", 3, 0.0)
    assert not missed.due("/runs/study", 4, 100.0)  # it is being read
    missed.were_read(1)
    assert not missed.due("/runs/study", 1, 100.0)  # of which nothing is known there
    assert not missed.due("/runs/study", 2, 101.0)
    assert not missed.due("/runs/study", 1, 104.0)  # its word came
    assert not missed.due("/runs/study", 2, 104.0 + 0.9 * MISSED)
    assert missed.due("/runs/study", 2, 104.0 + MISSED)
    assert not missed.due("/runs/other", 0, 200.0)
    assert missed.due("/runs/third", 1, 200.0)


def test_a_study_of_no_or_one_trial_lacks_none(board: Board) -> None:
    for trials, lacking in (("", 0), ("0", 0), ("1", 0), ("2", 1), ("5", 4)):
        board.study_is(progress(trials=trials), "", 0.0)
        assert board.lacking == lacking


def test_another_study_begins_with_no_trials(board: Board) -> None:
    board.trials_were({0: {"mean_speed": 0.02}})
    board.study_is(progress(folder="/runs/other"), "", 1.0)
    assert board.search()["scores"] == []


def test_ten_thousand_trials_are_thinned_and_the_best_is_among_them(board: Board) -> None:
    trials = {number: {"mean_speed": 1e-6 * ((number * 7919) % 10_000)} for number in range(10_000)}
    trials[1234] = {}
    board.trials_were(trials)
    told = json.loads(as_json(board.search()))
    assert len(told["scores"]) <= 400
    assert max(score for _, score, _ in told["scores"]) == pytest.approx(9999e-4)
    assert told["best"][-1] == pytest.approx(9999e-4)
    assert told["trials"] == 10_000


def test_a_score_that_is_no_finite_number_is_none(board: Board) -> None:
    for text in ("nan", "inf", "", "fast"):
        board.trial_is({"trial": "4", "outcome": "OK", "score [m/s]": text}, "", 0.0)
        assert json.loads(as_json(board.search()))["scores"] == [[4, None, False]]


def test_of_a_journal_only_ended_trials_count() -> None:
    good = {"mean_speed": 0.02}
    trials = [(0, "OK", good), (1, "FAILED", {}), (2, "RUNNING", {}), (3, "PROPOSED", {})]
    assert ended(trials) == {0: good, 1: {}}


def test_a_page_shows_the_goal_that_a_study_has_and_which_trials_miss_its_constraints(board: Board) -> None:
    board.study_is(progress(objective="energy_per_metre", constraints="mean_speed >= 2 cm/s"), "", 0.0)
    for number, energy, speed in ((0, 5.0, 0.03), (1, 3.0, 0.01), (2, 4.0, 0.03), (3, 4.5, 0.03)):
        told = {"trial": f"{number}", "outcome": "OK", "score [m/s]": f"{speed}", "energy per metre [J/m]": f"{energy}"}
        board.trial_is(told, "", 0.0)
        if number == 1:
            trial = json.loads(as_json(board.snapshot(0.0)))["trial"]
            assert trial["score"] == "3.000 J/m, mean_speed >= 2 cm/s is missed: 1.000 cm/s"
    found = board.search()
    assert found["label"] == "energy per metre (J/m)"
    assert found["scores"] == [(0, 5.0, True), (1, 3.0, False), (2, 4.0, True), (3, 4.5, True)]
    assert found["best"] == [5.0, 5.0, 4.0, 4.0]


def test_trials_heard_before_the_study_told_its_goal_have_no_score_of_it(board: Board) -> None:
    board.trial_is({"trial": "0", "outcome": "OK", "score [m/s]": "0.02"}, "", 0.0)
    board.study_is(progress(objective="efficiency"), "", 0.0)
    assert board.search()["scores"] == [(0, None, False)]


def test_a_stop_is_for_every_plant_that_is_seen_whatever_service_is_found() -> None:
    robot, simulator = "/fish/servo_driver", "/fish/simulator"
    assert to_stop({robot: True, simulator: False}, [robot], robot) == [robot]
    assert to_stop({robot: False, simulator: True}, [robot, simulator], robot) == [simulator, robot]
    assert to_stop({robot: False, simulator: False}, [], robot) == [robot]
    assert to_stop({robot: False, simulator: False}, [], "") == [robot, simulator]


def test_a_stop_is_heard_when_every_plant_has_answered_and_lost_when_one_has_not() -> None:
    stop = Stop(1, "13:00:00.000", "10.0.0.5", ["/fish/servo_driver"])
    assert stop.told()["state"] == "waiting"
    stop.waiting.clear()
    stop.heard["/fish/servo_driver"] = "after 8.0 ms"
    assert stop.told()["state"] == "heard"
    assert stop.told()["text"] == "heard by /fish/servo_driver, after 8.0 ms"
    stop.lost.append("/fish/other: NO ANSWER")
    assert stop.told()["state"] == "lost"


# -- buttons -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (None, []),
        (robot(State.WAITING_FOR_RESET, "configuring"), ["configure"]),
        (waiting_for_fin(), ["confirm_fin"]),
        (robot(State.WAITING_FOR_RESET, "arming"), ["activate"]),
        (robot(State.WAITING_FOR_RESET, "mark"), ["confirm_mark", "deactivate"]),
        (robot(State.READY), ["deactivate"]),
        (robot(State.SWIMMING), ["deactivate"]),
        (robot(State.FAULT, RELEASE, EMERGENCY), ["release"]),
        (robot(State.FAULT, "device", "/dev/x was lost"), []),
        (PlantState(State.READY, "simulator", 1), []),
        (PlantState(State.FAULT, "simulator", 1, EMERGENCY), ["release"]),
    ],
)
def test_the_buttons_of_a_fish_are_what_its_state_waits_for(state: PlantState | None, expected: list[str]) -> None:
    assert [offer.action for offer in of_plant(state, "s")] == expected


@pytest.mark.parametrize(
    ("mode", "trial", "expected"),
    [
        (Mode.HOLDING, None, ["start"]),
        (Mode.HOLDING, 4, ["start", "repeat"]),
        (Mode.RUNNING, 4, ["pause", "repeat"]),
        (Mode.PAUSING, 4, ["start", "repeat"]),
        (Mode.STOPPING, 4, []),
        (Mode.DONE, 4, []),
    ],
)
def test_the_buttons_of_a_study_are_what_its_mode_allows(mode: Mode, trial: int | None, expected: list[str]) -> None:
    assert [offer.action for offer in of_study(mode.value, trial, 5, "s")] == expected


def test_what_moves_a_robot_is_held_down_or_was_seen_for_a_second() -> None:
    every = [
        *of_plant(robot(State.WAITING_FOR_RESET, "arming"), "s"),
        *of_plant(robot(State.FAULT, RELEASE, EMERGENCY), "s"),
        *of_study(Mode.HOLDING.value, 1, 1, "s"),
    ]
    told = {offer.action: (offer.calm, offer.told()["hold"]) for offer in every}
    assert told == {"activate": (True, True), "release": (True, True), "start": (True, False), "repeat": (False, True)}


def test_a_key_stands_for_the_server_the_processes_and_the_question() -> None:
    base = robot(State.WAITING_FOR_RESET, "arming")
    keys = {
        of_plant(base, "s")[0].key,
        of_plant(base, "another server or graph")[0].key,
        of_plant(robot(State.WAITING_FOR_RESET, "mark"), "s")[0].key,
    }
    assert len(keys) == 3
    assert of_plant(base, "s") == of_plant(robot(State.WAITING_FOR_RESET, "arming"), "s")


def test_the_same_question_asked_anew_has_another_key_and_told_anew_the_same(board: Board) -> None:
    def key_of(state: PlantState) -> str:
        board.plant_is(state, 0.0)
        return board.offers(0.1)[0].key

    mark, ready = robot(State.WAITING_FOR_RESET, "mark"), robot(State.READY)
    first = key_of(mark)
    assert key_of(robot(State.WAITING_FOR_RESET, "mark", stamp=2)) == first
    key_of(ready)
    assert key_of(mark) != first


def test_a_plant_that_is_started_anew_has_other_keys_though_it_says_the_same(board: Board) -> None:
    before = board.offers(0.1)
    board.see({"/fish/servo_driver": "another process"}, STUDY, "")
    after = board.offers(0.1)
    assert [offer.action for offer in before] == [offer.action for offer in after]
    assert before[0].key != after[0].key
    assert before[1].key == after[1].key


# -- whether a press counts --------------------------------------------------------------------------------------------

ARM = of_plant(robot(State.WAITING_FOR_RESET, "arming"), "s")
KEY = ARM[0].key


def test_a_press_counts_after_the_button_was_seen_for_a_second_by_that_very_page() -> None:
    guard = Guard()
    assert "new step" in guard.refusal(1, KEY, ARM, 0.0)
    guard.seen(1, [KEY], 0.0)
    assert "new step" in guard.refusal(1, KEY, ARM, CALM - 0.01)
    assert guard.refusal(1, KEY, ARM, CALM) == ""
    assert "new step" in guard.refusal(2, KEY, ARM, 10.0)


def test_a_button_that_was_gone_in_between_is_a_new_one() -> None:
    guard = Guard()
    guard.seen(1, [KEY], 0.0)
    guard.seen(1, [], 5.0)
    guard.seen(1, [KEY], 6.0)
    assert "new step" in guard.refusal(1, KEY, ARM, 6.5)
    guard.leave(1)
    assert "new step" in guard.refusal(1, KEY, ARM, 60.0)


def test_a_double_tap_and_a_second_page_press_nothing() -> None:
    guard = Guard()
    for viewer in (1, 2):
        guard.seen(viewer, [KEY], 0.0)
    guard.press(KEY, "10.0.0.5")
    for viewer in (1, 2):
        assert guard.refusal(viewer, KEY, ARM, 2.0) == "ARM: already pressed, by 10.0.0.5"
    guard.answered(KEY, 3.0, accepted=True)
    assert "already pressed" in guard.refusal(1, KEY, ARM, 3.1)


def test_what_was_refused_is_pressed_again_after_a_second() -> None:
    guard = Guard()
    guard.seen(1, [KEY], 0.0)
    guard.press(KEY, "10.0.0.5")
    guard.answered(KEY, 3.0, accepted=False)
    assert "new step" in guard.refusal(1, KEY, ARM, 3.5)
    assert guard.refusal(1, KEY, ARM, 3.0 + CALM) == ""


def test_what_is_asked_no_more_is_not_pressed() -> None:
    guard = Guard()
    guard.seen(1, [KEY], 0.0)
    assert guard.refusal(1, KEY, [], 5.0) == offers.OLD
    assert guard.refusal(1, "made up", ARM, 5.0) == offers.OLD


# -- who may -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "127.8.9.1", "::1", "LOCALHOST"])
def test_at_this_computer_no_token_is_needed(host: str) -> None:
    assert Access.listening_at(host).token == ""


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.20", "::", "lab-pc", "localhost.example"])  # noqa: S104
def test_where_others_reach_it_a_new_token_is_needed(host: str) -> None:
    first, second = Access.listening_at(host), Access.listening_at(host)
    assert len(first.token) >= 16
    assert first.token != second.token
    assert first.knows(first.token)
    for wrong in ("", second.token, first.token[:-1], first.token + "x", "\u00e4"):
        assert not first.knows(wrong)


@pytest.mark.parametrize(
    ("host", "refused"),
    [
        ("localhost:8088", False),
        ("127.0.0.1:8088", False),
        ("[::1]:8088", False),
        ("evil.example:8088", True),
        ("localhost.evil.example", True),
        ("", True),
    ],
)
def test_without_a_token_a_name_that_was_made_to_point_here_is_refused(host: str, *, refused: bool) -> None:
    assert bool(Access().host_refusal(host)) is refused
    assert Access("token").host_refusal(host) == ""


@pytest.mark.parametrize(
    ("origin", "refused"),
    [
        ("http://tank:8088", False),
        ("https://tank:8088", False),
        ("http://TANK:8088", False),
        ("http://tank:9999", True),
        ("http://tank", True),
        ("http://evil.example", True),
        ("null", True),
        ("", True),
        ("file://tank:8088", True),
    ],
)
def test_a_page_of_another_origin_gets_no_socket(origin: str, *, refused: bool) -> None:
    assert bool(Access("token").origin_refusal(origin, "tank:8088")) is refused


@given(st.text())
def test_any_text_is_a_host_that_is_here_or_not(text: str) -> None:
    assert is_here(text) in {True, False}


# -- what is written down ----------------------------------------------------------------------------------------------


def test_a_line_has_time_address_and_deed_whatever_they_hold() -> None:
    when = datetime(2026, 11, 29, 13, 0, 1, 234567, timezone(timedelta(hours=1)))
    assert line(when, "10.0.0.5", "pressed:\tARM\nand more") == (
        "2026-11-29T13:00:01.234+01:00\t10.0.0.5\tpressed: ARM and more\n"
    )


def test_actions_before_the_study_is_known_come_first_in_its_log(tmp_path: Path) -> None:
    (tmp_path / SETTINGS_FILE).write_text("{}")
    complaints: list[str] = []
    log = ActionLog(complaints.append)
    log.note("10.0.0.5", "pressed: EMERGENCY STOP")
    log.study_in(str(tmp_path))
    log.note("10.0.0.6", "pressed: ARM")
    log.close()
    deeds = [text.split("\t")[1:] for text in (tmp_path / LOG_FILE).read_text().splitlines()]
    assert deeds == [["10.0.0.5", "pressed: EMERGENCY STOP"], ["10.0.0.6", "pressed: ARM"]]
    assert complaints == []


def test_a_folder_that_holds_no_study_gets_no_log(tmp_path: Path) -> None:
    log = ActionLog(lambda _: None)
    for folder in (str(tmp_path), "", "relative"):
        log.study_in(folder)
    log.note("10.0.0.5", "pressed: ARM")
    log.close()
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_cannot_be_written_is_told_and_a_link_is_not_followed(tmp_path: Path) -> None:
    study, other = tmp_path / "study", tmp_path / "other"
    study.mkdir()
    (study / SETTINGS_FILE).write_text("{}")
    other.write_text("mine\n")
    (study / LOG_FILE).symlink_to(other)
    complaints: list[str] = []
    log = ActionLog(complaints.append)
    log.study_in(str(study))
    log.note("10.0.0.5", "pressed: ARM")
    log.close()
    assert other.read_text() == "mine\n"
    assert "page.log cannot be written" in complaints[0]


# -- the fish ----------------------------------------------------------------------------------------------------------


def test_the_tail_goes_from_the_body_through_each_link_to_the_fins_end() -> None:
    body = Piece(0.0, 0.0, 0.0, 0.14, 0.045)
    links = [Piece(-0.09, 0.0, 0.0, 0.04, 0.002), Piece(-0.11, -0.02, math.pi / 2, 0.04, 0.002)]
    shape = from_pieces(1, body, links, 1)
    expected = ((-0.07, 0.0), (-0.11, 0.0), (-0.11, -0.04))
    assert [pytest.approx(point) for point in expected] == list(shape.tail)
    assert from_pieces(1, body, [], 0).tail == ()


def test_of_joint_angles_each_turns_all_links_behind_it() -> None:
    shape = from_joints(1, Piece(0.0, 0.0, math.pi, 0.14, 0.045), 0.07, [0.04, 0.08], [0.0, math.pi / 2])
    assert [tuple(point) for point in shape.tail] == [
        pytest.approx((0.07, 0.0)),
        pytest.approx((0.11, 0.0)),
        pytest.approx((0.11, 0.08)),
    ]
    assert shape.driven == 1


@pytest.mark.parametrize("broken", [math.nan, math.inf])
def test_a_fish_that_is_nowhere_is_not_drawn(broken: float) -> None:
    """Of a number that JSON does not know no page can be told."""
    body, link = Piece(0.0, 0.0, 0.0, 0.14, 0.045), Piece(-0.1, 0.0, 0.0, 0.06, 0.002)
    assert from_pieces(1, body, [link], 1).is_finite
    assert not from_pieces(1, replace(body, x=broken), [link], 1).is_finite
    assert not from_pieces(1, body, [replace(link, y=broken)], 1).is_finite


def swum(seconds: float, x: float, y: float = 0.0, heading: float = 0.0) -> Shape:
    return Shape(round(seconds * 1e9), Piece(x, y, heading, 0.14, 0.045), (), 0)


def test_the_speed_is_the_way_along_the_heading_over_the_last_half_second() -> None:
    meter = Speedometer()
    speeds = [meter.speed(swum(0.1 * i, 0.02 * 0.1 * i, heading=0.05 * (-1) ** i)) for i in range(20)]
    assert speeds[:5] == [None] * 5
    assert all(speed == pytest.approx(0.02, rel=0.01) for speed in speeds[6:])


def test_half_a_minute_between_two_pictures_of_a_fast_simulation_has_its_mean() -> None:
    meter = Speedometer()
    assert meter.speed(swum(0.0, 0.0)) is None
    assert meter.speed(swum(30.0, 0.6)) == pytest.approx(0.02)


def test_a_fish_that_was_put_back_or_whose_clock_was_has_no_speed_at_first() -> None:
    meter = Speedometer()
    meter.speed(swum(0.0, 5.0))
    assert meter.speed(swum(1.0, 0.0)) is None
    meter.speed(swum(2.0, 0.0))
    assert meter.speed(swum(1.5, 0.1)) is None


def test_backwards_through_half_a_turn_is_negative() -> None:
    meter = Speedometer()
    meter.speed(swum(0.0, 0.0, heading=math.pi - 0.1))
    assert meter.speed(swum(1.0, 0.02, heading=-math.pi + 0.1)) == pytest.approx(-0.02)
