"""A robot's fish without velocity: the reason tells whether it lacks a tracker, an estimator, or a word from it."""

from __future__ import annotations

import pytest

from fin_optimizer.trial.silence import silence
from fin_plant.discovery import End, Sight

POSE, TWIST = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped"
ASKED = End("", TWIST, reliable=False)
CAMERA, ESTIMATOR = End("/camera", POSE, reliable=False), End("/fish/velocity_estimator", TWIST)


@pytest.mark.parametrize(
    ("publishers", "said"),
    [
        ({}, "no other node is seen at all, with ROS_DOMAIN_ID=0"),
        ({}, "; on a robot the velocity needs a tracker that publishes /fish/pose"),
        ({"/fish/pose": [CAMERA]}, "; /camera publishes /fish/pose: does fin_servo_driver's velocity_estimator run"),
        (
            {"/fish/pose": [CAMERA], "/fish/velocity": [ESTIMATOR]},
            "/fish/velocity_estimator publishes topic /fish/velocity, but no message has come",
        ),
        ({"/other/velocity": [ESTIMATOR]}, "published is /other/velocity by /fish/velocity_estimator: remap it, or"),
    ],
)
def test_what_a_velocity_lacks_is_named(publishers: dict[str, list[End]], said: str) -> None:
    assert said in silence("/fish/velocity", ASKED, Sight(publishers=publishers))


def test_a_velocity_that_nobody_publishes_is_no_estimators_silence() -> None:
    estimates = Sight(publishers={"/fish/velocity": [ESTIMATOR]})
    assert "tracker" not in silence("/fish/velocity", ASKED, estimates)


def test_a_plant_of_another_namespace_is_offered() -> None:
    state = End("/fish2/simulator", "diagnostic_msgs/msg/DiagnosticStatus", latched=True)
    said = silence("/fish/plant_state", state, Sight(publishers={"/fish2/plant_state": [state]}))
    assert said.endswith("published is /fish2/plant_state by /fish2/simulator: did you mean plants:=[/fish2]?")
