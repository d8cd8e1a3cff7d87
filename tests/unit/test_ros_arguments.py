"""Parameters on a node's command line that ROS 2 would read in another way than people are refused before it does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from fin_plant.ros_arguments import refuse_doubtful

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("010", "fin.segments: 010 is read as octal by some and as decimal by others"),
        ("-017", "is read as octal"),
        ("[1, 010]", "fin.segments: 010 is read as octal"),
    ],
)
@pytest.mark.parametrize("option", ["-p", "--param"])
def test_a_value_in_doubt_is_refused(option: str, value: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        refuse_doubtful(["node", "--ros-args", "-r", "__ns:=/fish", option, f"fin.segments:={value}"])


@pytest.mark.parametrize(
    "words",
    [
        ["-p", "fin.segments:=010"],  # of a command of its own
        ["--ros-args", "--", "-p", "fin.segments:=010"],
        ["--ros-args", "-p", "robot_file:=/a b/010: 'x'/[1.yaml"],
        ["--ros-args", "-p", "port:=/dev/ttyUSB0", "-p", "fin.segments:=10", "-p", "a:=0x10", "-p", "b:=2e9", "-p"],
        ["--ros-args", "-p", "name:=", "-p", "name:=''", "-p", "list:=[]", "-p", "v:=[0.1, 0.25]", "-p", "v:=yes"],
        ["--ros-args", "--params-file", "/nowhere.yaml"],  # which ROS refuses
    ],
)
def test_what_is_not_in_doubt_is_left_to_ros(words: list[str]) -> None:
    refuse_doubtful(["node", *words])


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("fin.segments: 010", "line 3: fin.segments: 010 is read as octal"),
        ("fin.length: 0.08\n    fin.length: 0.09", "line 4: key fin.length stands twice, first in line 3"),
        ("\tfin.length: 0.08", "line 3: found character"),
    ],
)
def test_a_file_in_doubt_is_refused_with_its_line(line: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "my parameters.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    {line}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=f"parameter file {path}: {says}"):
        refuse_doubtful(["node", "--ros-args", "--params-file", str(path)])
    path.write_text("\ufeff/**:\r\n  ros__parameters:\r\n    fin.length: 0.09\r\n", encoding="utf-8")
    refuse_doubtful(["node", "--ros-args", "--params-file", str(path)])
