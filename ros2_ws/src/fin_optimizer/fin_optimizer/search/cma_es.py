"""CMA-ES as the yardstick: the covariance matrix adaptation of the library `cmaes`, made safe for a study.

The library ranks NaN as the best score and loses its random numbers when an optimiser is pickled. Here a candidate
without a score counts as the worst of its generation, and nothing is pickled: an optimiser is told the whole history
again where the one at hand has not seen it. One that says that it is done goes on to numbers that are none: another
begins in its place, at a mean of its own (Hansen 2016, B.3 and E.4).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cmaes
import numpy as np

from fin_optimizer.search.space import Choice, uniform
from fin_plant import checks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from fin_optimizer.search.genetic import Generation
    from fin_optimizer.search.space import Space

_REDRAWS = 1000
"""As `search.gaussian_step`."""
_LARGEST_SEED = 2**32  # of the library's random numbers


@dataclass
class _Replay:
    """An optimiser, the generations that it was told, by identity, and what it drew and showed for each.

    Of a parameter with steps a value is shown that is next to what was drawn.
    """

    optimiser: cmaes.CMA | cmaes.CMAwM
    told: list[Generation] = field(default_factory=list)
    drawn: list[NDArray[np.float64]] = field(default_factory=list)
    shown: list[NDArray[np.float64]] = field(default_factory=list)


@dataclass(frozen=True)
class CmaEs:
    """CMA-ES over the space scaled to the unit box (Hansen, arXiv:1604.00772; population and weights by the library).

    Attributes:
        space: Where to search; at least two parameters, as the library wants, and no choices.
        seed: Of all its random numbers, 0 or more.
        population: Candidates of a generation; the library's 4 + 3 ln(parameters) where none is given.
        deviation: Initial standard deviation, as a share of each range.

    Raises:
        ValueError: A number that cannot be, a space of one parameter, or a choice.
    """

    space: Space
    seed: int
    population: int | None = None
    deviation: float = 0.3
    _replays: list[_Replay] = field(default_factory=list, repr=False, compare=False)

    def __post_init__(self) -> None:
        checks.whole_number("seed", self.seed, 0)
        checks.number("deviation", self.deviation, 0.0, 1.0, exclusive_minimum=True)
        if len(self.space.names) < 2:  # noqa: PLR2004
            msg = f"CMA-ES needs at least 2 parameters, the space has {list(self.space.names)}: use the hill climber"
            raise ValueError(msg)
        for dimension in self.space.dimensions:
            if isinstance(dimension, Choice):
                msg = f"CMA-ES cannot choose, as {dimension.name} wants it: use hill_climber, genetic, tpe or gp"
                raise ValueError(msg)
        if self.population is not None:
            checks.whole_number("population", self.population, 5)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "_replays": []}

    def propose(self, history: Sequence[Generation]) -> NDArray[np.float64]:
        """Return the next generation, shape (population, parameters)."""
        replay = self._replays[-1] if self._replays else None
        if replay is None or any(a is not b for a, b in zip(replay.told, history, strict=False)):
            replay = _Replay(self._optimiser())
            self._replays[:] = [replay]
        while len(replay.drawn) <= len(history):
            if replay.drawn:
                self._tell(replay, history[len(replay.told)])
                if _is_done(replay.optimiser):
                    replay.optimiser = self._optimiser(len(replay.told))
            # x_k = m + sigma y_k, y_k ~ N(0, C) (Hansen 2016, eq. 38 to 40), drawn by the library
            count = replay.optimiser.population_size
            shown, drawn = zip(
                *(self._asked(replay.optimiser, len(replay.told), place) for place in range(count)), strict=True
            )
            replay.shown.append(np.array(shown))
            replay.drawn.append(np.array(drawn))
        return self._numbers(replay.shown[len(history)])

    def _numbers(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return candidates that were given in the unit box, shape (candidates, parameters)."""
        low, high = self._ends()
        result = np.clip(low + (high - low) * scaled, low, high)
        for column, dimension in enumerate(self.space.ranges):
            if dimension.count is not None:
                result[:, column] = dimension.coordinates(result[:, column])
        return self.space.numbers(result)

    def _scaled(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where a candidate, shape (parameters,), lies in the unit box."""
        low, high = self._ends()
        moving = np.array([dimension.count is None for dimension in self.space.ranges])
        return np.asarray((np.where(moving, self.space.coordinates(numbers[None, :])[0], numbers) - low) / (high - low))

    def _ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what 0 and 1 in the unit box stand for: coordinates, but of a parameter with steps itself.

        The library's margin wants steps of one size, so a whole number is not searched by its logarithm.
        """
        low, high = self.space.bounds
        for column, dimension in enumerate(self.space.ranges):
            if dimension.count is not None:
                low[column] = dimension.minimum - 0.5 * dimension.step
                high[column] = low[column] + dimension.count * dimension.step
        return low, high

    def _asked(
        self, optimiser: cmaes.CMA | cmaes.CMAwM, generation: int, place: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the next candidate in the unit box, as it is shown and as it was drawn.

        One that the space refuses is drawn again (Hansen 2016, B.5).
        """
        for _ in range(_REDRAWS):
            asked = optimiser.ask()
            shown, drawn = asked if isinstance(asked, tuple) else (asked, asked)
            if not self.space.refused(self._numbers(shown[None, :])).size:
                return shown, drawn
        # The distribution has left what can be: one that can is told to it as if it had been drawn.
        seed = np.random.SeedSequence(self.seed, spawn_key=(generation, place))
        drawn = self._scaled(np.array(self.space.row(uniform(self.space, np.random.default_rng(seed)))))
        return drawn, drawn

    def _optimiser(self, generation: int = 0) -> cmaes.CMA | cmaes.CMAwM:
        """Return the optimiser that begins with a generation; random numbers follow from it and from the seed."""
        key = (generation,) if generation else ()
        random = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=key))
        count = len(self.space.names)
        mean = random.uniform(0.0, 1.0, count)
        bounds = np.tile([0.0, 1.0], (count, 1))
        seed = int(random.integers(_LARGEST_SEED))
        # None: 4 + floor(3 ln n) (eq. 48)
        common = {"sigma": self.deviation, "seed": seed, "population_size": self.population}
        steps = np.array([1.0 / dimension.count if dimension.count else 0.0 for dimension in self.space.ranges])
        if not steps.any():
            return cmaes.CMA(mean=mean, bounds=bounds, **common)
        # CMA-ES with margin keeps trying the values beside the best one, also where the step has become far smaller
        # than theirs (Hamano, Saito, Nomura & Shirakawa 2022).
        bounds += 0.5 * np.column_stack((steps, -steps))
        return cmaes.CMAwM(mean=np.clip(mean, *bounds.T), bounds=bounds, steps=steps, **common)

    def _tell(self, replay: _Replay, generation: Generation) -> None:
        asked = replay.drawn[-1]
        if len(generation.scores) != len(asked):
            msg = (
                f"generation {len(replay.told)} has {len(generation.scores)} scores, {len(asked)} candidates were asked"
            )
            raise ValueError(msg)
        scores = generation.ranked()
        known = np.isfinite(scores)
        scores = np.where(known, scores, scores[known].min() if known.any() else 0.0)
        # The best half moves mean, step and covariance (eq. 41 to 47, in the library); it looks for the least.
        with np.errstate(all="ignore"):  # what is not finite then is looked for behind
            replay.optimiser.tell([(values, -float(score)) for values, score in zip(asked, scores, strict=True)])
        replay.told.append(generation)


def _is_done(optimiser: cmaes.CMA | cmaes.CMAwM) -> bool:
    """Return whether the library sees nothing left to find, or its numbers are not finite."""
    inner, widths = (optimiser._cma, optimiser._A) if isinstance(optimiser, cmaes.CMAwM) else (optimiser, ())  # noqa: SLF001
    state = [*inner.mean, *inner._C.ravel(), inner._sigma, *widths]  # noqa: SLF001
    if not np.isfinite(state).all():
        return True
    with np.errstate(all="ignore"):  # an axis may be 0 wide
        return bool(optimiser.should_stop())
