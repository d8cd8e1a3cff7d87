"""The paper's hill climber, with one objective or several."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search.space import Choice, Evaluation, Space, Values, best, generator, pareto_front, uniform
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.search.space import Scalar


# How often a step that left the range is drawn again. When as many steps all fall outside, the range is so narrow
# beside the step that a Gaussian inside it is flat: a uniform draw is then the same.
_REDRAWS = 1000


def gaussian_step(
    space: Space, centre: Mapping[str, Scalar], deviations: Mapping[str, float], random: np.random.Generator
) -> Values:
    """Return ``centre`` moved by an independent Gaussian step in every parameter, drawn again while outside.

    The paper does not say what happens to a step that leaves the range. Drawn again, the step is a Gaussian cut off at
    the bounds: its density stays smooth. Clipped, a large part of all steps near an end would land exactly on it, and
    the same fin would be built and swum again and again.

    A choice has no near and far: one in as many as there are parameters becomes any of the others (Li et al.,
    Evolutionary Computation 21, 2013: mixed-integer evolution strategies).

    Args:
        space: Ranges to stay in.
        centre: Where the step starts, inside the ranges.
        deviations: Standard deviation of the step, by parameter and in its unit, or in the natural logarithm.
        random: Where the random numbers come from.
    """
    result: Values = {}
    for dimension in space.dimensions:
        name, at = dimension.name, dimension.number(centre[dimension.name])
        if isinstance(dimension, Choice):
            changed = random.random() < 1.0 / len(space.dimensions)
            place = (at + int(random.integers(1, dimension.count))) % dimension.count if changed else at
            result[name] = dimension.value(place)
            continue
        # x' = x + sigma N(0, 1) (Clark et al. 2012: Gaussian mutation, sigma^2 = 0.1 GPa^2)
        steps = dimension.coordinates(np.asarray(at)) + deviations[name] * random.standard_normal(_REDRAWS)
        inside = steps[(steps >= dimension.low) & (steps <= dimension.high)]
        drawn = inside[0] if inside.size else random.uniform(dimension.low, dimension.high)
        result[name] = dimension.value(float(dimension.numbers(np.asarray(drawn))))
    return result


@dataclass(frozen=True)
class HillClimber:
    """The paper's hill climber: start anywhere in the range, step from the best so far, keep the better one.

    Raja Mohamed & Raviraj, and Clark et al. 2012: uniform start in the range, one Gaussian mutation a candidate with a
    variance of 0.1 (GPa^2). A candidate without a score is passed over, so it never becomes the one to step from; while
    nothing has a score yet, the start is drawn anew.

    With several objectives it steps from a fin of the Pareto front, drawn with equal chances, which is the Simple
    Evolutionary Multi-objective Optimizer of Laumanns, Thiele & Zitzler 2004 with a Gaussian step. With constraints
    it steps from the one that misses least while none meets them.

    Attributes:
        space: Where to search.
        seed: Of all its random numbers, 0 or more.
        deviations: Standard deviation of the step, as for `gaussian_step`, of every parameter that is no choice.

    Raises:
        ValueError: A seed or deviation that cannot be, or deviations for other parameters than the space's.
    """

    space: Space
    seed: int
    deviations: Mapping[str, float]

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)
        ranges = [dimension.name for dimension in self.space.ranges]
        if set(self.deviations) != set(ranges):
            msg = f"steps are given for {sorted(self.deviations)}, but the space has {sorted(ranges)}"
            raise ValueError(msg)
        for dimension in self.space.ranges:
            deviation = self.deviations[dimension.name]
            checks.number(f"step of {dimension.name}", deviation, 0.0, unit=dimension.unit, exclusive_minimum=True)

    def needed(self, number: int) -> int:  # noqa: ARG002  (as every search)
        """Return 0: it steps from the best that is known, whatever still swims."""
        return 0

    def propose(self, history: Sequence[Evaluation]) -> Values:
        """Return the candidate that follows ``history``."""
        random = generator(self.seed, len(history))
        # The parent is drawn evenly from the population, which is the front (Laumanns, Thiele & Zitzler 2004: SEMO).
        front = pareto_front(history) if any(entry.others for entry in history) else []
        incumbent = history[front[random.integers(len(front))]] if front else best(history)
        if incumbent is None:
            return uniform(self.space, random)
        for _ in range(_REDRAWS):
            drawn = gaussian_step(self.space, incumbent.values, self.deviations, random)
            same = self.space.is_countable and drawn == incumbent.values  # a step that was rounded away is none
            if not same and not self.space.judge(drawn):
                return drawn
        return uniform(self.space, random)
