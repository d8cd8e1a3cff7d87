"""Parameter tables: one YAML file says type, unit, default, range and meaning of every parameter.

The same table checks a value given in Python, declares the parameter on a node (`node_parameters`) and fills the
tables of the documentation, so a number lives in one place.
"""

from __future__ import annotations

import difflib
import importlib.util
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from fin_plant import checks, yaml_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

Value = float | int | bool | str | list[float] | list[str]
Kind = Literal["double", "integer", "bool", "string", "double_array", "string_array"]
_KINDS: tuple[Kind, ...] = ("double", "integer", "bool", "string", "double_array", "string_array")
_NEEDED = {"type", "default", "description"}
_FIELDS = _NEEDED | {"unit", "range", "choices", "one_for_each", "reason", "read_only", "decides_swim", "earlier"}


@dataclass(frozen=True)
class Parameter:
    """One parameter: what it means and which values it takes.

    Attributes:
        one_for_each: Name of the list of which each entry has one here; empty for a value that stands for itself.
        decides_swim: Whether a fish with another value swims otherwise, of a plant's parameter.
        earlier: Value that all fish had before there was this parameter, or its default before today's, with which a
            study of that time goes on; None for those that are as the first version had them.
    """

    name: str
    kind: Kind
    default: Value
    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    one_for_each: str = ""
    reason: str = ""
    read_only: bool = False
    decides_swim: bool = True
    earlier: Value | None = None

    @property
    def allowed(self) -> str:
        """The values that it takes, without their unit, as a reader would write them."""
        if self.choices:
            return ", ".join(self.choices)
        if self.kind in {"double", "integer", "double_array"}:
            return checks.describe_range(self.minimum, self.maximum)
        return {"bool": "true, false", "string": "text", "string_array": "texts"}[self.kind]

    @property
    def shown_default(self) -> str:
        """The default as a reader would write it."""
        if isinstance(self.default, bool):
            return str(self.default).lower()
        return f"{self.default:g}" if isinstance(self.default, float) else str(self.default) or "(empty)"

    def check(self, value: object) -> Value:
        """Return the value in the parameter's own type.

        Raises:
            ValueError: Wrong type, not finite, out of range or not one of the choices.
        """
        checkers: dict[Kind, Callable[[object], Value]] = {
            "double": self._number,
            "integer": self._whole_number,
            "bool": self._truth,
            "string": self._text,
            "double_array": lambda items: [self._number(item) for item in self._items(items)],
            "string_array": lambda items: [self._text(str(item)) for item in self._items(items)],
        }
        return checkers[self.kind](value)

    def _number(self, value: object) -> float:
        return checks.number(self.name, value, self.minimum, self.maximum, unit=self.unit)  # type: ignore[arg-type]

    def _whole_number(self, value: object) -> int:
        lower = -(2**63) if math.isinf(self.minimum) else int(self.minimum)
        upper = None if math.isinf(self.maximum) else int(self.maximum)
        return checks.whole_number(self.name, value, lower, upper)

    def _truth(self, value: object) -> bool:
        if not isinstance(value, bool):
            msg = f"{self.name} = {value!r} must be true or false"
            raise ValueError(msg)
        return value

    def _text(self, value: object) -> str:
        if self.choices:
            return checks.choice(self.name, value, self.choices)
        if not isinstance(value, str):
            msg = f"{self.name} = {value!r} must be a text"
            raise ValueError(msg)
        return value

    def _items(self, value: object) -> list[object]:
        if isinstance(value, str) or not hasattr(value, "__iter__"):
            msg = f"{self.name} = {value!r} must be a list"
            raise ValueError(msg)
        return list(value)


class ParameterTable(dict[str, Parameter]):
    """Parameters by full name, in the order of their file."""

    def checked(self, values: Mapping[str, object]) -> dict[str, Value]:
        """Return a value for every parameter: the one given, checked, or the default.

        Raises:
            ValueError: An unknown name, or a value that its parameter refuses.
        """
        for name in values:
            self.require(name)
        return {name: parameter.check(values.get(name, parameter.default)) for name, parameter in self.items()}

    def require(self, name: str) -> Parameter:
        """Return the parameter of that name.

        Raises:
            ValueError: There is none; the message offers the nearest names.
        """
        if name not in self:
            near = difflib.get_close_matches(name, self, n=3)
            hint = f"did you mean {' or '.join(near)}?" if near else "`ros2 param list` shows what there is"
            msg = f"{name} is not a parameter: {hint}"
            raise ValueError(msg)
        return self[name]

    def lists_apart(self, values: Mapping[str, Value]) -> dict[str, str]:
        """Return the lists that belong together and differ in length, by name, with the lengths in words."""
        apart: dict[str, str] = {}
        for first in dict.fromkeys(parameter.one_for_each for parameter in self.values() if parameter.one_for_each):
            names = [first, *(name for name, parameter in self.items() if parameter.one_for_each == first)]
            counts = {name: len(cast("list[object]", values[name])) for name in names}
            if len(set(counts.values())) > 1:
                shown = ", ".join(f"{name} {count}" for name, count in counts.items())
                apart |= dict.fromkeys(names, f"lists that need as many entries as each other: {shown}")
        return apart

    @property
    def deciding_swims(self) -> ParameterTable:
        """The parameters with another value of which a fish swims otherwise."""
        return ParameterTable({name: entry for name, entry in self.items() if entry.decides_swim})

    def group(self, prefix: str) -> ParameterTable:
        """Return the parameters whose names start with ``prefix`` and a dot."""
        return ParameterTable({name: entry for name, entry in self.items() if name.startswith(prefix + ".")})


def _parameter(source: str, name: str, entry: object) -> Parameter:
    where = f"{source}: {name}"
    if not isinstance(entry, dict) or not _NEEDED <= entry.keys() <= _FIELDS:
        msg = f"{where} needs type, default and description, and knows only {', '.join(sorted(_FIELDS))}"
        raise ValueError(msg)
    if entry["type"] not in _KINDS:
        msg = f"{where}: type {entry['type']!r} is not one of {', '.join(_KINDS)}"
        raise ValueError(msg)
    low, high = entry.get("range", (-math.inf, math.inf))
    parameter = Parameter(
        name=name,
        kind=cast("Kind", entry["type"]),
        default=entry["default"],
        description=" ".join(str(entry["description"]).split()),
        unit=entry.get("unit", ""),
        minimum=float(low),
        maximum=float(high),
        choices=tuple(entry.get("choices", ())),
        one_for_each=entry.get("one_for_each", ""),
        reason=" ".join(str(entry.get("reason", "")).split()),
        read_only=bool(entry.get("read_only", False)),
        decides_swim=bool(entry.get("decides_swim", True)),
        earlier=entry.get("earlier"),
    )
    parameter.check(parameter.default)
    if parameter.earlier is not None:
        parameter.check(parameter.earlier)
    return parameter


@cache
def load_table(package: str, file_name: str) -> ParameterTable:
    """Read the table ``file_name`` that lies inside the Python package ``package``.

    Raises:
        ValueError: An entry that is incomplete, or whose default its own range refuses.
    """
    specification = importlib.util.find_spec(package)  # finds the folder and does not run the package
    if specification is None or not specification.submodule_search_locations:
        msg = f"package {package} is not installed: build the workspace and source it"
        raise ValueError(msg)
    path = Path(specification.submodule_search_locations[0]) / file_name
    content = cast("dict[str, object]", yaml_file.read(path))
    return ParameterTable({name: _parameter(file_name, name, entry) for name, entry in content.items()})


def dotted(part: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield names with dots, and values, of parameters that a ROS file may nest."""
    for name, value in part.items():
        if isinstance(value, dict):
            yield from dotted(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
