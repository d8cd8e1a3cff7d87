"""What a simulated fish looks like: the links of its chain, and the axes of its body, as a description for viewers."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from fin_plant.fish_model import BodyShape, hinge_links, urdf

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_sim.chain import Chain


def description(chain: Chain, values: Mapping[str, object]) -> str:
    """Return the URDF of a fish.

    Args:
        chain: Its chain.
        values: The plant's parameters, for the body's axes in m.
    """
    length, width, height = (cast("float", values[f"body.{axis}"]) for axis in ("length", "width", "height"))
    body = BodyShape(length, width, height, chain.body.tail_offset)
    lengths = [link.length for link in chain.links]
    heights = [link.area / link.length for link in chain.links]
    return urdf(body, hinge_links(lengths, heights, chain.driven))
