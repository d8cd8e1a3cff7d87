"""What is said of a topic on which nothing comes follows from what is seen of the graph, and from nothing else."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fin_plant.discovery import End, Sight, around, no_fresh_gait, no_service, nobody_hears, nothing_on, request

STATE = "diagnostic_msgs/msg/DiagnosticStatus"
TWIST, POSE = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/PoseStamped"
LATCHED = End("", STATE, latched=True)
PLANT = replace(LATCHED, node="/fish2/simulator")
VELOCITY = End("", TWIST, reliable=False)
CAMERA = End("/camera", POSE, reliable=False)


def test_a_plant_of_another_namespace_is_named_with_what_to_do() -> None:
    sight = Sight(("/fish2/simulator",), {"/fish2/plant_state": [PLANT], "/fish2/candidate": [PLANT]})
    said = nothing_on("/fish/plant_state", LATCHED, sight, advice="did you mean plants:=[{namespace}]?")
    assert said == (
        "nobody publishes topic /fish/plant_state; published is /fish2/plant_state by /fish2/simulator: "
        "did you mean plants:=[/fish2]?"
    )


def test_a_topic_of_the_same_type_counts_only_where_its_name_does_not_matter() -> None:
    sight = Sight(("/camera",), {"/camera/fish_pose": [CAMERA]})
    advice = "remap it (pose:={topic})"
    found = nothing_on("/fish/pose", End("", POSE), sight, advice=advice, of_any_name=True)
    assert found.endswith("published is /camera/fish_pose by /camera: remap it (pose:=/camera/fish_pose)")
    assert "camera/" not in nothing_on("/fish/pose", End("", POSE), sight, advice=advice)


def test_the_nodes_seen_are_named_and_not_more_than_a_line_holds() -> None:
    assert "the other nodes seen are /rviz (ROS_DOMAIN_ID=0)" in around(Sight(("/rviz",)))
    assert "/a, /b, /c, /d, /e and 2 more (" in around(Sight([f"/{letter}" for letter in "abcdefg"]))


@pytest.mark.parametrize(
    ("environment", "said"),
    [
        ({}, "ROS_DOMAIN_ID=0, ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET:"),
        ({"ROS_DOMAIN_ID": "7"}, "ROS_DOMAIN_ID=7, ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET:"),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
            "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, on this computer only:",
        ),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF, on this computer only:"),
        ({"ROS_LOCALHOST_ONLY": "1"}, "ROS_LOCALHOST_ONLY=1, on this computer only:"),
        ({"ROS_LOCALHOST_ONLY": "0"}, "ROS_LOCALHOST_ONLY=0:"),
        ({"ROS_STATIC_PEERS": "10.0.0.7"}, "ROS_STATIC_PEERS=10.0.0.7:"),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp:"),
        (
            {"FASTRTPS_DEFAULT_PROFILES_FILE": "/x/fast_dds_localhost_profile.xml"},
            "FASTRTPS_DEFAULT_PROFILES_FILE=fast_dds_localhost_profile.xml, on this computer only:",
        ),
    ],
)
def test_where_no_other_node_is_seen_the_settings_that_hide_one_are_named(
    environment: dict[str, str], said: str
) -> None:
    text = nothing_on("/fish/plant_state", LATCHED, Sight(environment=environment))
    assert text.startswith("nobody publishes topic /fish/plant_state; no other node is seen at all, with ROS_DOMAIN_ID")
    assert said in text


@pytest.mark.parametrize(
    ("wanted", "offered", "said"),
    [
        (VELOCITY, End("/mocap", "geometry_msgs/msg/Twist"), "as geometry_msgs/msg/Twist, needed is geometry_msgs/"),
        (LATCHED, End("/mine", STATE), "/mine publishes topic /fish/x, but not transient local (it is volatile)"),
        (LATCHED, End("/mine", STATE, reliable=False, latched=True), "but not reliable (it is best effort), which"),
        (LATCHED, End("/mine", STATE, reliable=False), "reliable (it is best effort) and transient local (it is vol"),
        (VELOCITY, End("/mocap", TWIST, reliable=False), "/mocap publishes topic /fish/x, but no message has come"),
        (VELOCITY, End("", TWIST), "a node that has not told its name yet publishes topic /fish/x"),
    ],
)
def test_a_publisher_that_is_not_heard_is_named_with_the_reason(wanted: End, offered: End, said: str) -> None:
    assert said in nothing_on("/fish/x", wanted, Sight(publishers={"/fish/x": [offered]}))


def test_several_publishers_are_each_told_and_equal_ones_once() -> None:
    ends = [End("/one", TWIST), End("/two", "std_msgs/msg/Float64"), End("/one", TWIST)]
    said = nothing_on("/fish/x", VELOCITY, Sight(publishers={"/fish/x": ends}))
    assert said.count("/one publishes") == 1
    assert "/two publishes topic /fish/x as std_msgs/msg/Float64" in said


@pytest.mark.parametrize(
    ("ends", "asked"),
    [
        ([], (True, True)),
        ([PLANT], (True, True)),
        ([replace(PLANT, latched=False)], (True, False)),
        ([PLANT, replace(PLANT, reliable=False)], (False, True)),
        ([replace(PLANT, reliable=False, latched=False)], (False, False)),
        ([End("/other", TWIST, reliable=False)], (True, True)),
    ],
)
def test_what_is_asked_for_is_what_all_publishers_of_the_type_offer(ends: list[End], asked: tuple[bool, bool]) -> None:
    assert request(ends, LATCHED) == asked


def test_a_gait_that_nobody_can_hear_is_told_from_one_that_somebody_hears() -> None:
    gait = End("", "std_msgs/msg/Float64MultiArray")
    assert nobody_hears("/fish/gait", gait, []) == "nobody listens to topic /fish/gait"
    wrong = End("/fish/robot", "std_msgs/msg/Float32MultiArray")
    asks = replace(gait, node="/fish/mine", latched=True)
    said = nobody_hears("/fish/gait", gait, [wrong, asks])
    assert "/fish/robot listens to topic /fish/gait as std_msgs/msg/Float32MultiArray, sent is" in said
    assert "/fish/mine listens to topic /fish/gait and asks for transient local (it is volatile)" in said
    assert nobody_hears("/fish/gait", gait, [wrong, replace(gait, node="/fish/simulator")]) == ""


def test_silence_since_a_moment_is_not_told_as_silence_for_ever() -> None:
    sight = Sight(publishers={"/fish/pose": [CAMERA]})
    said = nothing_on("/fish/pose", End("", POSE, reliable=False), sight, since="within the last second")
    assert said == "/camera publishes topic /fish/pose, but no message has come within the last second"


def test_a_service_of_another_namespace_is_named_with_what_to_do() -> None:
    sight = Sight(("/a/optimizer",), services=("/a/optimizer/start", "/a/optimizer/stop", "/other/start"))
    said = no_service("/fish/optimizer/start", sight, advice="give --namespace {namespace}")
    assert said == "nobody offers service /fish/optimizer/start; offered is /a/optimizer/start: give --namespace /a"
    assert "no other node is seen at all" in no_service("/fish/optimizer/start", Sight())


@pytest.mark.parametrize(
    ("publishers", "refusals", "said"),
    [
        ([], [], "nobody publishes topic /fish/gait any more"),
        ([End("/me", "x")], [], "nothing came on topic /fish/gait, which /me publishes"),
        ([End("/me", "x")], ["too small", "amplitude is nan"], "2 came and were refused: amplitude is nan"),
        ([], ["amplitude is nan"], "1 came and was refused: amplitude is nan"),
    ],
)
def test_a_gait_that_stopped_is_told_from_one_that_is_refused(
    publishers: list[End], refusals: list[str], said: str
) -> None:
    text = no_fresh_gait("/fish/gait", publishers, len(refusals), refusals[-1] if refusals else "")
    assert text == f"no fresh gait within command_timeout: {said}"
