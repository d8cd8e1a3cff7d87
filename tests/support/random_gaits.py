"""Numbers and gaits of every kind, right and wrong, for tests that throw them at the driver."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

SPECIAL = np.array(
    [
        0.0,
        -0.0,
        math.nan,
        math.inf,
        -math.inf,
        5e-324,
        -5e-324,
        2.2e-308,
        1e308,
        -1e308,
        0.26179938779914946,
        1e-9,
        15.0,
    ]
)


def numbers(random: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return floats of every kind: special ones, any bit pattern, and sensible ones."""
    kinds = random.integers(0, 3, count)
    bits = random.integers(0, 2**64, count, dtype=np.uint64).view(np.float64)
    sensible = random.normal(0.0, 1.0, count)
    return np.choose(kinds, [random.choice(SPECIAL, count), bits, sensible])


def random_gaits(random: np.random.Generator, count: int) -> Iterator[Float64MultiArray]:
    """Yield gaits with wrong sizes, wrong layouts and every kind of number, and some that are right."""
    for _ in range(count):
        size = int(random.choice([0, 1, 3, 4, 4, 4, 4, 8, 84]))
        data = numbers(random, size)
        if random.random() < 0.5 and size == 4:
            data = np.abs(np.array([0.2, 0.9, 0.1, 0.01]) * random.normal(1.0, 1.0, 4))
        message = Float64MultiArray(data=data.tolist())
        if random.random() < 0.2:
            message.layout.dim = [MultiArrayDimension(size=int(random.integers(0, 5))) for _ in range(2)]
            message.layout.data_offset = int(random.integers(0, 2))
        yield message
