"""Parameters of a node from a table: declared with descriptors, changed together or not at all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from fin_plant.checks import describe_range, read_number
from fin_plant.topics import NAMESPACE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from fin_plant.parameters import Parameter, ParameterTable, Value

_TYPES = {
    "double": RosParameter.Type.DOUBLE,
    "integer": RosParameter.Type.INTEGER,
    "bool": RosParameter.Type.BOOL,
    "string": RosParameter.Type.STRING,
    "double_array": RosParameter.Type.DOUBLE_ARRAY,
    "string_array": RosParameter.Type.STRING_ARRAY,
}
_NUMBERS = {"double": float, "integer": int}
_LISTS = {"double_array": "double", "string_array": "string"}
_DECIDES_NO_SWIM = "may differ within a study"
"""Ends the description of a plant's parameter that decides no swim, for readers and for `decides_swim`."""
# Declared by rclpy itself on every node.
_OWN_BY_RCLPY = ("use_sim_time", "qos_overrides.", "start_type_description_service")


def as_typed(kind: str, value: object) -> object:
    """Return a number in its parameter's type, as far as that is what it says.

    `ros2 param set` sends 2000000000 as an integer, 2.0e9, which YAML 1.1 takes for a text, as a text, and `[]` as an
    empty list of bytes. A file's `[]`, which `ros2 param dump` writes for every empty list, comes as None: a value
    without type.
    """
    if kind in _LISTS:
        items = [] if value is None else value
        if isinstance(items, str) or not isinstance(items, Iterable):
            return items
        return [as_typed(_LISTS[kind], item) for item in items]
    if kind not in _NUMBERS or isinstance(value, bool) or not isinstance(value, int | float | str):
        return value
    try:
        number = read_number(value) if isinstance(value, str) else float(value)
    except ValueError:
        return value
    if kind == "double":
        return number
    return int(number) if not isinstance(value, int) and number.is_integer() else value


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return the descriptor that `ros2 param describe` shows."""
    result = ParameterDescriptor(
        description=f"{parameter.description} [{parameter.unit or '-'}]",
        additional_constraints=", ".join(parameter.choices) or parameter.reason,
        read_only=parameter.read_only,
        # The table checks the type: rclpy's refusal names no parameter, and it takes an empty array for bytes.
        dynamic_typing=True,
    )
    bounded = parameter.minimum > -float("inf") and parameter.maximum < float("inf")
    if bounded and parameter.kind == "double":
        limits = FloatingPointRange(from_value=parameter.minimum, to_value=parameter.maximum)
        result.floating_point_range = [limits]
    elif bounded and parameter.kind == "integer":
        limits = IntegerRange(from_value=int(parameter.minimum), to_value=int(parameter.maximum), step=1)
        result.integer_range = [limits]
    if parameter.kind == "double" and bounded:
        result.description += f", {describe_range(parameter.minimum, parameter.maximum)}"
    if not parameter.decides_swim:
        result.description += f"; {_DECIDES_NO_SWIM}"
    return result


def decides_swim(name: str, description: str) -> bool:
    """Whether a plant's parameter is one of the fish: with another value of it the same fin swims otherwise.

    Args:
        name: Of the parameter; the fin's own are no part of the fish.
        description: From its descriptor.
    """
    return not name.startswith((*_OWN_BY_RCLPY, "fin.")) and not description.endswith(_DECIDES_NO_SWIM)


def create_node(name: str) -> Node:
    """Return a node in the fish's namespace, unless the command line asks for another.

    It lets unknown parameters through to `NodeParameters`, which refuses them by name; rclpy's own refusal names none.
    """
    return Node(name, namespace=NAMESPACE, allow_undeclared_parameters=True)


class NodeParameters:
    """A table's parameters on a node.

    Every change is checked as a whole: the values by their table, then together by ``validate``. A refused change
    leaves the last good values in force. After an accepted one ``on_change`` is called with all values.

    Lists that belong together may be set one after the other. While they differ in length, what was in force of them
    before stays in force, and `awaited` says what is missing.
    """

    def __init__(
        self,
        node: Node,
        table: ParameterTable,
        *,
        validate: Callable[[Mapping[str, Value]], object] = lambda _: None,
        on_change: Callable[[Mapping[str, Value]], None] = lambda _: None,
    ) -> None:
        """Declare the table on the node; a value given at the start takes the place of the default.

        Raises:
            ValueError: A start value that is unknown or refused.
        """
        self._table = table
        self._validate = validate
        self._on_change = on_change
        overrides = {name: parameter.value for name, parameter in node._parameter_overrides.items()}  # noqa: SLF001
        given = {
            name: as_typed(table.require(name).kind, value)
            for name, value in overrides.items()
            if not name.startswith(_OWN_BY_RCLPY)
        }
        self._values = self._set = table.checked(given)
        if self.awaited:
            raise ValueError(self.awaited)
        validate(self._values)
        for name, value in self._values.items():
            entry = RosParameter(name, _TYPES[table[name].kind], value)
            node.declare_parameter(name, entry.value, descriptor(table[name]), ignore_override=True)
        node.add_pre_set_parameters_callback(self._convert)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._accept)

    @property
    def values(self) -> dict[str, Value]:
        """The values in force, by name."""
        return dict(self._values)

    @property
    def awaited(self) -> str:
        """What must still be set before lists that belong together are in force as they were set; empty for nothing."""
        return "; ".join(dict.fromkeys(self._table.lists_apart(self._set).values()))

    def refuse_incomplete(self) -> None:
        """Refuse a start while lists are set by half.

        Raises:
            ValueError: They are; the message says which.
        """
        if self.awaited:
            msg = f"{self.awaited}: set the rest first, or set them back"
            raise ValueError(msg)

    def _convert(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Store each value in its parameter's own type, however it was typed; what is refused is left to `_check`."""
        return [self._converted(p) if p.name in self._table and p.value is not None else p for p in parameters]

    def _converted(self, parameter: RosParameter) -> RosParameter:
        entry = self._table[parameter.name]
        try:
            return RosParameter(parameter.name, _TYPES[entry.kind], entry.check(as_typed(entry.kind, parameter.value)))
        except ValueError:
            return parameter

    def _merged(self, parameters: list[RosParameter]) -> dict[str, Value]:
        changes = {p.name: p.value for p in parameters if not p.name.startswith(_OWN_BY_RCLPY)}
        for name in changes:
            if self._table.require(name).read_only:
                msg = f"{name} cannot be changed while the node runs: give it when you start the node"
                raise ValueError(msg)
        return self._table.checked({**self._set, **changes})

    def _in_force(self, values: dict[str, Value]) -> dict[str, Value]:
        """Return the values of which lists that differ in length stay as they are."""
        return {**values, **{name: self._values[name] for name in self._table.lists_apart(values)}}

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            self._validate(self._in_force(self._merged(parameters)))
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accept(self, parameters: list[RosParameter]) -> None:
        self._set = self._merged(parameters)
        self._values = self._in_force(self._set)
        self._on_change(self.values)
