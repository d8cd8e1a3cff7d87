"""What is read from YAML is what stands there; what two readers take for two things is refused with its line."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fin_plant import yaml_file
from fin_servo_driver import robot_file
from fin_sim import swim_command

if TYPE_CHECKING:
    from pathlib import Path

if TYPE_CHECKING:
    from pathlib import Path

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
    assert swim_command.main(["--params-file", str(path)]) == 2
    assert "line 4: key fin.length stands twice, first in line 3" in capsys.readouterr().err
