"""What is read from YAML is what stands there; what two readers take for two things is refused with its line."""

from __future__ import annotations

import argparse
import json
import math
import re
from typing import TYPE_CHECKING

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_plant import checks, json_file, yaml_file
from fin_servo_driver import robot_file
from fin_sim import case
from fin_sim.swim_command.command import main as swim_main

if TYPE_CHECKING:
    from pathlib import Path

if TYPE_CHECKING:
    from pathlib import Path

CASE = """{"case": {"rho": 1000.0, "links": [{"length": 0.1}, {"length": 0.1, "height": 0.02, "length": 0.2}]}}"""
ROBOT = robot_file.find("firmata").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e1", 10.0),
        ("+1.5E-3", 0.0015),
        ("5.", 5.0),
        (".5", 0.5),
        ("0", 0),
        ("-12", -12),
        ("0x0100", 256),
        ("-.inf", -math.inf),
        ("true", True),
        ("yes", "yes"),
        ("off", "off"),
        ("12:30", "12:30"),
        ("1_000", "1_000"),
        ("2026-11-11", "2026-11-11"),
        ("'010'", "010"),
        ("", None),
        ("[1, x, {b: 2}]", [1, "x", {"b": 2}]),
    ],
)
def test_a_value_is_what_the_core_schema_says(text: str, value: object) -> None:
    content = yaml_file.parse(f"\ufeffa: {text}\r\nb: end\r\n")
    assert content == {"a": value, "b": "end"}
    assert isinstance(content, dict)
    assert type(content["a"]) is type(value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: 1\nb: {c: 1, d: 2, c: 3}", "line 2: key c stands twice, first in line 2"),
        ("a: 1\nb: 2\na: 1", "line 3: key a stands twice, first in line 1"),
        ("a: 010", "line 1: a: 010 is read as octal by some"),
        ("a:\n- 1\n- -017", "line 3: a: -017 is read as octal"),
        ("a: 0o17", "line 1: a: 0o17 is read as octal"),
        ("a: &x 1\nb: *x", "line 1: anchors and references"),
        ("a:\n  <<: {b: 1}", "line 2: key '<<' must be a plain name"),
        ("1: a", "line 1: key '1' must be a plain name"),
        ("true: a", "line 1: key 'true' must be a plain name"),
        ("a: !!python/object/apply:os.getcwd []", "line 1: tags"),
        ("a: 1\n---\na: 2", "line 2: but found another document"),
        ("a:\n\t- b", "line 2: found character"),
        ("", "it is empty"),
        ("# a word\n", "it is empty"),
        ("[" * 5000, "nested too deeply"),
    ],
)
def test_what_is_in_doubt_is_refused_with_its_line(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says.replace("*", ".")):
        yaml_file.parse(text)


def test_a_file_that_is_no_text_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"a: 1\nb: \xff\n")
    with pytest.raises(ValueError, match="line 2: it is no text in UTF-8"):
        yaml_file.read(path)


@given(st.dictionaries(st.from_regex(r"[a-z]{1,6}x", fullmatch=True), st.integers() | st.floats(allow_nan=False)))
def test_numbers_that_a_program_writes_are_read_as_they_were(numbers: dict[str, float]) -> None:
    if numbers:
        assert yaml_file.parse(yaml.safe_dump(numbers)) == numbers


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("    highest: 1800\n", "    highest: 1700\n    highest: 2300\n", "key highest stands twice"),
        ("channel: 9", "channel: 010", "channel: 010 is read as octal"),
        ("channel: 9", 'channel: "9"', "channel must be a number, got '9'"),
        ("highest: 1800", "highest: 1_800", "highest must be a number, got '1_800'"),
        ("centre: 1500", "centre: 25:00", "centre must be a number, got '25:00'"),
        ("rate: 6.0", "rate: .inf", "rate = inf"),
        ("rate: 6.0", "rate: on", "rate must be a number, got 'on'"),
    ],
)
def test_a_robot_file_in_doubt_is_refused_with_file_and_key(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = tmp_path / "robot.yaml"
    assert old in ROBOT
    path.write_text(ROBOT.replace(old, new), encoding="utf-8")
    with pytest.raises(ValueError, match=f"robot.yaml: .*{says}"):
        robot_file.load(path)
    path.write_text(ROBOT.replace("highest: 1800", "highest: 18e2"), encoding="utf-8")
    assert robot_file.load(path).servos[0].highest == 1800.0


def test_a_parameter_file_with_a_key_twice_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("/**:\n  ros__parameters:\n    fin.length: 0.08\n    fin.length: 0.09\n", encoding="utf-8")
    assert swim_main(["--params-file", str(path)]) == 2
    assert "line 4: key fin.length stands twice, first in line 3" in capsys.readouterr().err


def test_json_refuses_a_key_that_stands_twice_with_its_place(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"key 'length' stands twice in case\.links\[2\]: keep one"):
        json_file.parse(CASE)
    with pytest.raises(ValueError, match="key 'a' stands twice in the outermost object"):
        json_file.parse('{"a": {"b": 1, "b": 2}, "a": 1}')
    path = tmp_path / "case.json"
    path.write_text(CASE)
    with pytest.raises(ValueError, match=r"case\.json: key 'length' stands twice"):
        case.read_case(path)


@pytest.mark.parametrize("text", ['{"a": NaN}', "[Infinity]", "[-Infinity]", "{", "", "[" * 100_000])
def test_json_refuses_what_is_no_number_and_what_is_no_json(text: str) -> None:
    with pytest.raises(ValueError, match=r".+"):
        json_file.parse(text)


@settings(max_examples=25, deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
def test_other_json_is_read_as_python_reads_it(content: object) -> None:
    assert json_file.parse(json.dumps(content)) == content


@pytest.mark.parametrize("text", ["1_000", "\uff11", "\u0661\u0662", "1e1_0", "0x10", "", "1,5", "1 000"])
def test_a_number_on_a_command_line_is_one_in_plain_digits(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="is no number"):
        checks.read_number(text)
    with pytest.raises(ValueError, match="is no number"):
        checks.read_whole_number(text)
    parser = argparse.ArgumentParser(prog="this")
    parser.add_argument("--many", type=checks.read_whole_number)
    for wrong in (text, "1.5"):
        with pytest.raises(SystemExit):
            parser.parse_args(["--many", wrong])
        told = capsys.readouterr().err.splitlines()[-1]
        assert told.startswith(f"this: error: argument --many: {wrong!r} is no ")


@pytest.mark.parametrize(("text", "value"), [("1e9", 1e9), (".5", 0.5), ("-2.", -2.0), ("+3", 3.0), (" 4 ", 4.0)])
def test_what_people_write_for_a_number_is_read(text: str, value: float) -> None:
    assert checks.read_number(text) == value


def test_a_parameter_file_s_underscored_number_is_refused_by_swim(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text("simulator:\n  ros__parameters:\n    fin.density: 1_000\n")
    assert swim_main(["--params-file", str(path)]) == 2
    assert "fin.density = '1_000' must be a number" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--duration", "1_0"], ["--vary", "fin.length=0.05,1_0"], ["--fin.length", "0.0_8"]])
def test_an_underscored_number_is_refused_by_swim(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code: object = swim_main(words)
    except SystemExit as end:
        code = end.code
    assert code == 2
    assert words[1].rpartition(",")[2] in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("port", "", "port must be a text, got nothing: give the device's path, or leave the line out"),
        ("port", "5", "port must be a text, got 5"),
        ("port", "[a]", "port must be a text"),
        ("device", "", "device must be a text, got nothing: name the back end"),
    ],
)
def test_an_empty_line_of_a_robot_file_is_no_text(key: str, value: str, complaint: str) -> None:
    lines = [f"{key}: {value}" if line.startswith(f"{key}:") else line for line in ROBOT.splitlines()]
    with pytest.raises(ValueError, match=re.escape(complaint)):
        robot_file.parse(yaml_file.parse("\n".join(lines)))


def test_a_robot_file_without_a_port_has_none() -> None:
    lines = [line for line in ROBOT.splitlines() if not line.startswith("port:")]
    assert robot_file.parse(yaml_file.parse("\n".join(lines))).port == ""
