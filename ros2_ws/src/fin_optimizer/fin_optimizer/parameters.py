"""The parameters of the optimiser and of the plants that it speaks to, as their tables have them."""

from __future__ import annotations

import re

from fin_plant.fin import FIN_PARAMETERS, PLANT_PARAMETERS, node_table
from fin_plant.parameters import ParameterTable, load_table

OPTIMIZER = "optimizer"


OPTIMIZER_PARAMETERS = node_table("fin_optimizer", OPTIMIZER)
"""The optimiser's own parameters and the fin that its search starts from."""


SIMULATOR = "simulator"


PLANT_LIMITS = ParameterTable({n: p for n, p in PLANT_PARAMETERS.items() if n not in FIN_PARAMETERS})
"""What every plant has besides the fin."""


NAMESPACE_PATTERN = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


SIMULATOR_PARAMETERS = ParameterTable({**load_table("fin_sim", "simulator_parameters.yaml"), **PLANT_LIMITS})
"""The simulator's own parameters, the fin excepted: that is the optimiser's to choose."""
