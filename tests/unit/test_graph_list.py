"""One list of nodes serves launch and bring-up, and every argument of a study reaches the node that it is meant for."""

from __future__ import annotations

import os
import re
import runpy
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from fin_bringup import study_arguments, study_nodes
from fin_bringup.bringup import parse, usage
from fin_bringup.processes import SECONDS_TO_END, find_executable

LAUNCH_FILE = Path(study_nodes.__file__).parents[1] / "launch" / "study.launch.py"


def test_a_study_is_a_simulator_at_full_speed_and_an_optimiser_with_its_defaults() -> None:
    simulator, optimizer = study_nodes.nodes({})
    assert simulator == study_nodes.NodeSpec(
        "fin_sim", "simulator", "simulator", "/fish", {"speed": 0.0, "command_timeout": 5.0}
    )
    assert optimizer == study_nodes.NodeSpec("fin_optimizer", "optimizer", "optimizer", "/fish", {})


def test_every_argument_reaches_the_node_whose_parameter_it_is() -> None:
    given = {
        "trials": "7",
        "seed": "3",
        "search.young_modulus.maximum": "5e9",
        "fin.length": "0.06",
        "speed": "2",
        "body.drag_area": "4e-3",
        "limits.sweep": ".3",
        "autostart": "false",
        "study_folder": "runs/a study",
        "namespace": "/tank_a/fish",
        "plant": "sim",
    }
    simulator, optimizer = study_nodes.nodes(given)
    assert simulator.namespace == optimizer.namespace == "/tank_a/fish"
    assert simulator.parameters == {
        "speed": 2.0,
        "body.drag_area": 4e-3,
        "limits.sweep": 0.3,
        "command_timeout": 5.0,
    }
    assert optimizer.parameters == {
        "trials": 7,
        "seed": 3,
        "search.young_modulus.maximum": 5e9,
        "fin.length": 0.06,
        "autostart": False,
        "study_folder": "runs/a study",
    }


def test_of_several_simulated_fish_one_gives_the_clock() -> None:
    *fish, _ = study_nodes.nodes({"plants": "[/a/fish, /b/fish, /c/fish]"})
    assert [one.namespace for one in fish] == ["/a/fish", "/b/fish", "/c/fish"]
    assert [one.parameters.get("publish_clock", True) for one in fish] == [True, False, False]


def test_a_robot_is_its_driver_and_an_estimator_of_its_velocity() -> None:
    given = {"plant": "robot", "robot_file": "robot.yaml", "window": "0.5", "command_timeout": "0.4", "trials": "3"}
    driver, estimator, optimizer = study_nodes.nodes(given)
    assert driver == study_nodes.NodeSpec(
        "fin_servo_driver",
        "servo_driver",
        "servo_driver",
        "/fish",
        {"robot_file": "robot.yaml", "command_timeout": 0.4},
    )
    assert (estimator.name, estimator.parameters) == ("velocity_estimator", {"window": 0.5})
    assert optimizer.parameters == {"trials": 3, "repeats": 3}


def test_each_of_several_robots_has_a_robot_file_of_its_own() -> None:
    *nodes, _ = study_nodes.nodes({"plant": "robot", "plants": "[/a/fish, /b/fish]", "robot_file": "[a.yaml, b.yaml]"})
    files = {node.namespace: node.parameters["robot_file"] for node in nodes if node.name == "servo_driver"}
    assert files == {"/a/fish": "a.yaml", "/b/fish": "b.yaml"}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"robot_file": "a.yaml"}, "robot_file:=a.yaml names 1 robot files for the 2 fish of plants"),
        ({"robot_file": "[a.yaml,b.yaml,c.yaml]"}, "names 3 robot files for the 2 fish of plants"),
        ({"robot_file": "[a.yaml, a.yaml]"}, "names a.yaml twice, but two drivers cannot share a port"),
        ({"robot_file": "[a.yaml, b.yaml]", "port": "/dev/a"}, "port:=/dev/a cannot be the port of 2 robots"),
    ],
)
def test_several_robots_cannot_share_a_robot_file_or_a_port(given: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError) as refused:  # noqa: PT011  (the message is looked at below)
        study_nodes.nodes({"plant": "robot", "plants": "[/a/fish, /b/fish]", **given})
    assert message in str(refused.value)
    assert "robot_file:=[a.yaml,b.yaml]" in str(refused.value) or "in its robot file" in str(refused.value)


def test_a_robot_file_is_read_before_anything_starts(tmp_path: Path) -> None:
    garbage = tmp_path / "robot.yaml"
    garbage.write_text("device: firmata\n")
    for name, message in ((str(tmp_path / "robot.yml"), "there is no such file"), (str(garbage), "joints")):
        specs = study_nodes.nodes({"plant": "robot", "robot_file": name})
        with pytest.raises(ValueError, match=message):
            study_nodes.check_tails(specs)
    study_nodes.check_tails(study_nodes.nodes({"plant": "rehearsal", "robot_file": "modbus"}))


THREE = {"gait.preset": "sub_carangiform", "gait.driven_joints": "3"}
TWO_LINKS = {
    "peduncle.length": "[0.03, 0.02]",
    "peduncle.root_height": "[0.05, .04]",
    "peduncle.tip_height": "[.04, 0.035]",
    "peduncle.mass_per_area": "[20, 20]",
}


@pytest.mark.parametrize("plant", ["sim", "rehearsal"])
def test_one_line_swims_three_driven_joints_on_the_simulator_and_in_the_rehearsal(plant: str) -> None:
    given = {"plant": plant, **THREE, **TWO_LINKS} | ({"robot_file": "three_servos"} if plant == "rehearsal" else {})
    fish, *_, optimizer = specs = study_nodes.nodes(given)
    study_nodes.check_tails(specs)
    assert fish.parameters["peduncle.root_height"] == [0.05, 0.04]
    assert optimizer.parameters == {"gait.preset": "sub_carangiform", "gait.driven_joints": 3}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (THREE, "3 driven joints, the simulated fish, by its peduncle.length, 1: give as many in gait.preset"),
        (TWO_LINKS, "the gait has 1 driven joint, the simulated fish, by its peduncle.length, 3: give"),
        ({"plant": "robot", "robot_file": "two_servos", **THREE}, "3 driven joints, robot_file:=two_servos 2: give"),
        ({"plant": "robot", "robot_file": "two_servos"}, "the gait has 1 driven joint, robot_file:=two_servos 2: give"),
        (
            {"plant": "rehearsal", **THREE, **TWO_LINKS},
            "robot_file:=firmata has 1 driven joint, the hidden fish 3: give",
        ),
        (
            {"plant": "rehearsal", "robot_file": "three_servos", **THREE},
            "three_servos has 3 driven joints, the hidden fish 1",
        ),
        (
            {"gait.joints.amplitude": "[0.1, 0.2]", "gait.joints.phase": "[0]"},
            "gait.joints.amplitude 2, gait.joints.phase 1",
        ),
    ],
)
def test_gait_robot_file_and_fish_have_as_many_driven_joints_or_nothing_starts(
    given: dict[str, str], message: str
) -> None:
    specs = study_nodes.nodes(given)
    with pytest.raises(ValueError, match=re.escape(message)):
        study_nodes.check_tails(specs)


def test_several_fish_of_a_rehearsal_are_emulated_alike() -> None:
    *nodes, _ = study_nodes.nodes({"plant": "rehearsal", "plants": "[/a/fish, /b/fish]", "robot_file": "modbus"})
    of_each = [[node.name for node in nodes if node.namespace == fish] for fish in ("/a/fish", "/b/fish")]
    assert of_each == [["rehearsal", "servo_driver", "velocity_estimator"]] * 2
    assert [node.parameters.get("robot_file") for node in nodes if node.name == "rehearsal"] == ["modbus"] * 2


def test_a_rehearsal_adds_what_stands_for_the_robot_and_says_so() -> None:
    rehearsal, driver, estimator, optimizer = study_nodes.nodes({"plant": "rehearsal", "robot_file": "modbus"})
    assert (rehearsal.name, rehearsal.parameters) == ("rehearsal", {"robot_file": "modbus"})
    assert (driver.name, driver.parameters) == ("servo_driver", {"plant": "rehearsal"})
    assert (estimator.name, optimizer.name) == ("velocity_estimator", "optimizer")


def test_the_command_line_gives_name_namespace_and_typed_parameters() -> None:
    spec = study_nodes.NodeSpec("p", "e", "n", "/fish", {"a": 1.0, "b": 2, "c": False, "d": "x y"})
    assert spec.ros_arguments() == [
        *("--ros-args", "-r", "__node:=n", "-r", "__ns:=/fish"),
        *("-p", "a:=1.0", "-p", "b:=2", "-p", "c:=false", "-p", 'd:="x y"'),
    ]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"trial": "3"}, "trial:= is no argument of a study with plant:=sim: did you mean trials"),
        ({"fin.youngs_modulus": "1e9"}, "did you mean fin.young_modulus"),
        ({"zzz": "1"}, "zzz:= is no argument of a study with plant:=sim: --help"),
        ({"trials": "0"}, "trials = 0 is outside the allowed range [1, 1e+06]"),
        ({"trials": "many"}, "trials must be a number, got 'many'"),
        ({"trials": "2.5"}, "trials = 2.5 must be a whole number"),
        ({"speed": "nan"}, "speed = nan"),
        ({"fin.thickness": "-1"}, "fin.thickness = -1 m is outside the allowed range"),
        ({"autostart": "perhaps"}, "autostart = 'perhaps' must be true or false"),
        ({"plant": "whale"}, "plant:=whale is not known: use plant:=sim or plant:=robot or plant:=rehearsal"),
        ({"plant": "robot", "speed": "1"}, "with plant:=robot: it is one with plant:=sim"),
        ({"plant": "rehearsal", "port": "/dev/ttyACM0"}, "with plant:=rehearsal: it is one with plant:=robot"),
        ({"robot_file": "robot.yaml"}, "with plant:=sim: it is one with plant:=robot or plant:=rehearsal"),
        ({"plant": "robot"}, "plant:=robot needs robot_file:=my_robot.yaml: copy an example"),
        (
            {"plant": "rehearsal", "objective": "speed_and_cost_of_transport"},
            "plant:=rehearsal cannot tell what the study is about: energy_per_metre needs torque in joint_states",
        ),
        ({"namespace": "fish"}, "namespace:=fish must be like /fish"),
        ({"namespace": "/fi sh"}, "namespace:=/fi sh must be like /fish"),
    ],
)
def test_what_is_unknown_or_out_of_range_is_refused_before_anything_starts(given: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError) as refused:  # noqa: PT011  (the message is looked at below)
        study_nodes.nodes(given)
    assert message in str(refused.value)


def test_words_that_are_no_arguments_are_refused() -> None:
    assert parse(["trials:=3", "study_folder:=a:=b"]) == {"trials": "3", "study_folder": "a:=b"}
    for words, message in ((["trials=3"], "not of the form name:=value"), (["seed:=1", "seed:=2"], "given twice")):
        with pytest.raises(ValueError, match=message):
            parse(words)


def test_the_help_lists_every_argument_with_its_default() -> None:
    text = usage(80)
    assert max(map(len, text.splitlines())) < 80
    for argument in study_arguments.arguments():
        assert f"  {argument.name}:={argument.default or '(empty)'}\n" in text
    assert "speed:=0.0" in text
    assert "fin.young_modulus:=2000000000.0" in text


def test_an_executable_is_found_as_ros2_run_finds_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    executable = tmp_path / "second" / "lib" / "fin_sim" / "simulator"
    executable.parent.mkdir(parents=True)
    executable.write_text("#!/bin/sh\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'first'}{os.pathsep}{tmp_path / 'second'}")
    with pytest.raises(FileNotFoundError, match=r"source install/setup\.bash"):
        find_executable("fin_sim", "dreamer")
    by_its_entry_point = [sys.executable, "-P", "-m", "fin_plant.start", "fin_sim/simulator"]
    assert find_executable("fin_sim", "simulator") == by_its_entry_point
    executable.chmod(0o755)
    assert find_executable("fin_sim", "simulator") == [str(executable)]


class Recorded:
    """Stands for a class of the launch system, which a pip-only machine lacks: keeps what it is built with."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self.arguments, self.named = arguments, named


@pytest.fixture
def launch_file(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The launch file's functions, run with stand-ins for the launch system."""
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "EmitEvent", "LogInfo", "OpaqueFunction", "Shutdown"],
        "launch.events": [],
        "launch.events.process": ["ShutdownProcess"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
    }
    for module, classes in names.items():
        stand_in = types.ModuleType(module)
        for name in classes:
            setattr(stand_in, name, type(name, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, module, stand_in)
    return runpy.run_path(str(LAUNCH_FILE))


class Launched:
    """A launch of the file: launch sets what was given, adds the defaults that are missing, and runs the functions."""

    def __init__(self, launch_file: dict[str, Any], given: dict[str, str], *, included: bool = False) -> None:
        note, *declared, start = launch_file["generate_launch_description"]().arguments[0]
        assert [item.arguments[0] for item in declared] == [argument.name for argument in study_arguments.arguments()]
        argv = [] if included else [f"{name}:={value}" for name, value in given.items()]
        self.context = types.SimpleNamespace(launch_configurations=dict(given), is_shutdown=False, argv=argv)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["ros2", "launch", "tank.launch.py" if included else LAUNCH_FILE.name])
            note.named["function"](self.context)
        defaults = {item.arguments[0]: item.named["default_value"] for item in declared}
        self.context.launch_configurations = defaults | given
        self.nodes = start.named["function"](self.context)

    def end(self, node: Recorded, code: int = 0) -> list[Recorded]:
        result: list[Recorded] = node.named["on_exit"](types.SimpleNamespace(returncode=code), self.context)
        return result


@pytest.mark.parametrize(
    "given",
    [
        {"trials": "7", "plants": "[/b/fish, /a/fish]"},
        {"plant": "rehearsal"},
        {"plant": "rehearsal", "robot_file": "modbus", "trials": "2"},
        {"plant": "sim", "repeats": "2"},
    ],
)
def test_the_launch_file_starts_the_same_nodes(launch_file: dict[str, Any], given: dict[str, str]) -> None:
    started = [node.named for node in Launched(launch_file, given).nodes]
    expected = study_nodes.nodes(given)
    assert [(node["package"], node["executable"], node["name"], node["namespace"]) for node in started] == [
        (spec.package, spec.executable, spec.name, spec.namespace) for spec in expected
    ]
    assert [node["parameters"] for node in started] == [[dict(spec.parameters)] for spec in expected]
    assert {float(node["sigterm_timeout"]) for node in started} == {SECONDS_TO_END}


def said(actions: list[Recorded]) -> list[tuple[str, Any]]:
    return [(type(action).__name__, next(iter(action.named.values()))) for action in actions]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"trails": "2"}, r"trails:= is no argument of a study with plant:=sim: did you mean trials\?"),
        ({"of_no_launch_file": "1"}, "of_no_launch_file:= is no argument of a study with plant:=sim"),
        ({"robot_file": "a.yaml"}, "with plant:=sim: it is one with plant:=robot or plant:=rehearsal"),
    ],
)
def test_an_unknown_launch_argument_is_refused(
    launch_file: dict[str, Any], given: dict[str, str], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Launched(launch_file, given)


def test_a_launch_file_that_includes_the_studys_may_have_arguments_of_its_own(launch_file: dict[str, Any]) -> None:
    given = {"of_the_other_file": "1", "robot_file": "of another plant", "trials": "2"}
    assert [node.named["parameters"] for node in Launched(launch_file, given, included=True).nodes] == [
        [dict(spec.parameters)] for spec in study_nodes.nodes({"trials": "2"})
    ]
    with pytest.raises(ValueError, match=r"trails:= is no argument of a study: did you mean trials\?"):
        Launched(launch_file, {"trails": "2"}, included=True)


def test_a_launched_study_ends_with_its_optimiser_or_its_last_fish(launch_file: dict[str, Any]) -> None:
    launched = Launched(launch_file, {"plants": "[/a/fish, /b/fish]", "plant": "rehearsal"})
    nodes, end = launched.nodes, launched.end
    assert said(end(nodes[-1])) == [("Shutdown", "the study has ended")]
    of_a, of_b = nodes[:3], nodes[3:6]
    words, others = end(of_a[1], 1)
    ended = "/a/fish/servo_driver has ended with exit code 1: the study goes on without /a/fish"
    assert said([words]) == [("LogInfo", ended)]
    matches = others.named["event"].named["process_matcher"]
    assert [node for node in nodes if matches(node)] == of_a
    assert end(of_a[0]) == []
    with pytest.raises(RuntimeError, match="/b/fish/velocity_estimator has ended with exit code 0 before the study"):
        end(of_b[2])


def test_the_exit_code_of_an_optimiser_that_fails_is_that_of_launch(
    launch_file: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    at_exit: list[tuple[Any, ...]] = []
    monkeypatch.setattr("atexit.register", lambda *call: at_exit.append(call))
    launched = Launched(launch_file, {})
    with pytest.raises(RuntimeError, match="the optimiser has ended with exit code 2"):
        launched.end(launched.nodes[-1], 2)
    assert [code for _, code in at_exit] == [2]


def test_the_nodes_of_a_launched_study_that_is_stopped_end_without_a_word(launch_file: dict[str, Any]) -> None:
    launched = Launched(launch_file, {"plants": "[/a/fish, /b/fish]"})
    launched.context.is_shutdown = True
    assert [launched.end(node) for node in launched.nodes] == [[], [], []]


def test_a_fin_is_swum_three_times_on_a_robot_and_once_in_the_simulator_unless_asked_otherwise() -> None:
    def repeats(**given: str) -> object:
        robot_file = {"robot_file": "robot.yaml"} if given.get("plant") == "robot" else {}
        return study_nodes.nodes(given | robot_file)[-1].parameters.get("repeats", 1)

    assert [repeats(plant="robot"), repeats(plant="sim"), repeats(plant="robot", repeats="")] == [3, 1, 3]
    assert [repeats(plant="robot", repeats="1"), repeats(repeats="5")] == [1, 5]


def test_each_of_several_fish_gets_a_plant_in_its_namespace_and_all_one_optimiser() -> None:
    specs = study_nodes.nodes({"plants": "[/tank_a/fish, /tank_b/fish]"})
    assert [(spec.name, spec.namespace) for spec in specs] == [
        ("simulator", "/tank_a/fish"),
        ("simulator", "/tank_b/fish"),
        ("optimizer", "/fish"),
    ]
    assert specs[-1].parameters["plants"] == ["/tank_a/fish", "/tank_b/fish"]


def test_only_a_simulated_fish_waits_longer_for_its_gait() -> None:
    """A robot's tail goes to neutral after half a second, whatever the study asks of a simulator."""
    for plant in ("robot", "rehearsal"):
        given = {"plant": plant, "robot_file": "firmata"} if plant == "robot" else {"plant": plant}
        specs = study_nodes.nodes(given)
        assert not any("command_timeout" in spec.parameters for spec in specs)
    assert study_nodes.nodes({"command_timeout": "0.5"})[0].parameters == {"speed": 0.0}
