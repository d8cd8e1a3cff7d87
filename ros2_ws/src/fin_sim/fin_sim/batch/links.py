"""From columns of fins to columns of links: what `chain.build_chain` does for one fin, for many at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from fin_sim.batch.columns import NAMES, WORDS
from fin_sim.batch.equations import LaneLink
from fin_sim.oscillating_drag import STATIONS, link_coefficients

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from fin_plant.gait import Gait
    from fin_sim.fish import Fish, Water


def stiffness_per_height(fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return a hinge's stiffness over the height of the sheet at it, N/rad, shape (n,), as `Fin.hinge_stiffness`."""
    modulus, thickness, length, segments = (
        fins[name].astype(float) for name in ("young_modulus", "thickness", "length", "segments")
    )
    length = np.where(fins["stiffness_length"] == "segment", length / segments, length)
    return np.asarray(modulus * thickness**3 / (12.0 * length))  # eq. 3


def least_damping_times(fins: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
    """Return the least damping over stiffness of any hinge that the fins could have, s, shape (n,)."""
    highest = np.maximum(fins["height"].astype(float), fins["tip_height"].astype(float))
    with np.errstate(all="ignore"):  # a fin that is refused may be of any size
        own = fins["hinge_damping"].astype(float) / (stiffness_per_height(fins) * highest)
    return np.asarray(fins["damping_time"].astype(float) + own)


def link_columns(fish: Fish, fins: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.float64]]:
    """Return the links of fins of equal segments and hinges, by attribute of `Link`, each of shape (n, links)."""
    count = len(fins["length"])
    number = {name: fins[name].astype(float)[:, None] for name in NAMES if name not in WORDS}
    segments = int(fins["segments"][0])
    inner = np.arange(1, segments) if fins["hinges"][0] == "between" else np.arange(segments) + 0.5
    at = np.concatenate(([0.0], inner / segments, [1.0]))
    heights = number["height"] * (1.0 - at) + number["tip_height"] * at
    stiffness = heights[:, :-1] * stiffness_per_height(fins)[:, None]
    tail = {
        "length": number["length"] * np.diff(at),
        "root_height": heights[:, :-1],
        "tip_height": heights[:, 1:],
        "mass_per_area": np.broadcast_to(number["density"] * number["thickness"], (count, len(at) - 1)),
        "stiffness": stiffness,
        "damping": stiffness * number["damping_time"] + number["hinge_damping"],
    }
    return {
        name: np.hstack((np.tile([getattr(link, name) for link in fish.peduncle], (count, 1)), column))
        for name, column in tail.items()
    }


def normal_drags(links: Mapping[str, NDArray[np.float64]], fish: Fish, gait: Gait) -> NDArray[np.float64] | float:
    """Return C_N of every link, shape (n, links), or the one of all where it does not depend on the gait."""
    if fish.water.oscillating_drag == 0.0:
        return fish.water.normal_drag
    root, tip = links["root_height"][:, :, None], links["tip_height"][:, :, None]
    heights = root + (tip - root) * STATIONS
    return link_coefficients(fish.water, gait, links["length"], heights, range(fish.driven_joints))


def lane_constants(
    links: Mapping[str, NDArray[np.float64]], water: Water, normal_drag: NDArray[np.float64] | float | None = None
) -> dict[str, NDArray[np.float64]]:
    """Return the constants of `LaneLink`, each of shape (n, links); moments of linear heights in closed form.

    Args:
        links: Attributes of `Link`, each of shape (n, links).
        water: The water.
        normal_drag: C_N, shape (n, links) or one for all; the water's where none is given.
    """
    length, root, tip = links["length"], links["root_height"], links["tip_height"]
    change = tip - root
    virtual = 0.25 * np.pi * water.density
    virtual_moments = [
        virtual * length ** (p + 1) * (root**2 / (p + 1) + 2.0 * root * change / (p + 2) + change**2 / (p + 3))
        for p in range(3)
    ]
    solid_moments = [links["mass_per_area"] * length ** (p + 1) * (root / (p + 1) + change / (p + 2)) for p in range(3)]
    resistive = -0.5 * water.density * (water.normal_drag if normal_drag is None else normal_drag) * water.resists
    normal = [v + s for v, s in zip(virtual_moments, solid_moments, strict=True)]
    constants = LaneLink(
        length=length,  # type: ignore[arg-type]  # columns here, numbers in the traced equations
        along_mass=solid_moments[0],  # type: ignore[arg-type]
        normal_mass=normal[0],  # type: ignore[arg-type]
        normal_first=normal[1],  # type: ignore[arg-type]
        normal_second=normal[2],  # type: ignore[arg-type]
        virtual_mass=virtual_moments[0],  # type: ignore[arg-type]
        virtual_first=virtual_moments[1],  # type: ignore[arg-type]
        tip_virtual=virtual * tip**2 * (water.wake == "lighthill"),  # type: ignore[arg-type]
        resistive_force=resistive * root * length / 3.0,  # type: ignore[arg-type]
        resistive_moment=resistive * root * length**2 / 12.0,  # type: ignore[arg-type]
        taper_force=resistive * change * length / 12.0,  # type: ignore[arg-type]
        taper_moment=resistive * change * length**2 / 30.0,  # type: ignore[arg-type]
    )
    return cast("dict[str, NDArray[np.float64]]", vars(constants))
