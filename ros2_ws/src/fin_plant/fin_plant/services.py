"""The services of the node graph, besides those that every node and every managed node has: for its documentation."""

from __future__ import annotations

from typing import NamedTuple

TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"


class Service(NamedTuple):
    """A service: its name, private to the node, its type, its nodes, what it does, and whether only people call it."""

    name: str
    type_name: str
    nodes: tuple[str, ...]
    description: str
    for_people: bool = False


SERVICES = (
    Service(
        "request_reset",
        TRIGGER,
        ("simulator", "servo_driver"),
        "asks for the fish at rest at its start; a simulator does it, a robot asks a person for it",
    ),
    Service(
        "estop",
        SET_BOOL,
        ("simulator", "servo_driver"),
        "true: the emergency stop, latched; false releases it, and a robot then waits for its mark",
    ),
    Service(
        "confirm_fin", TRIGGER, ("servo_driver",), "a person says that the fin asked for is mounted", for_people=True
    ),
    Service(
        "confirm_mark", TRIGGER, ("servo_driver",), "a person says that the fish is back at its mark", for_people=True
    ),
    Service("start", TRIGGER, ("optimizer",), "the study goes on"),
    Service("pause", TRIGGER, ("optimizer", "player"), "the study holds after the trial under way; a player holds"),
    Service("stop", TRIGGER, ("optimizer",), "the study ends, the trial under way INTERRUPTED"),
    Service("repeat", TRIGGER, ("optimizer",), "the trial under way, or else the last one, is swum again"),
    Service("resume", TRIGGER, ("player",), "a player of a bag goes on"),
)
"""Each of them, as a node ``/fish/simulator`` offers it: ``/fish/simulator/estop``."""


def not_for_viewers(name: str, *, releases: bool = False) -> str:
    """Return why what only shows the graph may not call a service, by its full name, or an empty text.

    Any page that is open in a browser on a computer reaches a server of WebSockets there, whosever page it is.

    Args:
        name: For example ``/fish/servo_driver/estop``.
        releases: Whether an emergency stop is to be released by it.
    """
    last = name.rpartition("/")[2]
    if any(service.for_people and service.name == last for service in SERVICES):
        return "a person confirms with the operator's terminal or on the page"
    if last == "estop" and releases:
        return "a viewer only stops: release the stop with the operator's terminal, on the page or by ros2 service call"
    return ""
