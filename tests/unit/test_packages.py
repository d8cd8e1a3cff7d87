"""The packages say truthfully what they are made of: manifest, dependencies, executables, installed files."""

from __future__ import annotations

import ast
import importlib.util
import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from catkin_pkg.package import parse_package

from support.source_tree import PACKAGES, SOURCE, UNIT_TESTS, imported_packages, modules, unit_tests

ROOT = SOURCE.parents[1]
# Import name -> rosdep key, where they differ; None where rosdep has no key (package.xml says what to do then).
ROSDEP_KEYS = {
    "aiohttp": "python3-aiohttp",
    "cmaes": None,
    "distributed": None,
    "dynamixel_sdk": None,
    "ezdxf": None,
    "jinja2": "python3-jinja2",
    "foxglove": None,
    "launch": "launch",
    "launch_ros": "launch_ros",
    "matplotlib": "python3-matplotlib",
    "mcap": "mcap-ros2-support",
    "mcap_ros2": "mcap-ros2-support",
    "mujoco": None,
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "optuna": None,
    "optuna_dashboard": None,
    "plotly": None,
    "platformdirs": "python3-platformdirs",
    "pyarrow": None,
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "serial": "python3-serial",
    "threadpoolctl": None,
    "yaml": "python3-yaml",
    "zstandard": None,
}


# Import name -> name on the package index, where they differ.
DISTRIBUTIONS = {
    "dynamixel_sdk": "dynamixel-sdk",
    "foxglove": "foxglove-sdk",
    "mcap_ros2": "mcap-ros2-support",
    "optuna_dashboard": "optuna-dashboard",
    "serial": "pyserial",
    "yaml": "pyyaml",
}
# What only benchmarks and runs on several machines load; requirements/bench.txt has it.
OPTIONAL = {"distributed", "mujoco"}


def setup_arguments(package: str) -> dict[str, ast.expr]:
    """Return the keyword arguments of the setup() call in a package's setup.py, unevaluated."""
    for node in ast.walk(ast.parse((SOURCE / package / "setup.py").read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "setup":
            return {keyword.arg: keyword.value for keyword in node.keywords if keyword.arg}
    pytest.fail(f"no setup() in {package}/setup.py")


def entry_points() -> list[str]:
    found = []
    for package in PACKAGES:
        for node in ast.parse((SOURCE / package / "setup.py").read_text()).body:
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "EXECUTABLES":
                found += ast.literal_eval(node.value)
    return found


@pytest.fixture(params=PACKAGES)
def manifest(request: pytest.FixtureRequest) -> Any:
    """Return a package.xml; parsing it checks it against its format."""
    warnings: list[str] = []
    package = parse_package(SOURCE / str(request.param) / "package.xml", warnings=warnings)
    assert warnings == []
    return package


def test_the_manifest_is_valid_and_agrees_with_setup_py(manifest: Any) -> None:
    arguments = setup_arguments(manifest.name)
    assert manifest.package_format == 3
    assert manifest.get_build_type() == "ament_python"
    assert manifest.licenses == ["Apache-2.0"] == [ast.literal_eval(arguments["license"])]
    assert manifest.version == ast.literal_eval(arguments["version"])
    assert manifest.description == ast.literal_eval(arguments["description"])
    assert manifest.maintainers[0].email == ast.literal_eval(arguments["maintainer_email"])


def test_what_a_package_imports_stands_in_its_manifest_and_nothing_else(manifest: Any) -> None:
    declared = {dependency.name for dependency in manifest.exec_depends}
    used = set()
    files = [*modules(manifest.name).values(), *(SOURCE / manifest.name).glob("launch/*.launch.py")]
    for path in files:
        for name in imported_packages(path) - {manifest.name, "__future__"} - sys.stdlib_module_names:
            key = ROSDEP_KEYS.get(name, name)
            if key is not None:
                used.add(key)
    assert sorted(used - declared) == []
    assert sorted(declared - used) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_a_wheel_requires_what_the_package_imports_but_ros_and_nothing_else(package: str) -> None:
    imports = {name for path in modules(package).values() for name in imported_packages(path)}
    of_ros = {
        "launch",
        "launch_ros",
        "rclpy",
        *(name for name in imports if name.endswith(("_msgs", "_srvs", "_interfaces"))),
    }
    used = imports - {package, "__future__"} - sys.stdlib_module_names - of_ros - OPTIONAL
    required = ast.literal_eval(setup_arguments(package)["install_requires"])
    assert required == sorted(DISTRIBUTIONS.get(name, name) for name in used)


def test_every_third_party_import_is_pinned() -> None:
    pinned = " ".join(path.read_text().lower() for path in (ROOT / "requirements").glob("*.txt"))
    for name in ROSDEP_KEYS.keys() - {"launch", "launch_ros"}:
        distribution = DISTRIBUTIONS.get(name, name).lower().replace("_", "-")
        assert re.search(rf"(^|\s|ros-){re.escape(distribution)}==", pinned), name


def test_every_requirement_is_pinned_exactly() -> None:
    for path in (ROOT / "requirements").glob("*.txt"):
        for line in path.read_text().splitlines():
            pin = r"[a-z0-9-]+(\[[a-z]+\])?==[^;\s]+(; python_version (<|>=) \"3\.1\d\")?"
            assert not line or line.startswith("#") or re.fullmatch(pin, line), f"{path.name}: {line}"


@pytest.mark.parametrize("entry_point", entry_points())
def test_an_executable_leads_to_a_function_that_exists(entry_point: str) -> None:
    _, module, function = re.fullmatch(r"(\w+) = ([\w.]+):(\w+)", entry_point).groups()  # type: ignore[union-attr]
    specification = importlib.util.find_spec(module)
    assert specification is not None
    assert specification.origin is not None
    tree = ast.parse(Path(specification.origin).read_text())
    assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_file_beside_the_modules_is_installed(package: str) -> None:
    patterns = ast.literal_eval(ast.unparse(setup_arguments(package)["package_data"]).replace("NAME", f"'{package}'"))
    folder = SOURCE / package / package
    data = {path for path in folder.rglob("*") if path.is_file() and path.suffix not in {".py", ".pyc", ".nbc", ".nbi"}}
    installed = {path for pattern in patterns[package] for path in folder.glob(pattern)}
    assert sorted(data - installed) == []


def test_the_two_fast_dds_profiles_differ_only_in_the_interface_and_use_no_shared_memory() -> None:
    folder = SOURCE / "fin_plant" / "fin_plant"
    anywhere = ET.parse(folder / "fast_dds_profile.xml").getroot()  # noqa: S314  (our own file)
    here = ET.parse(folder / "fast_dds_localhost_profile.xml").getroot()  # noqa: S314
    space = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"
    transport = here.find(f".//{space}transport_descriptor")
    assert transport is not None
    only = transport.find(f"{space}interfaceWhiteList")
    assert only is not None
    assert "".join(only.itertext()).split() == ["127.0.0.1"]
    transport.remove(only)
    assert ["".join(element.itertext()).split() for element in here.iter()] == [
        "".join(element.itertext()).split() for element in anywhere.iter()
    ]
    assert [element.text for element in anywhere.iter(f"{space}useBuiltinTransports")] == ["false"]
    assert {element.text for element in anywhere.iter(f"{space}type")} == {"UDPv4"}


def test_each_unit_test_is_run_by_colcon_for_one_package() -> None:
    by_package = {package: unit_tests(package) for package in PACKAGES}
    assert sorted(path for paths in by_package.values() for path in paths) == sorted(UNIT_TESTS.glob("test_*.py"))
    assert UNIT_TESTS / "test_gait.py" in by_package["fin_plant"]
    assert UNIT_TESTS / "test_swim.py" in by_package["fin_sim"]
    assert UNIT_TESTS / "test_safety.py" in by_package["fin_servo_driver"]
    assert UNIT_TESTS / "test_plan.py" in by_package["fin_optimizer"]
    assert UNIT_TESTS / "test_graph_list.py" in by_package["fin_bringup"]


def test_what_colcon_runs_is_the_same_file_in_all_packages() -> None:
    files = sorted(SOURCE.glob("*/test/test_package.py"))
    assert {path.parents[1].name for path in files} == set(PACKAGES)
    assert len({path.read_text() for path in files}) == 1
