"""Many swims at once: the figures of one swim for each of many fins, on all cores.

* `swim_batch`: divides the fins among threads. Most swim side by side (`lanes`). Those with too little
  damping for the lanes' long steps, and fish whose servos have a motor each swim by the general kernel of
  `fin_sim.time_stepping` (`general_kernel`).
* `columns`: fins as columns. `links`: what they are as links. `task`: what all fins share.
* `equations`, `step`, `tracing`: the equations of one fish and one step in time, recorded. `loops`, `kernel`: what was
  recorded made into code with loops over the links, whose vector registers hold a fish in each lane.
* `window`: means over the end of a swim. `result`: what comes out. `plane`: swims in a plane ideal flow.

Every figure is right to `TOLERANCES`, or its swim has none and says so. Near the paper's gait and fins (`proven`) one
step length is known to be short enough. Everywhere else a fin swims again at half the step, and at a quarter, until
the results have settled (`tolerances`); where they have not, the general kernel takes over, which halves its own step
likewise. A fin whose results never settle, such as one that whips chaotically, is `Status.NOT_CONVERGED`.
"""

from fin_sim.batch.columns import FinColumns, fins_accepted
from fin_sim.batch.result import BatchSwim, Status
from fin_sim.batch.swim_batch import swim_batch
from fin_sim.batch.task import Precision
from fin_sim.batch.tolerances import TOLERANCES

__all__ = ["TOLERANCES", "BatchSwim", "FinColumns", "Precision", "Status", "fins_accepted", "swim_batch"]
