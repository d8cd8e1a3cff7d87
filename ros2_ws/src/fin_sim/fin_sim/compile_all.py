"""Compile what swims most often, so that the first swim waits for nothing: python -m fin_sim.compile_all."""

from __future__ import annotations

from fin_plant.fin import Fin
from fin_sim.batch import swim_batch
from fin_sim.fish import Fish
from fin_sim.swim import SIMULATOR_PARAMETERS, swim

PRESETS = ("strip", "bht")
"""Of the water: one for each kind of kernel."""
_DURATION = 0.1


def main() -> None:
    """Swim for a moment: each kernel is compiled when it is first called, and kept."""
    for preset in PRESETS:
        swim(Fin(), Fish.from_parameters(SIMULATOR_PARAMETERS.checked({"water.preset": preset})), duration=_DURATION)
    swim_batch([Fin()], duration=_DURATION)


if __name__ == "__main__":
    main()
