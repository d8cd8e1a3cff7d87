"""What a node sees of the graph, and what can be said of a topic on which nothing comes.

A silent topic has many causes: nobody publishes it, in this namespace or at all, or with another type, or less than a
listener asks for, or where this process cannot see it. What is seen tells them apart, and is said; what is not seen is
not guessed at. Only `look_around` asks a node, the rest are functions of a `Sight`. Nothing here imports ROS.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fin_plant.ros_environment import LOCALHOST_PROFILE, PROFILES, RANGE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.topic_endpoint_info import TopicEndpointInfo

    from fin_plant.topics import Topic

NAME_TO_COME = "_NODE_NAME_UNKNOWN_"
"""What rmw calls a node whose end of a topic was discovered a moment before its name."""
_NAMED = 5
"""Nodes or topics that a sentence names."""
_LOCAL_RANGES = ("LOCALHOST", "OFF")


@dataclass(frozen=True)
class End:
    """A node's end of a topic.

    Attributes:
        node: Its full name; empty if it is not known yet.
        type_name: As ROS writes it, for example ``geometry_msgs/msg/Twist``.
        reliable: Whether a publisher repeats what was lost, or a listener asks for that.
        latched: Whether a publisher keeps messages for who comes later (transient local), or a listener asks for it.
    """

    node: str
    type_name: str
    reliable: bool = True
    latched: bool = False

    @property
    def shown(self) -> str:
        """The node as a sentence names it."""
        return self.node or "a node that has not told its name yet"


@dataclass(frozen=True)
class Sight:
    """What a node sees of the graph.

    Attributes:
        nodes: Full names of the other nodes, without hidden ones.
        publishers: Ends of the other nodes that publish a topic, by the topic's full name.
        services: Full names of the services that somebody offers.
        environment: Variables of this process.
    """

    nodes: Sequence[str] = ()
    publishers: Mapping[str, Sequence[End]] = field(default_factory=dict)
    services: Sequence[str] = ()
    environment: Mapping[str, str] = field(default_factory=dict)


def nothing_on(
    name: str, wanted: End, sight: Sight, *, advice: str = "", of_any_name: bool = False, since: str = ""
) -> str:
    """Return what is seen of a topic on which nothing comes.

    Args:
        name: Full name of the topic.
        wanted: Its type, and what the listener asks for.
        sight: What is seen.
        advice: What to do where the topic is elsewhere, with ``{topic}`` and ``{namespace}`` for where that is.
        of_any_name: A topic of the same type can take its place whatever its name.
        since: For how long nothing has come, if something came before: "within the last second".
    """
    if ends := sight.publishers.get(name, ()):
        return "; ".join(dict.fromkeys(_unheard(end, name, wanted, since) for end in ends))
    said = f"nobody publishes topic {name}"
    if there := _elsewhere(name, wanted.type_name, sight, of_any_name=of_any_name):
        topic = there[0]
        found = ", ".join(f"{each} by {sight.publishers[each][0].shown}" for each in there[:_NAMED])
        do = advice.format(topic=topic, namespace=topic.rpartition("/")[0] or "/")
        return f"{said}; published is {found}" + (f": {do}" if do else "")
    return f"{said}; {around(sight)}"


def no_service(name: str, sight: Sight, *, advice: str = "") -> str:
    """Return what is seen of a service that is not there; ``advice`` has a ``{namespace}`` for where it is instead."""
    tail = "/".join(name.split("/")[-2:])
    there = sorted(each for each in sight.services if each.endswith(f"/{tail}") and each != name)
    if not there:
        return f"nobody offers service {name}; {around(sight)}"
    namespace = there[0].removesuffix(f"/{tail}") or "/"
    return f"nobody offers service {name}; offered is {', '.join(there[:_NAMED])}: {advice.format(namespace=namespace)}"


def nobody_hears(name: str, offered: End, listeners: Sequence[End]) -> str:
    """Return why nobody who listens to a topic hears what is offered there, or nothing if somebody does."""
    if not listeners:
        return f"nobody listens to topic {name}"
    deaf = []
    for end in listeners:
        if end.type_name != offered.type_name:
            deaf.append(f"{end.shown} listens to topic {name} as {end.type_name}, sent is {offered.type_name}")
        elif lacks := _lacks(offered, end):
            deaf.append(f"{end.shown} listens to topic {name} and asks for {lacks}")
        else:
            return ""
    return "; ".join(deaf)


def no_fresh_gait(name: str, publishers: Sequence[End], refused: int, refusal: str) -> str:
    """Return why a plant has had no fresh gait within its timeout.

    Args:
        name: Full name of the gait's topic.
        publishers: Who publishes it now.
        refused: Number of gaits that came since the one that was followed, and were refused.
        refusal: Why the last of them was.
    """
    said = "no fresh gait within command_timeout"
    if refused:
        return f"{said}: {refused} came and {'was' if refused == 1 else 'were'} refused: {refusal}"
    if not publishers:
        return f"{said}: nobody publishes topic {name} any more"
    return f"{said}: nothing came on topic {name}, which {', '.join(end.shown for end in publishers)} publishes"


def around(sight: Sight) -> str:
    """Return which other nodes are seen, and how far this process sees."""
    settings, where = _reach(sight.environment)
    if not sight.nodes:
        reach = ", ".join([*settings, *where])
        return f"no other node is seen at all, with {reach}: one that has other settings, or runs beyond, is not seen"
    more = len(sight.nodes) - _NAMED
    named = ", ".join(sight.nodes[:_NAMED]) + (f" and {more} more" if more > 0 else "")
    return f"the other nodes seen are {named} ({', '.join([settings[0], *where])})"


def request(ends: Iterable[End], usual: End) -> tuple[bool, bool]:
    """Return whether to ask for reliable and for latched messages so that all of these publishers are heard.

    As rosbag2 does: what all of them offer, here never more than is usual. One of another type is not heard anyway.
    """
    heard = [usual, *(end for end in ends if end.type_name == usual.type_name)]
    return all(end.reliable for end in heard), all(end.latched for end in heard)


def _unheard(end: End, name: str, wanted: End, since: str) -> str:
    if end.type_name != wanted.type_name:
        return f"{end.shown} publishes topic {name} as {end.type_name}, needed is {wanted.type_name}"
    if lacks := _lacks(end, wanted):
        return f"{end.shown} publishes topic {name}, but not {lacks}, which is needed"
    return f"{end.shown} publishes topic {name}, but no message has come{' ' if since else ''}{since}"


def _lacks(offered: End, asked: End) -> str:
    """Return what a listener asks for and a publisher does not offer, as policies of the quality of service."""
    lacks = ["reliable (it is best effort)"] if asked.reliable and not offered.reliable else []
    lacks += ["transient local (it is volatile)"] if asked.latched and not offered.latched else []
    return " and ".join(lacks)


def _elsewhere(name: str, type_name: str, sight: Sight, *, of_any_name: bool) -> list[str]:
    """Return the topics of that type that somebody publishes, those with the same last name first."""
    last = name.rpartition("/")[2]
    there = sorted(
        each for each, ends in sight.publishers.items() if ends and any(end.type_name == type_name for end in ends)
    )
    same = [each for each in there if each.rpartition("/")[2] == last]
    return [*same, *(each for each in there if each not in same)] if of_any_name else same


def _reach(environment: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Return the settings that decide which nodes are seen, the domain first, and what they amount to."""
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    reach = environment.get(RANGE) or "SUBNET"
    profile = Path(environment.get(PROFILES) or "").name
    is_local_profile = profile == LOCALHOST_PROFILE.name
    only = environment.get("ROS_LOCALHOST_ONLY") or ""
    said = [f"ROS_DOMAIN_ID={domain}", f"{RANGE}={reach}"]
    said += [f"{PROFILES}={profile}"] if is_local_profile else []
    for variable in ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "RMW_IMPLEMENTATION"):
        said += [f"{variable}={environment[variable]}"] if environment.get(variable) else []
    local = reach in _LOCAL_RANGES or is_local_profile or only == "1"
    return said, ["on this computer only"] if local else []


def wanted(topic: Topic[Any], qos: QoSProfile | None = None) -> End:
    """Return what is asked for by a listener to a topic, with this quality of service or what publishers promise."""
    return End("", topic.type_name, *policies(qos or topic.qos))


def ends_of(infos: Iterable[TopicEndpointInfo]) -> list[End]:
    """Return what rmw tells of the ends of a topic."""
    return [End(_full_name(info), str(info.topic_type), *policies(info.qos_profile)) for info in infos]


def look_around(node: Node) -> Sight:
    """Return what a node sees of the graph now; itself it does not see."""
    own = node.get_fully_qualified_name()
    nodes = [f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces() if name[:1] != "_"]
    topics = {name: ends_of(node.get_publishers_info_by_topic(name)) for name, _ in node.get_topic_names_and_types()}
    others = {name: [end for end in ends if end.node != own] for name, ends in topics.items()}
    services = [name for name, _ in node.get_service_names_and_types()]
    return Sight(sorted({name for name in nodes if name != own}), others, services, dict(os.environ))


def _full_name(info: TopicEndpointInfo) -> str:
    return "" if info.node_name == NAME_TO_COME else f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def policies(qos: QoSProfile) -> tuple[bool, bool]:
    """Return whether a quality of service is reliable, and whether it is latched."""
    return qos.reliability.name == "RELIABLE", qos.durability.name == "TRANSIENT_LOCAL"
