"""The simulated fish: physics of a body with a flexible caudal fin, and the plant node that swims it.

The public face for other packages: `swim`, `Swim`, `PAPER_FISH`.
"""

from fin_sim.swim import PAPER_FISH, Swim, swim

__all__ = ["PAPER_FISH", "Swim", "swim"]
