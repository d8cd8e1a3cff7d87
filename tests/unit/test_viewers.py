"""Viewers beside a study, parameter files as arguments, and layouts that name only what there is."""

from __future__ import annotations

import ast
import json
import re
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
import yaml

from fin_bringup import study_nodes
from fin_bringup.study_nodes import LAYOUTS
from fin_plant.services import SERVICES, not_for_viewers
from support.source_tree import SOURCE

if TYPE_CHECKING:
    from pathlib import Path

THREE_JOINTS = SOURCE / "fin_bringup/config/three_joints.yaml"


def topic_names() -> set[str]:
    topics = pytest.importorskip("fin_plant.topics", reason="needs the ROS wheels or a sourced ROS")
    return {topic.name_in(topics.NAMESPACE) for topic in topics.ALL_TOPICS} | {topics.TF}


def test_a_parameter_file_gives_each_node_its_part_and_what_is_given_beside_it_counts_more() -> None:
    simulator, optimizer = study_nodes.nodes({"params": str(THREE_JOINTS), "gait.frequency": "1.5"})
    assert simulator.parameters["peduncle.length"] == [0.03, 0.02]
    assert optimizer.parameters["gait.joints.amplitude"] == [0.07, 0.14, 0.2]
    assert optimizer.parameters["gait.frequency"] == 1.5
    study_nodes.check_tails((simulator, optimizer))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("simulator: {speed: 1.0}", "'simulator' needs ros__parameters below it"),
        ("[1, 2]", "needs ros__parameters below it"),
        ("", "it is empty"),
        ("/**: {ros__parameters: {body.lenght: 0.1}}", "body.lenght:= is no argument of a study"),
        ("/**: {ros__parameters: {body.length: long}}", "body.length"),
        (
            "simulator: {ros__parameters: {seed: 1}}\noptimizer: {ros__parameters: {seed: 2}}",
            "gives seed two values, 1 and 2",
        ),
    ],
)
def test_a_parameter_file_that_cannot_be_is_refused_with_what_is_wrong(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(text)
    with pytest.raises(ValueError, match=re.escape(said)):
        study_nodes.nodes({"params": str(file)})


def test_a_parameter_file_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match=r"params:=nowhere\.yaml is refused: No such file"):
        study_nodes.nodes({"params": "nowhere.yaml"})


def test_viewers_are_started_where_they_are_asked_for_in_the_namespace_of_the_fish() -> None:
    assert study_nodes.viewers({}) == ()
    live, rviz = study_nodes.viewers({"live": "true", "rviz": "True", "namespace": "/tank_a/fish"})
    assert (live.package, live.executable, live.namespace) == ("fin_bringup", "live", "/tank_a/fish")
    assert (rviz.executable, rviz.words) == ("rviz2", ("-d", str(LAYOUTS / "fish.rviz")))
    assert (LAYOUTS / "fish.rviz").is_file()
    with pytest.raises(ValueError, match="live:=maybe must be true or false"):
        study_nodes.viewers({"live": "maybe"})


@pytest.mark.parametrize("name", sorted(path.name for path in LAYOUTS.iterdir()))
def test_a_layout_is_read_and_names_only_topics_that_there_are(name: str) -> None:
    text = (LAYOUTS / name).read_text(encoding="utf-8")
    if name.endswith(".json"):
        json.loads(text)
    elif name.endswith(".xml"):
        ET.fromstring(text)  # noqa: S314  (our own file)
    else:
        assert yaml.safe_load(text)
    known = topic_names()
    named = re.findall(r"(?<![\w./])/(?:fish/\w+|diagnostics|tf\b)", text)
    assert named or name == "diagnostic_aggregator.yaml"
    assert set(named) <= known


def test_the_aggregator_sorts_every_status_that_a_node_tells() -> None:
    aggregator = yaml.safe_load((LAYOUTS / "diagnostic_aggregator.yaml").read_text(encoding="utf-8"))
    groups = aggregator["/**/analyzers"]["ros__parameters"]
    sorted_by = {word for group in groups.values() if isinstance(group, dict) for word in group["contains"]}
    code = "".join(path.read_text(encoding="utf-8") for path in SOURCE.rglob("*.py"))
    told = set(re.findall(r"get_fully_qualified_name\(\)\}(: \w+)\"|name=f\"\{name\}(: \w+)\"", code))
    assert {a or b for a, b in told} == sorted_by


def test_every_status_says_of_which_hardware_it_is() -> None:
    lacking = []
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "DiagnosticStatus":
                given = {keyword.arg for keyword in node.keywords}
                lacking += [f"{path.name}:{node.lineno}"] if given and "hardware_id" not in given else []
    assert lacking == []


def test_the_services_that_are_documented_are_those_that_the_nodes_offer() -> None:
    topics = pytest.importorskip("fin_plant.topics", reason="needs the ROS wheels or a sourced ROS")
    files = {
        "simulator": ("fin_sim/fin_sim/simulator.py",),
        "servo_driver": (
            "fin_servo_driver/fin_servo_driver/servo_driver.py",
            "fin_servo_driver/fin_servo_driver/emergency_stop.py",
        ),
        "optimizer": ("fin_optimizer/fin_optimizer/optimizer.py",),
        "player": ("fin_optimizer/fin_optimizer/player/node.py",),
    }
    offered = set()
    for node, paths in files.items():
        for path in paths:
            text = (SOURCE / path).read_text(encoding="utf-8")
            text = re.sub(r"\{topics\.(\w+)\}", lambda found: getattr(topics, found[1]), text)
            offered |= {(node, name) for name in re.findall(r"\"~/(\w+)\", self", text)}
            offered |= {(node, name) for name in re.findall(r"fully_qualified_name\(\)\}/(\w+)\"", text)}
    assert {(node, service.name) for service in SERVICES for node in service.nodes} == offered


def test_a_viewer_confirms_nothing_and_stops_but_does_not_release() -> None:
    """Whosever page is open in a browser on this computer can speak to `live`."""
    kept = {service.name for service in SERVICES if not_for_viewers(f"/fish/servo_driver/{service.name}")}
    assert kept == {"confirm_fin", "confirm_mark"}
    assert not not_for_viewers("/fish/servo_driver/estop", releases=False)
    assert "only stops" in not_for_viewers("/fish/servo_driver/estop", releases=True)
    assert not not_for_viewers("/fish/optimizer/start", releases=True)
