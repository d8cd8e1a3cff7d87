"""The resistive coefficient of a tail that beats to and fro, which depends on how far it goes for its height.

A plate that oscillates across the water meets the vortices that it shed half a beat before. Its drag coefficient
follows the Keulegan-Carpenter number KC = U T / d (Keulegan & Carpenter, *Journal of Research of the National Bureau
of Standards* 60, 1958), with U the velocity's amplitude, T the period and d the height. For sharp edges vortex
shedding gives C = a KC^(-1/3), and measured plates a about 8 (Graham, *Journal of Fluid Mechanics* 97, 1980, for low
KC). Towards large KC it tends to the plate's in steady cross-flow, `normal_drag`, below which it is not taken.

KC is here that of the tail driven as if it were rigid and the body did not yaw: then it is one number for each place
of the tail, known from gait and shape before the swim, and the coefficient of a link is a constant like its others.
The beat's frequency drops out: KC = 2 pi A s / d at the distance s behind a joint of amplitude A. A fin that bends has
another amplitude at its tip, but the cube root makes of a doubled one 21 % less. Along a link the coefficient is the
mean with the weight of the power d U^3 that is lost, so that the rigidly driven tail loses what it would by stations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_plant.gait import Gait
    from fin_sim.fish import Link, Water

# Points along a link; the coefficient of a straight one is right to 1e-5.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(12)
STATIONS, _WEIGHTS = 0.5 * (1.0 + _POINTS), 0.5 * _WEIGHTS
"""Distances behind a link's joint in parts of its length, shape (points,)."""


def velocity_amplitudes(
    gait: Gait, joints: NDArray[np.float64], places: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the amplitude in m/s of the straight, rigidly driven tail's velocity across itself, and the beat in s.

    Joints of one frequency add up by their phases; of several, the amplitude is the root of the summed squares. The
    beat is that of the first joint that is driven to and fro; infinite where none is.

    Args:
        gait: One row for each driven joint.
        joints: Distances of the driven joints behind the first link's, m, shape (fins, driven).
        places: Distances of the places asked for, m, shape (fins, ...).
    """
    squares = np.zeros(places.shape)
    beating = [joint.frequency for joint in gait.joints if joint.amplitude > 0.0 and joint.frequency > 0.0]
    for frequency in sorted(set(beating)):
        phasor = np.zeros(places.shape, dtype=complex)
        for joint, place in zip(gait.joints, joints.T, strict=True):
            if joint.frequency == frequency:
                lever = np.maximum(places - place.reshape(-1, *[1] * (places.ndim - 1)), 0.0)
                phasor += 2.0 * np.pi * frequency * joint.amplitude * np.exp(1j * joint.phase) * lever
        squares += np.abs(phasor) ** 2
    return np.sqrt(squares), 1.0 / beating[0] if beating else np.inf


def link_coefficients(
    water: Water, gait: Gait, lengths: NDArray[np.float64], heights: NDArray[np.float64], driven: Sequence[int]
) -> NDArray[np.float64]:
    """Return C_N of the links of many tails, shape (fins, links).

    Args:
        water: Its ``oscillating_drag`` is a, its ``normal_drag`` the steady coefficient.
        gait: One row for each driven joint.
        lengths: Of the links, m, shape (fins, links).
        heights: At `STATIONS`, m, shape (fins, links, points).
        driven: Which links' joints are driven.
    """
    ends = np.cumsum(lengths, axis=1)
    begins = ends - lengths
    places = begins[:, :, None] + lengths[:, :, None] * STATIONS
    speed, beat = velocity_amplitudes(gait, begins[:, list(driven)], places)
    if not np.isfinite(beat):
        return np.full(lengths.shape, water.normal_drag)
    # a KC^(-1/3) d U^3 with KC = U T / d, written without dividing by what may be 0
    oscillating = water.oscillating_drag * (heights / beat) ** (1.0 / 3.0) * heights * speed ** (8.0 / 3.0)
    weight = heights * speed**3
    lost = np.maximum(water.normal_drag * weight, oscillating) @ _WEIGHTS
    total = weight @ _WEIGHTS
    mean = np.divide(lost, total, out=np.full(lengths.shape, water.normal_drag), where=total > 0.0)
    return np.asarray(mean, dtype=np.float64)


def chain_coefficients(water: Water, gait: Gait, links: Sequence[Link], driven: Sequence[bool]) -> tuple[float, ...]:
    """Return C_N of each link of one chain."""
    heights = [np.interp(STATIONS * link.length, *np.array(link.stations).T) for link in links]
    lengths = np.array([[link.length for link in links]])
    which = [index for index, is_driven in enumerate(driven) if is_driven]
    return tuple(link_coefficients(water, gait, lengths, np.array([heights]), which)[0].tolist())
