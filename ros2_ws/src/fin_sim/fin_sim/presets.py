"""The papers' fish as parameter files under ``config``, read for use in Python; each number has its reason there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, cast

from fin_plant import checks, yaml_file
from fin_plant.fin import Fin, node_table
from fin_plant.paths import config_folder
from fin_sim.fish import Fish

if TYPE_CHECKING:
    from fin_sim.chain import Reactive

PRESETS = ("clark2012_model", "clark2012_simulation", "clark2012_fish", "raja_mohamed", "three_segments")


@dataclass(frozen=True)
class Preset:
    """A fish with its fin.

    Attributes:
        fin: The fin.
        fish: The fish.
        reactive: Form of Lighthill's force, see `Chain`.
    """

    fin: Fin
    fish: Fish
    reactive: Reactive


@cache
def preset(name: str) -> Preset:
    """Return the fish and the fin of a file of ``fin_sim/config``; what it does not name is the simulator's default.

    Raises:
        ValueError: An unknown name, or a value in the file that is refused.
    """
    path = config_folder("fin_sim") / f"{checks.choice('preset', name, PRESETS)}.yaml"
    content = cast("dict[str, dict[str, dict[str, object]]]", yaml_file.read(path))
    values = node_table("fin_sim", "simulator").checked(content["/**"]["ros__parameters"])
    fin = Fin.from_parameters(values)
    return Preset(fin, Fish.from_parameters(values), cast("Reactive", values["reactive"]))
