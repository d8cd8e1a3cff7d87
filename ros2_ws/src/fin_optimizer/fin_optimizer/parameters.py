"""The parameters of the optimiser as their table has them, and names that it knows of the plants."""

from __future__ import annotations

import re

from fin_plant.fin import node_table

OPTIMIZER = "optimizer"
OPTIMIZER_PARAMETERS = node_table("fin_optimizer", OPTIMIZER)
"""The optimiser's own parameters and the fin that its search starts from."""
SIMULATOR = "simulator"
NAMESPACE_PATTERN = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
