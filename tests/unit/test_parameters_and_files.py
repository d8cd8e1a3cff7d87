"""No parameter that the graph can set names a file that is written or executed: every text parameter is looked at."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import fin_optimizer
import fin_plant
import fin_servo_driver
import fin_sim
from fin_plant.parameters import load_table
from fin_servo_driver import calibrate_servo, robot_file

if TYPE_CHECKING:
    from fin_plant.parameters import Parameter

PACKAGES = (fin_optimizer, fin_plant, fin_servo_driver, fin_sim)
HARMLESS = {
    ("servo_driver_parameters.yaml", "robot_file"),  # is only read, and must be a regular file
    ("servo_driver_parameters.yaml", "port"),  # is a serial device, see test_servo_port.py
}
"""Texts that may be set while a node runs, with the reason why they do no harm."""


def folder(package: object) -> Path:
    return Path(str(importlib.import_module(str(package.__name__)).__file__)).parent  # type: ignore[attr-defined]


def texts_set_on_the_graph() -> dict[tuple[str, str], Parameter]:
    """Return the parameters that are free texts and can be set while their node runs."""
    found = {}
    for package in PACKAGES:
        for path in folder(package).rglob("*parameters.yaml"):
            assert path.parent == folder(package)
            for name, entry in load_table(package.__name__, path.name).items():
                if entry.kind in {"string", "string_array"} and not entry.choices and not entry.read_only:
                    found[path.name, name] = entry
    return found


def test_every_text_that_the_graph_can_set_is_known_to_do_no_harm() -> None:
    assert set(texts_set_on_the_graph()) == HARMLESS


def test_the_tables_are_the_only_way_to_a_parameter() -> None:
    declaring = [
        path.name
        for package in PACKAGES
        for path in folder(package).rglob("*.py")
        if "declare_param" in path.read_text()
    ]
    assert declaring == ["node_parameters.py"]


def test_schemes_of_ports_are_not_for_the_graph() -> None:
    entry = load_table("fin_servo_driver", "servo_driver_parameters.yaml")["port_schemes"]
    assert entry.read_only
    assert entry.check([]) == []
    with pytest.raises(ValueError, match=r"port_schemes.*telepathy"):
        entry.check(["socket", "telepathy"])


@pytest.mark.parametrize("port", ["spy:///dev/pts/0?file={victim}", "{victim}", "notes", "socket://127.0.0.1:9"])
def test_a_robot_file_and_an_argument_name_no_port_but_a_device(
    port: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    victim, file = tmp_path / "notes", tmp_path / "robot.yaml"
    victim.write_text("kept")
    monkeypatch.chdir(tmp_path)
    port = port.format(victim=victim)
    example = robot_file.find("firmata").read_text(encoding="utf-8")
    own = robot_file.load(robot_file.find("firmata")).port
    file.write_text(example.replace(own, f"'{port}'"))
    for arguments in ([str(file)], [str(robot_file.find("firmata")), "--port", port]):
        assert calibrate_servo.main(arguments) == 1
        assert "is refused" in capsys.readouterr().err
    assert victim.read_text() == "kept"
