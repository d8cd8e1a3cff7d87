"""A swim as what a canvas draws: outlines of body, peduncle and fin seen from above, and how they move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.swim_result import Swim

_FRAMES_A_SECOND = 25.0
_LONGEST = 12.0
"""Of a film, s: of a longer swim its end is shown."""
_TENTH_OF_A_MM = 1e4


def film_of(swim: Swim, body: tuple[float, float]) -> dict[str, Any]:
    """Return a swim as plain data.

    Args:
        swim: What was swum.
        body: Length and width of the body, m.

    Returns:
        ``rate`` in frames a second, ``start`` in s, ``beat`` in s (0 of a tail that does not beat), ``body`` as length
        and width, ``driven`` saying of each link whether a servo moves it, and ``frames``: each the body's x, y and
        heading, then x and y of each joint and of the trailing edge; lengths in tenths of a millimetre from where the
        film starts, angles in thousandths of a radian, all whole numbers.
    """
    end = swim.duration
    start = max(0.0, end - _LONGEST)
    times = np.arange(start, end + 0.5 / _FRAMES_A_SECOND, 1.0 / _FRAMES_A_SECOND)
    places = np.clip(np.searchsorted(swim.time, times), 0, len(swim.time) - 1)
    origin = np.array([swim.x[places[0]], swim.y[places[0]]])
    joints = (swim.joint_path[places] - origin) * _TENTH_OF_A_MM
    centre = (np.column_stack((swim.x, swim.y))[places] - origin) * _TENTH_OF_A_MM
    rows = np.column_stack((centre, 1e3 * swim.heading[places], joints.reshape(len(places), -1)))
    return {
        "rate": _FRAMES_A_SECOND,
        "start": round(start, 3),
        "beat": round(1.0 / swim.frequency, 4) if swim.frequency else 0.0,
        "body": _whole(np.array(body) * _TENTH_OF_A_MM),
        "driven": list(map(bool, swim.chain.driven)),
        "frames": [_whole(row) for row in rows],
    }


def _whole(numbers: NDArray[np.float64]) -> list[int]:
    return [round(number) for number in numbers.tolist()]
