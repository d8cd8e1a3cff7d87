"""What a 3-D view needs, for bags that were recorded without it: in a copy, and the original stays as it is."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from fin_optimizer.bags.messages import BagError, decode, message_types
from fin_optimizer.bags.metadata import BagTopic
from fin_optimizer.bags.model_messages import DESCRIPTION, JOINT_STATES, POSE, TF, ModelMessages, quality
from fin_optimizer.bags.reader import read_bag
from fin_optimizer.bags.writer import BagWriter
from fin_plant.fin import Fin, node_table
from fin_plant.fish_model import DRIVEN, BodyShape, robot_links, urdf

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from fin_optimizer.bags.metadata import BagSummary
    from fin_optimizer.bags.reader import Bag

_STRING, _JOINT_STATE = "std_msgs/msg/String", "sensor_msgs/msg/JointState"


def enriched(bag: Bag, copy: Path) -> BagSummary:
    """Write a copy of a bag that holds description, frames, shapes and path too, in the order of time.

    Args:
        bag: As it was recorded.
        copy: Folder of the copy, which must not exist.

    Raises:
        BagError: The bag holds frames already, lacks pose or joint states, is damaged, or the disk refuses.
    """
    if TF in bag.topics:
        msg = f"bag {bag.name} holds {TF} already: there is nothing to add"
        raise BagError(msg)
    if missing := [name for name in (POSE, JOINT_STATES) if not any(t.endswith(f"/{name}") for t in bag.topics)]:
        msg = f"bag {bag.name} has no {' and no '.join(missing)}: nothing tells where the fish was"
        raise BagError(msg)
    pose, joints = bag.topic(POSE), bag.topic(JOINT_STATES)
    namespace = pose.removesuffix(f"/{POSE}")
    # Of one moment the angles come first: the frames are made when the pose comes.
    order = {joints: 0, pose: 2}
    messages = sorted(bag.messages(*bag.topics), key=lambda message: (message[1], order.get(message[0], 1)))
    if not messages:
        msg = f"bag {bag.name} is empty: there is nothing to show"
        raise BagError(msg)
    model = ModelMessages(namespace)
    topics = [BagTopic(name, kind, bag.offered(name)) for name, kind in bag.topics.items()]
    described = [name for name in bag.topics if name.endswith(f"/{DESCRIPTION}")]
    if not described:
        text = description_of(bag.metadata, next(data for name, _, data in messages if name == joints))
        topic = f"{namespace}/{DESCRIPTION}"
        topics.append(BagTopic(topic, _STRING, quality(latched=True)))
        data = bytes(message_types().serialize_cdr(message_types().types[_STRING](text), _STRING))
        messages.insert(0, (topic, messages[0][1], data))
    new = [topic for topic in model.topics if topic.name not in bag.topics]
    if len(new) < len(model.topics):
        msg = f"bag {bag.name} holds shapes or a path of another program: there is no room for these"
        raise BagError(msg)
    with BagWriter(copy, [*topics, *new], bag.metadata, derived=model.take) as writer:
        for name, log_time, data in messages:
            writer.copy(name, data, log_time)
    copied = read_bag(copy)
    if any(copied.counts[name] != count for name, count in bag.counts.items()):
        msg = f"the copy {copy} differs from {bag.name}: look at the disk"
        raise BagError(msg)
    return writer.close()


def description_of(metadata: Mapping[str, str], joint_state: bytes) -> str:
    """Return the URDF of the fish of a bag.

    Args:
        metadata: Of the bag: parameters of the fin and, of a simulated fish, of body and peduncle.
        joint_state: One of its messages, which names the joints.
    """
    values = {name: _value(text) for name, text in metadata.items()}
    if metadata.get("plant") == "simulator":
        return _of_simulator(values)
    fin = Fin.from_parameters({name: value for name, value in values.items() if name.startswith("fin.")})
    names = decode(joint_state, _JOINT_STATE).name
    return urdf(BodyShape(), robot_links(fin, max(1, sum(name.startswith(DRIVEN) for name in names))))


def _of_simulator(values: Mapping[str, Any]) -> str:
    from fin_sim.chain import build_chain  # noqa: PLC0415  (SciPy: only such a bag waits for it)
    from fin_sim.fish import Fish  # noqa: PLC0415
    from fin_sim.fish_shape import description  # noqa: PLC0415

    table = node_table("fin_sim", "simulator")
    own = table.checked({name: value for name, value in values.items() if name in table})
    return description(build_chain(Fish.from_parameters(own), Fin.from_parameters(own)), own)


def _value(text: str) -> Any:
    """Return a parameter that metadata tell: JSON, or a text."""
    try:
        return json.loads(text)
    except ValueError:
        return text
