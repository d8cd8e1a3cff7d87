"""What describes a bag as a whole: the content of rosbag2's ``metadata.yaml``, version 9, and how it is written out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9

from fin_optimizer.bags.messages import type_hash

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from rosbags.interfaces import Qos

BAG_VERSION = 9
ROS_DISTRIBUTION = "jazzy"
UNUSABLE_STAMPS = "unusable_stamps"
"""Name of the MCAP metadata record that counts, by topic, the messages whose stamp could not be believed."""


@dataclass(frozen=True)
class BagTopic:
    """A topic to record.

    Attributes:
        name: Absolute name, for example ``/fish/velocity``.
        type_name: Message type, for example ``geometry_msgs/msg/TwistStamped``.
        qos: What its publisher offers, so that a player can offer the same.
    """

    name: str
    type_name: str
    qos: Qos


@dataclass(frozen=True)
class BagSummary:
    """What a closed bag holds.

    Attributes:
        path: Folder of the bag.
        counts: Number of messages by topic, also of topics without any.
        start_ns: Log time of the earliest message in ns since the epoch, 0 in an empty bag.
        duration_ns: Time in ns from the earliest to the latest message.
        unusable_stamps: Number of messages by topic that have a header, but no stamp that can be believed.
        first_unusable: What the first such stamp of a topic is.
    """

    path: Path
    counts: Mapping[str, int]
    start_ns: int
    duration_ns: int
    unusable_stamps: Mapping[str, int]
    first_unusable: Mapping[str, str]

    @property
    def message_count(self) -> int:
        """Number of messages of all topics."""
        return sum(self.counts.values())


def bag_information(
    summary: BagSummary, topics: Iterable[BagTopic], file_name: str, metadata: Mapping[str, str]
) -> dict[str, object]:
    """Return the content of metadata.yaml.

    Args:
        summary: What the bag holds.
        topics: What was recorded.
        file_name: Of its only MCAP file.
        metadata: What describes the trial.
    """
    described = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": "cdr",
                "offered_qos_profiles": dump_qos_v9([topic.qos]),
                "type_description_hash": type_hash(topic.type_name),
            },
            "message_count": summary.counts[topic.name],
        }
        for topic in topics
    ]
    extent = {
        "duration": {"nanoseconds": summary.duration_ns},
        "starting_time": {"nanoseconds_since_epoch": summary.start_ns},
        "message_count": summary.message_count,
    }
    unusable = {f"{UNUSABLE_STAMPS}.{topic}": str(count) for topic, count in summary.unusable_stamps.items()}
    return {
        "version": BAG_VERSION,
        "storage_identifier": "mcap",
        **extent,
        "topics_with_message_count": described,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **extent}],
        "custom_data": {**metadata, **unusable},
        "ros_distro": ROS_DISTRIBUTION,
    }


@cache
def qos_text(qos: Qos) -> str:
    """Return what a publisher offers, as a channel's metadata tells it."""
    return as_yaml(dump_qos_v9([qos]))


if TYPE_CHECKING:
    _Dumper = yaml.SafeDumper
else:  # libyaml's own where it is there: every trial writes two texts of some kilobytes, and it is ten times as fast
    _Dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class _PlainDumper(_Dumper):
    """Writes a list that occurs twice twice: rosbag2's reader wants no references."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002  (PyYAML asks for it)
        return True


def as_yaml(content: object) -> str:
    """Return the text of a YAML document, its entries in their order."""
    return yaml.dump(content, Dumper=_PlainDumper, sort_keys=False, allow_unicode=True)
