"""Arrows go one way: nodes import cores, and a core runs on a machine that has never heard of ROS."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from graphlib import TopologicalSorter

import pytest

from support.source_tree import (
    PACKAGES,
    SOURCE,
    imported,
    imported_at_start,
    imported_packages,
    loaded_at_start,
    long_functions,
    modules,
)

# The thin ROS face of each package. Whoever adds a module here moves it out of the core.
ROS_MODULES = {
    "fin_bringup.benchmarks.lateness",
    "fin_bringup.page.fish_streams",
    "fin_bringup.page.graph",
    "fin_bringup.live",
    "fin_optimizer.commands.control",
    "fin_optimizer.commands.play_bag",
    "fin_optimizer.announcer",
    "fin_optimizer.optimizer",
    "fin_optimizer.player.choice",
    "fin_optimizer.player.node",
    "fin_optimizer.trial.observer",
    "fin_optimizer.trial.plant_client",
    "fin_optimizer.trial.recorder",
    "fin_optimizer.trial.subscription",
    "fin_optimizer.trial.swimmer",
    "fin_plant.messages",
    "fin_plant.model_topics",
    "fin_plant.node_parameters",
    "fin_plant.node_process",
    "fin_plant.topics",
    "fin_servo_driver.driver_client",
    "fin_servo_driver.driver_topics",
    "fin_servo_driver.emergency_stop",
    "fin_servo_driver.managed_node",
    "fin_servo_driver.operator",
    "fin_servo_driver.rehearsal",
    "fin_servo_driver.requests",
    "fin_servo_driver.servo_driver",
    "fin_servo_driver.velocity_estimator",
    "fin_sim.message_template",
    "fin_sim.simulator",
    "fin_sim.stream_messages",
}
# Physics, search and scoring: may never be listed above, and a renamed one must be renamed here.
CORE_MODULES = {
    "fin_optimizer.goals",
    "fin_optimizer.calibration.errors",
    "fin_optimizer.calibration.fit",
    "fin_optimizer.calibration.model",
    "fin_optimizer.calibration.prediction",
    "fin_optimizer.calibration.settings",
    "fin_optimizer.calibration.swims",
    "fin_optimizer.score.mean_speed",
    "fin_optimizer.search.algorithms",
    "fin_optimizer.search.cloud",
    "fin_optimizer.search.cloud_search",
    "fin_optimizer.search.cma_es",
    "fin_optimizer.search.features",
    "fin_optimizer.search.gaussian_process",
    "fin_optimizer.search.genetic",
    "fin_optimizer.search.gp",
    "fin_optimizer.search.hill_climber",
    "fin_optimizer.search.nsga2",
    "fin_optimizer.search.one_by_one",
    "fin_optimizer.search.pareto",
    "fin_optimizer.search.plausible",
    "fin_optimizer.search.quasi_random",
    "fin_optimizer.search.random_search",
    "fin_optimizer.search.space",
    "fin_optimizer.search.told",
    "fin_optimizer.trial.facts",
    "fin_optimizer.trial.gait_check",
    "fin_optimizer.trial.phases",
    "fin_optimizer.trial.trial",
    "fin_plant.checks",
    "fin_plant.fin",
    "fin_plant.gait",
    "fin_plant.gait_follower",
    "fin_plant.parameters",
    "fin_sim.case",
    "fin_sim.chain",
    "fin_sim.dynamics",
    "fin_sim.fish",
    "fin_sim.swim",
    "fin_sim.time_stepping",
}
MAY_IMPORT = {
    "fin_plant": set[str](),
    "fin_sim": {"fin_plant"},
    "fin_servo_driver": {"fin_plant"},
    "fin_optimizer": {"fin_plant", "fin_sim"},
    "fin_bringup": {"fin_plant", "fin_sim", "fin_servo_driver", "fin_optimizer"},
}
# The emulator of the robot moves a simulated fish; nothing that runs on the robot does.
MAY_ALSO_IMPORT = {"fin_servo_driver.emulator": {"fin_sim"}}
# Of a core, the servo driver's back ends and the optimiser's bag, which are for this, aside.
INPUT_AND_OUTPUT = {"mcap", "mcap_ros2", "rosbags", "serial", "optuna", "matplotlib"}

# Slow to load, so that who does not need it does not wait for it.
NOT_AT_START = {
    "fin_bringup.bringup": {"rclpy", "matplotlib", "mcap", "numba", "optuna", "rosbags", "scipy"},
    "fin_optimizer.optimizer": {"matplotlib", "numba", "scipy"},
    "fin_servo_driver.servo_driver": {"fin_sim", "matplotlib", "mcap", "numba", "optuna", "rosbags", "scipy"},
    "fin_servo_driver.velocity_estimator": {"fin_sim", "matplotlib", "mcap", "numba", "optuna", "rosbags", "scipy"},
    "fin_servo_driver.rehearsal": {"fin_sim.batch", "matplotlib", "mcap", "optuna", "rosbags"},
    "fin_sim.simulator": {"fin_sim.batch", "matplotlib", "mcap", "optuna", "rosbags"},
    "fin_sim.swim_command.command": {"rclpy", "matplotlib", "optuna", "rosbags"},
}

A_SCREEN = 60
"""Lines."""

ALL_MODULES = {name: path for package in PACKAGES for name, path in modules(package).items()}
PURE_MODULES = sorted(ALL_MODULES.keys() - ROS_MODULES)

IMPORT_WITHOUT_ROS = """
import importlib, json, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        ros = top.startswith(("rclpy", "rosidl", "rcl_", "ament", "launch"))
        if ros or top.endswith(("_msgs", "_srvs", "_interfaces")):
            raise ImportError(f"{name} is blocked: this is a machine without ROS")

sys.meta_path.insert(0, NoRos())
failures = {}
for name in json.load(sys.stdin):
    try:
        importlib.import_module(name)
    except Exception as error:
        failures[name] = f"{type(error).__name__}: {error}"
json.dump(failures, sys.stdout)
"""


@pytest.fixture(scope="module")
def failures_without_ros() -> dict[str, str]:
    """Return for each pure module that does not import without ROS the reason."""
    paths = os.pathsep.join(str(SOURCE / package) for package in PACKAGES)
    result = subprocess.run(
        [sys.executable, "-c", IMPORT_WITHOUT_ROS],
        input=json.dumps(PURE_MODULES),
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(json.loads(result.stdout))


@pytest.mark.parametrize("module", PURE_MODULES)
def test_a_module_outside_the_ros_face_imports_without_ros(module: str, failures_without_ros: dict[str, str]) -> None:
    assert failures_without_ros.get(module) is None


def test_ros_is_really_blocked_while_the_cores_are_imported() -> None:
    check = IMPORT_WITHOUT_ROS.replace("json.load(sys.stdin)", '["rclpy", "std_msgs.msg"]')
    result = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert sorted(json.loads(result.stdout)) == ["rclpy", "std_msgs.msg"]


def test_physics_search_and_scoring_are_core_modules() -> None:
    assert not ROS_MODULES & CORE_MODULES
    assert sorted(CORE_MODULES - ALL_MODULES.keys()) == []


def test_the_list_of_ros_modules_names_only_modules_that_exist_and_use_ros() -> None:
    assert sorted(ROS_MODULES - ALL_MODULES.keys()) == []


@pytest.mark.parametrize("module", sorted(CORE_MODULES))
def test_a_core_neither_reads_nor_writes_bags_ports_or_plots(module: str) -> None:
    assert imported_packages(ALL_MODULES[module]) & INPUT_AND_OUTPUT == set()


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_the_packages_below_it(package: str) -> None:
    for name, path in modules(package).items():
        allowed = MAY_IMPORT[package].union(*(more for part, more in MAY_ALSO_IMPORT.items() if name.startswith(part)))
        assert (imported_packages(path) & set(PACKAGES)) - {package} <= allowed, name


@pytest.mark.parametrize("package", PACKAGES)
def test_an_edge_between_packages_stands_in_package_xml(package: str) -> None:
    manifest = (SOURCE / package / "package.xml").read_text()
    used = {other for path in modules(package).values() for other in imported_packages(path) & set(PACKAGES)}
    for other in used - {package}:
        assert f"<exec_depend>{other}</exec_depend>" in manifest


def test_no_core_imports_a_command() -> None:
    commands = "fin_optimizer.commands"
    cores = {name: path for name, path in ALL_MODULES.items() if not f"{name}.".startswith(f"{commands}.")}
    arrows = {name: imported(path) | imported_at_start(path) for name, path in cores.items()}
    assert [
        name for name, names in arrows.items() if any(f"{each}.".startswith(f"{commands}.") for each in names)
    ] == []


@pytest.mark.parametrize("module", NOT_AT_START)
def test_a_start_does_not_wait_for_what_is_needed_later_or_never(module: str) -> None:
    assert loaded_at_start(module, ALL_MODULES) & NOT_AT_START[module] == set()


def test_what_a_start_loads_is_seen_through_all_modules() -> None:
    assert {"numba", "scipy.linalg", "fin_sim.fish"} <= loaded_at_start("fin_sim.simulator", ALL_MODULES)
    assert "optuna" in loaded_at_start("fin_optimizer.optimizer", ALL_MODULES)


def test_no_circle_of_imports() -> None:
    arrows = {
        name: {
            other for other in imported_at_start(path) & ALL_MODULES.keys() if not f"{name}.".startswith(f"{other}.")
        }
        for name, path in ALL_MODULES.items()
    }
    TopologicalSorter(arrows).prepare()  # refuses a circle, and names it


@pytest.mark.parametrize("package", PACKAGES)
def test_a_function_fits_a_screen(package: str) -> None:
    sources = [path for path in (SOURCE / package).rglob("*.py") if "build" not in path.parts]
    found = {path.name: long_functions(path.read_text(), A_SCREEN) for path in sources}
    assert {name: functions for name, functions in found.items() if functions} == {}


@pytest.mark.parametrize(
    ("head", "lines", "found"),
    [
        ("def long(x):", 60, []),
        ("def long(x):", 61, ["long, 61 lines"]),
        ("async def long(x):", 61, ["long, 61 lines"]),
        ("class A:\n  def long(x):", 61, ["long, 61 lines"]),
        ("@cache\ndef long(x):", 61, ["long, 61 lines"]),
        ("from fin_sim.compiled import kernel\ndef long(x):", 61, ["long, 61 lines"]),
        ("from elsewhere import kernel\n@kernel\ndef long(x):", 61, ["long, 61 lines"]),
        ("from fin_sim.compiled import kernel\n@kernel\ndef long(x):", 61, []),
    ],
)
def test_a_function_longer_than_a_screen_is_seen_unless_it_is_compiled(head: str, lines: int, found: list[str]) -> None:
    assert long_functions(head + (lines - 1) * "\n    x += 1", A_SCREEN) == found
