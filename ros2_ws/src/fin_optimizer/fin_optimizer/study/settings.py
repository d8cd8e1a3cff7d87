"""What must not change while a study goes on, and the text of ``study.json`` that holds it, with its check sum."""

from __future__ import annotations

import json
import re
import uuid
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, cast

from fin_optimizer.checksums import CHECK_SUM, check_sum
from fin_optimizer.gait_parameters import gait_from_parameters
from fin_optimizer.goals import BETWEEN_CONSTRAINTS, OF_OBJECTIVE, Goals
from fin_optimizer.search.names import HEIGHTS, height_place
from fin_optimizer.search.rules import Rules
from fin_optimizer.search.space import Choice, Space, dimension_from, written
from fin_optimizer.study.journal import StudyError
from fin_plant import checks, json_file
from fin_plant.fin import AREA, node_table, scaled_to_area

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_optimizer.search.space import AnyDimension
    from fin_plant.parameters import Parameter, Value

FORMAT = 3
"""1 was before spaces came from files, 2 before goals had names; what needs neither is still written so that older
versions read it."""
CONSTRAINTS = "constraints"
_CONTENT = ("format", "space", "policy", "objective", "details")
"""Entries of the settings file, beside those that tell this study from others and that it was not changed."""
_ADDED = frozenset({AREA, "measurement.largest_speed", "measurement.largest_start_speed"})
"""Settings that studies of older versions lack."""
_SETTINGS_SUM = re.compile(rf',\n  "{CHECK_SUM}": "([0-9a-f]+)"\n}}\n\Z')


@dataclass(frozen=True)
class Policy:
    """How often a candidate is swum.

    Attributes:
        repeats: Swims with a score that a candidate needs; its score is their mean.
        attempts: FAILED trials after which a candidate is given up and the study goes on; INTERRUPTED ones don't count.
    """

    repeats: int = 1
    attempts: int = 2

    def __post_init__(self) -> None:
        checks.whole_number("repeats", self.repeats, 1)
        checks.whole_number("attempts", self.attempts, 1)


@dataclass(frozen=True)
class Settings:
    """What must not change while a study goes on.

    Attributes:
        space: What is searched.
        policy: How often a candidate is swum.
        details: All else that decides the candidates and their scores, by name: search, seed, gait, window.
        goals: What is looked for.
        rules: What follows from a candidate of a space from a file; None for one of the short form.
    """

    space: Space
    policy: Policy = field(default_factory=Policy)
    details: Mapping[str, object] = field(default_factory=dict)
    goals: Goals = field(default_factory=Goals)
    rules: Rules | None = None

    def flat(self) -> dict[str, object]:
        """Return every setting by a name that a reader knows."""
        searched = dict(_in_words(dimension) for dimension in self.space.dimensions)
        rules = {} if self.rules is None else self.rules.flat()
        said = BETWEEN_CONSTRAINTS.join(self._constraints)
        goals = {"objective": self.goals.objective, **({CONSTRAINTS: said} if said else {})}
        return {**searched, **rules, **asdict(self.policy), **goals, **self.details}

    @property
    def _constraints(self) -> list[str]:
        return [constraint.text for constraint in self.goals.constraints]

    @property
    def _format(self) -> int:
        if self._constraints or self.goals.objective not in OF_OBJECTIVE:
            return FORMAT
        return 1 if self.rules is None else 2

    def differences(self, other: Settings) -> list[str]:
        """Return a text for each setting that differs, its value here first; an older version may leave some out."""
        own = self.flat()
        return differing(own, {n: value for n, value in other.flat().items() if n in own or n not in _ADDED})

    def left_out(self, other: Settings) -> list[str]:
        """Return the details of ``other`` that this older version does not tell and that could have been any."""
        return [name for name in other.details if name not in self.details and name not in earlier()]

    def sent(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a plant is sent for a candidate, its fin and, of a space from a file, its gait."""
        if self.rules is None:
            return self.fin_of(values)
        return self.rules.sent(sent_parameters(self.details), values)

    def told(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return what is searched and what is sent, by name, each fact once."""
        told = {**self.sent(values), **values}
        heights = any(height_place(name) is not None for name in values)
        if heights and self.rules is not None and all(tie.by != "heights" for tie in self.rules.ties):
            del told[HEIGHTS]
        return told

    def fin_of(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the fin of a candidate as a plant's parameters, as far as the settings tell it.

        Where the length varies the area stays, so a longer fin is less high. A study of an older version does not tell
        the area; then the heights are left out.
        """
        if self.rules is not None:
            return {name: value for name, value in self.sent(values).items() if name.startswith("fin.")}
        fin: dict[str, Any] = {n: v for n, v in self.details.items() if n.startswith("fin.") and n != AREA}
        fin |= values
        if "fin.length" not in values:
            return fin
        if AREA in self.details:
            return scaled_to_area(fin, cast("float", self.details[AREA]))
        return {name: value for name, value in fin.items() if "height" not in name}

    def to_json(self) -> str:
        """Return the text of ``study.json``, which is another one for each study."""
        content = {
            "format": self._format,
            "space": [written(dimension) for dimension in self.space.dimensions],
            "policy": asdict(self.policy),
            "objective": self.goals.objective,
            **({CONSTRAINTS: self._constraints} if self._constraints else {}),
            "details": dict(self.details),
            **({} if self.rules is None else {"rules": self.rules.written()}),
            "id": uuid.uuid4().hex,
        }
        body = json.dumps(content, indent=2, allow_nan=False).removesuffix("\n}")
        return f'{body},\n  "{CHECK_SUM}": "{check_sum(body.encode())}"\n}}\n'

    @classmethod
    def from_json(cls, text: str) -> Settings:
        """Read the text of ``study.json``.

        Raises:
            StudyError: It was written by a newer version, is not a study's, or was changed since.
        """
        try:
            content = cast("Any", json_file.parse(text))
            _check_format(content["format"])
            _check_unchanged(text, content)
            space = Space(tuple(map(dimension_from, content["space"])))
            details = content["details"]
            goals = Goals.of_objective(content["objective"], content.get(CONSTRAINTS, ()))
            rules = _rules(content["rules"], details) if "rules" in content else None
            return cls(space, Policy(**content["policy"]), details, goals, rules)
        except StudyError:
            raise
        except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
            msg = f"it is no study's settings ({type(error).__name__}: {error}); restore it or begin another folder"
            raise StudyError(msg) from error


def sent_parameters(details: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of a study's settings that are parameters of the fin or of the gait."""
    return {name: value for name, value in details.items() if name.startswith(("fin.", "gait.")) and name != AREA}


def _rules(content: Mapping[str, Any], details: Mapping[str, Any]) -> Rules:
    return Rules.from_written(content, len(details[HEIGHTS]), len(gait_from_parameters(details).joints))


def _in_words(dimension: AnyDimension) -> tuple[str, str]:
    """Return how a parameter is searched, as a name and its value."""
    if isinstance(dimension, Choice):
        return f"choices of {dimension.name}", f"{', '.join(map(str, dimension.choices))} {dimension.unit}".rstrip()
    said = f"[{dimension.minimum!r}, {dimension.maximum!r}] {dimension.unit}"
    kinds = {
        "in the logarithm": dimension.log,
        "whole": dimension.whole,
        f"in steps of {dimension.step!r}": dimension.step and not (dimension.whole and dimension.step == 1.0),
    }
    return f"range of {dimension.name}", ", ".join([said, *(kind for kind, holds in kinds.items() if holds)])


def _tables() -> dict[str, Parameter]:
    return {**node_table("fin_sim", "simulator"), **node_table("fin_optimizer", "optimizer")}


@cache
def earlier() -> dict[str, Value]:
    """Return what fins, fish and gaits had for parameters that came later or have another default since."""
    table = _tables()
    return {name: entry.earlier for name, entry in table.items() if entry.earlier is not None}


def begun_by_default(there: Mapping[str, object]) -> dict[str, Value]:
    """Return what a study has, by its settings or its fish, that was the default when it was begun and is not now."""
    table = _tables()
    return {n: value for n, value in earlier().items() if there.get(n) == value != table[n].default}


def differing(there: Mapping[str, object], here: Mapping[str, object]) -> list[str]:
    """Return a text for each value that differs: ``there`` in the study, and ``here``.

    A parameter that the study's version did not have yet is there what it was for all fish then.
    """
    there = {**{name: value for name, value in earlier().items() if name in here}, **there}
    return [
        f"{name} is {there.get(name, 'not set')!s} there and {here.get(name, 'not set')!s} here"
        for name in {**there, **here}
        if there.get(name) != here.get(name)
    ]


def _check_format(version: int) -> None:
    if version > FORMAT:
        msg = f"its format {version} is newer than the {FORMAT} that this version knows: update fin_optimizer"
        raise StudyError(msg)


def _check_unchanged(text: str, content: Mapping[str, object]) -> None:
    """Compare the settings file with its check sum, which one of an older version does not have.

    Raises:
        StudyError: It was changed after it was written.
    """
    found = _SETTINGS_SUM.search(text)
    if found is not None and found[1] == check_sum(text[: found.start()].encode()):
        return
    if found is not None or content.keys() != set(_CONTENT):
        msg = "it was changed after it was written, its check sum does not fit: restore it from a copy"
        raise StudyError(msg)
