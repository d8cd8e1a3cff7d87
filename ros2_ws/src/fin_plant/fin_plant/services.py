"""The services of the node graph, besides those that every node and every managed node has: for its documentation."""

from __future__ import annotations

from typing import NamedTuple

TRIGGER, SET_BOOL = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"


class Service(NamedTuple):
    """A service: its name, private to the node, its type, the nodes that offer it, and what it does."""

    name: str
    type_name: str
    nodes: tuple[str, ...]
    description: str


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
    Service("confirm_fin", TRIGGER, ("servo_driver",), "a person says that the fin asked for is mounted"),
    Service("confirm_mark", TRIGGER, ("servo_driver",), "a person says that the fish is back at its mark"),
    Service("start", TRIGGER, ("optimizer",), "the study goes on"),
    Service("pause", TRIGGER, ("optimizer", "player"), "the study holds after the trial under way; a player holds"),
    Service("stop", TRIGGER, ("optimizer",), "the study ends, the trial under way INTERRUPTED"),
    Service("repeat", TRIGGER, ("optimizer",), "the trial under way, or else the last one, is swum again"),
    Service("resume", TRIGGER, ("player",), "a player of a bag goes on"),
)
"""Each of them, as a node ``/fish/simulator`` offers it: ``/fish/simulator/estop``."""
