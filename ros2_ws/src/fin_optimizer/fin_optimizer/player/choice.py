"""What of a bag is played, and what is left out and why.

`gait` is left out unless it is asked for by name: a recorded command must not move a fish because somebody wanted to
look at a plot.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fin_optimizer.bags.messages import BagError, decode, is_known
from fin_optimizer.player.playback import Playback
from fin_plant import topics
from fin_plant.stamps import NANOSECONDS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_optimizer.bags.reader import Bag

_OF_OTHERS = ("/rosout", "/parameter_events", topics.DIAGNOSTICS.name, topics.CLOCK.name)
"""What every node says of itself, and the clock, which the player offers itself: played only by name."""
_JUMPS_TOLD = 3


@dataclass(frozen=True)
class Choice:
    """What is played.

    Attributes:
        names: Absolute names of the topics.
        playback: Their messages.
        told: What to say about everything else, a line each.
    """

    names: list[str]
    playback: Playback
    told: list[str]


def choose(bag: Bag, asked: Sequence[str], start: float) -> Choice:
    """Return what is played of a bag.

    Args:
        bag: The bag.
        asked: Topics that were asked for by name, none for all that may be played unasked.
        start: Where the playing begins, s after the bag's beginning.

    Raises:
        BagError: A topic that the bag does not have, or damaged bytes.
        ValueError: Nothing to play, or a start behind the bag's end.
    """
    chosen = _chosen_topics(bag, asked)
    reasons = _unplayable(bag, chosen, Playback(bag.messages(*chosen)))
    if asked and reasons:
        raise ValueError("; ".join(f"{name} cannot be played: {why}" for name, why in reasons.items()))
    names = [name for name in chosen if name not in reasons]
    playback = Playback(bag.messages(*names))
    reasons = {**bag.left_out, **reasons}
    told = [f"left out: {name}: {why}" for name, why in reasons.items()]
    if unasked := [name for name in bag.topics if name not in chosen]:
        told.append(f"left out: {', '.join(unasked)}; --topics plays what it names")
    if not playback.messages:
        msg = "; ".join([f"bag {bag.name} holds no message to play", *told])
        raise ValueError(msg)
    if start * NANOSECONDS > playback.length:
        length = playback.length / NANOSECONDS
        msg = f"--start {start:g} s is behind the end of the bag, which is {length:g} s long"
        raise ValueError(msg)
    told += [f"steps over {jump}" for jump in playback.jumps[:_JUMPS_TOLD]]
    if (more := len(playback.jumps) - _JUMPS_TOLD) > 0:
        told.append(f"steps over {more} more silences of that kind")
    return Choice(names, playback, told)


def _chosen_topics(bag: Bag, asked: Sequence[str]) -> list[str]:
    """Return the absolute names of the topics to play: those asked for, or all but ``gait`` and what nodes say.

    Raises:
        BagError: The bag has no such topic.
    """
    if asked:
        return [bag.topic(name) for name in asked]
    return [name for name in bag.topics if not name.endswith(f"/{topics.GAIT.name}") and name not in _OF_OTHERS]


def message_class(type_name: str) -> type[Any]:
    """Return the class of a message type.

    Raises:
        ValueError: It is not installed here.
    """
    package, _, kind = type_name.partition("/msg/")
    try:
        found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), kind)
    except (ImportError, AttributeError, ValueError, TypeError):
        msg = f"its type {type_name} is not installed here"
        raise ValueError(msg) from None
    return found


def _unplayable(bag: Bag, names: Sequence[str], playback: Playback) -> dict[str, str]:
    """Return why topics cannot be played, by name: no listener could understand what would be sent."""
    first: dict[str, bytes] = {}
    for _, name, data in playback.messages:
        first.setdefault(name, data)
    reasons = {}
    for name in names:
        type_name = bag.topics[name]
        try:
            message_class(type_name)
            if name in first and is_known(type_name):
                decode(first[name], type_name)
        except (ValueError, BagError) as error:
            reasons[name] = str(error)
    return reasons
