"""The simulated fish: physics of a body with a flexible caudal fin, and the plant node that swims it.

The public face for other packages: `swim` and its result `Swim`, `swim_batch` and `BatchSwim` for many at once, and
`PAPER_FISH`.
"""

from fin_sim.batch import BatchSwim, swim_batch
from fin_sim.swim import PAPER_FISH, Swim, swim

__all__ = ["PAPER_FISH", "BatchSwim", "Swim", "swim", "swim_batch"]
