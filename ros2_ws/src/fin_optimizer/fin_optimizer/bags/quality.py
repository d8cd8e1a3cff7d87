"""What the publishers of a recorded topic offered: of several offers the one with which every listener is content."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import parse_qos

if TYPE_CHECKING:
    from collections.abc import Sequence

_NO_TIME = QosTime(0, 0)
_USUAL_DEPTH = 1000  # as a plant offers it: room for all that a fast player has on its way
_NOT_TOLD = Qos(
    QosHistory.KEEP_LAST,
    _USUAL_DEPTH,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    _NO_TIME,
    _NO_TIME,
    QosLiveliness.AUTOMATIC,
    _NO_TIME,
    avoid_ros_namespace_conventions=False,
)


def offered(text: str) -> Qos:
    """Return what the publishers of a topic offered, where it is not told what suits every listener.

    Of several offers that differ the stronger one is taken, with which every listener can be content.

    Args:
        text: As it stands in a bag, YAML.
    """
    try:
        return _strongest(parse_qos(text))
    except (ReaderError, LookupError, TypeError, ValueError, AttributeError):
        return _NOT_TOLD


def _strongest(offers: Sequence[Qos]) -> Qos:
    """Return one offer for several; a recorder learns no history over the network, so most bags lack it."""
    if not offers:
        return _NOT_TOLD
    offer = offers[0]
    weak = all(item.reliability is QosReliability.BEST_EFFORT for item in offers)
    latched = any(item.durability is QosDurability.TRANSIENT_LOCAL for item in offers)
    offer = offer._replace(
        reliability=QosReliability.BEST_EFFORT if weak else QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
    )
    depth = max(item.depth for item in offers)
    if any(item.history is QosHistory.KEEP_ALL for item in offers):
        return offer._replace(history=QosHistory.KEEP_ALL)
    return offer._replace(history=QosHistory.KEEP_LAST, depth=depth if depth > 0 else _USUAL_DEPTH)
