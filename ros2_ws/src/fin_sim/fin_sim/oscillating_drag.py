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
    gaits: NDArray[np.float64], joints: NDArray[np.float64], places: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the amplitude in m/s of the straight, rigidly driven tail's velocity across itself, and the beat in s.

    Joints of one frequency add up by their phases; of several, the amplitude is the root of the summed squares. The
    beat, shape (fins or 1,), is that of the first joint that is driven to and fro; infinite where none is.

    Args:
        gaits: As `Gait.rows`, shape (fins or 1, driven, 4).
        joints: Distances of the driven joints behind the first link's, m, shape (fins, driven).
        places: Distances of the places asked for, m, shape (fins, ...).
    """
    spread = (-1, *[1] * (places.ndim - 1))
    amplitude, frequency, phase = (gaits[:, :, column] for column in range(3))
    beats = (amplitude > 0.0) & (frequency > 0.0)
    levers = [np.maximum(places - place.reshape(spread), 0.0) for place in joints.T]
    squares = np.zeros(places.shape)
    for joint in range(gaits.shape[1]):
        alike = beats & beats[:, joint, None] & (frequency == frequency[:, joint, None])
        alike[alike[:, :joint].any(axis=1)] = False  # they are counted with the first joint of their frequency
        weight = np.where(alike, 2.0 * np.pi * frequency * amplitude, 0.0) * np.exp(1j * phase)
        phasor = np.zeros(places.shape, dtype=complex)
        for lever, part in zip(levers, weight.T, strict=True):
            phasor += part.reshape(spread) * lever
        squares += np.abs(phasor) ** 2
    first = np.take_along_axis(frequency, np.argmax(beats, axis=1)[:, None], axis=1)[:, 0]
    return np.sqrt(squares), np.divide(1.0, first, out=np.full(len(first), np.inf), where=beats.any(axis=1))


def link_coefficients(
    water: Water,
    gaits: NDArray[np.float64],
    lengths: NDArray[np.float64],
    heights: NDArray[np.float64],
    driven: Sequence[int],
) -> NDArray[np.float64]:
    """Return C_N of the links of many tails, shape (fins, links).

    Args:
        water: Its ``oscillating_drag`` is a, its ``normal_drag`` the steady coefficient.
        gaits: As `Gait.rows`, shape (fins or 1, driven, 4).
        lengths: Of the links, m, shape (fins, links).
        heights: At `STATIONS`, m, shape (fins, links, points).
        driven: Which links' joints are driven.
    """
    ends = np.cumsum(lengths, axis=1)
    begins = ends - lengths
    places = begins[:, :, None] + lengths[:, :, None] * STATIONS
    speed, beat = velocity_amplitudes(gaits, begins[:, list(driven)], places)
    beat = beat.reshape(-1, 1, 1)  # of a tail that is not driven it is infinite, and speed and weight are 0
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
    return tuple(link_coefficients(water, gait.rows()[None], lengths, np.array([heights]), which)[0].tolist())
