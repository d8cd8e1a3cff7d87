"""What `ros2 param dump` writes starts the same node again; what ROS reads otherwise than people is refused."""

from __future__ import annotations

import contextlib
import os
import subprocess
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python

from fin_plant import topics
from support.plant_tester import PlantTester
from support.processes import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = pytest.mark.graph
NODES = {
    "simulator": ("fin_sim", ("fin.profile_position:=[0.25, 0.5]", "fin.profile_height:=[0.02, 0.03]")),
    "servo_driver": ("fin_servo_driver", ("fin.young_modulus:=2.0e9", "port:='/dev/a port'")),
    "velocity_estimator": ("fin_servo_driver", ()),
    "rehearsal": ("fin_servo_driver", ("operator.acts:=false",)),
    "optimizer": ("fin_optimizer", ("seed:=7",)),
}


class ParameterClient(PlantTester):
    """What the verbs of `ros2 param` do, through the same services."""

    def dump(self, file: Path) -> dict[str, Any]:
        """Write the node's parameters as `ros2 param dump` does; return them by name."""
        names = sorted(self._call(ListParameters, "list_parameters", ListParameters.Request()).result.names)
        answer = self._call(GetParameters, "get_parameters", GetParameters.Request(names=names))
        values = {name: parameter_value_to_python(v) for name, v in zip(names, answer.values, strict=True)}
        nested: dict[str, Any] = {}
        for name, value in values.items():
            *groups, last = name.split(".")
            level = nested
            for group in groups:
                level = level.setdefault(group, {})
            level[last] = value
        path = f"{self._node.get_namespace()}/{self._plant}"
        file.write_text(yaml.dump({path: {"ros__parameters": nested}}, default_flow_style=False), encoding="utf-8")
        return values

    def load(self, file: Path) -> list[Any]:
        """Set what stands in a file one after the other, as `ros2 param load` does."""
        request = SetParameters.Request(parameters=list(parameter_dict_from_yaml_file(str(file)).values()))
        return list(self._call(SetParameters, "set_parameters", request).results)


@contextlib.contextmanager
def parameter_clients(domain: int) -> Iterator[dict[str, ParameterClient]]:
    with contextlib.ExitStack() as stack:
        yield {
            name: stack.enter_context(
                ParameterClient(domain, name, "/tank/fish" if name == "optimizer" else topics.NAMESPACE)
            )
            for name in NODES
        }


def start_all(start: Callable[..., Any], arguments: Callable[[str], tuple[str, ...]]) -> list[Any]:
    # The optimiser's namespace has no plant, so that it waits.
    remap = ("-r", "optimizer:__ns:=/tank/fish")
    return [start(package, name, "--ros-args", *arguments(name), *remap) for name, (package, _) in NODES.items()]


def test_a_dump_of_each_node_starts_it_again_with_the_same_values(
    start: Callable[..., Any], ros_domain: int, tmp_path: Path
) -> None:
    def given(name: str) -> tuple[str, ...]:
        folder = (f"study_folder:={tmp_path / 'study'}",) if name == "optimizer" else ()
        return tuple(word for text in (*NODES[name][1], *folder) for word in ("-p", text))

    def dumped(name: str) -> tuple[str, ...]:
        return ("--params-file", str(tmp_path / f"{name}.yaml"))

    with parameter_clients(ros_domain) as clients:
        processes = start_all(start, given)
        first = {name: client.dump(tmp_path / f"{name}.yaml") for name, client in clients.items()}
    assert [complaint for process in processes for complaint in process.end()] == []
    with parameter_clients(ros_domain) as clients:  # new ones, to which a process that has ended was never known
        start_all(start, dumped)
        again = {name: client.dump(tmp_path / f"{name}_again.yaml") for name, client in clients.items()}
        assert again == first
        for name, client in clients.items():
            refused = [result.reason for result in client.load(tmp_path / f"{name}.yaml") if not result.successful]
            assert all("read-only" in reason for reason in refused), refused
            assert client.dump(tmp_path / f"{name}_loaded.yaml") == first[name]
    with_empty_lists = {name for name, values in first.items() if [] in values.values()}
    assert with_empty_lists == {"simulator", "servo_driver", "rehearsal", "optimizer"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("-p", "fin.segments:=010"), "simulator: error: fin.segments: 010 is read as octal"),
        (("-p", "fin.segments:=1_0"), "simulator: error: fin.segments must be a number, got '1_0'"),
        (("--params-file", "twice.yaml"), "twice.yaml: line 4: key fin.length stands twice, first in line 3"),
    ],
)
def test_a_parameter_that_ros_reads_otherwise_is_refused(
    words: tuple[str, str], says: str, ros_domain: int, tmp_path: Path
) -> None:
    twice = "/**:\n  ros__parameters:\n    fin.length: 0.08\n    fin.length: 0.09\n"
    (tmp_path / "twice.yaml").write_text(twice, encoding="utf-8")
    result = subprocess.run(
        (str(ROOT / "run"), "fin_sim", "simulator", "--ros-args", *words),
        cwd=tmp_path,
        env=os.environ | {"ROS_DOMAIN_ID": str(ros_domain)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 2
    assert says in result.stderr
    assert "Traceback" not in result.stderr
