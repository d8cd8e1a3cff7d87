"""What a study is to do, from the optimiser's parameters: where to search, what to swim, when to give up."""

from __future__ import annotations

import math
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, cast

from fin_optimizer.report import MODULUS
from fin_optimizer.score import Measurement
from fin_optimizer.search import Dimension, HillClimber, Space
from fin_optimizer.study import SETTINGS_FILE, Policy, Settings, Study
from fin_optimizer.trial import Timeouts
from fin_plant.fin import Fin
from fin_plant.gait import Gait, JointDrive, carangiform

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_plant.parameters import Value

# What decides candidates and scores, hence must not change while a study goes on.
_DECISIVE = ("seed", "search.", "gait.", "measurement.", "fin.")


class Plan:
    """What the node's parameters ask for.

    Raises:
        ValueError: A range that is upside down, or a fin that cannot be.
    """

    def __init__(self, values: Mapping[str, Value]) -> None:
        self.values = dict(values)
        prefix = "search.young_modulus"
        bounds = (self.number(f"{prefix}.minimum"), self.number(f"{prefix}.maximum"))
        self.dimension = Dimension(MODULUS, *bounds, unit="Pa")
        space = Space((self.dimension,))
        deviations = {MODULUS: math.sqrt(self.number(f"{prefix}.step_variance"))}
        self.search = HillClimber(space, self.count("seed"), deviations)
        self.fin = Fin.from_parameters(values)
        frequency = self.number("gait.frequency")
        self.gait = carangiform(self.number("gait.amplitude"), frequency)
        self.no_gait = Gait((JointDrive(0.0, frequency),))
        self.measurement = Measurement(
            self.number("measurement.settle"), self.number("measurement.duration"), block=1.0 / frequency
        )
        names = ("find", "plant", "reply", "silence", "people")
        self.timeouts = Timeouts(**{name: self.number(f"timeout.{name}") for name in names})
        details = {n: v for n, v in values.items() if n.startswith(_DECISIVE) and n not in space.names}
        self.settings = Settings(
            space, Policy(self.count("repeats"), self.count("attempts")), {"search": "hill climber", **details}
        )

    def number(self, name: str) -> float:
        """Return a parameter of type double."""
        return cast("float", self.values[name])

    def count(self, name: str) -> int:
        """Return a parameter of type integer."""
        return cast("int", self.values[name])

    def fin_of(self, values: Mapping[str, float]) -> dict[str, Value]:
        """Return the fin of a candidate as the plant's parameters; the plant itself judges whether it can be."""
        return {**self.fin.as_parameters(), **values}

    def study(self) -> Study:
        """Begin the study, or go on with it.

        Raises:
            ValueError: The folder cannot be used, or its study has other settings.
        """
        name = str(self.values["study_folder"]) or f"runs/{datetime.now().astimezone():%Y-%m-%d_%H-%M-%S}"
        folder = Path(name).absolute()
        try:
            if (folder / SETTINGS_FILE).exists():
                return Study.open(folder, self.settings)
            return Study.create(folder, self.settings)
        except OSError as error:
            msg = f"study_folder {folder} cannot be used: {error.strerror or error}; choose one that can be written"
            raise ValueError(msg) from error
