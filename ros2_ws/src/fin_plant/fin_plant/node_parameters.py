"""Parameters of a node from a table: declared with descriptors, changed together or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from fin_plant.checks import describe_range
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
_NUMBER_LIKE = (RosParameter.Type.INTEGER, RosParameter.Type.STRING)
# Declared by rclpy itself on every node.
_OWN_BY_RCLPY = ("use_sim_time", "qos_overrides.", "start_type_description_service")


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return the descriptor that `ros2 param describe` shows."""
    result = ParameterDescriptor(
        description=f"{parameter.description} [{parameter.unit or '-'}]",
        additional_constraints=", ".join(parameter.choices) or parameter.reason,
        read_only=parameter.read_only,
        # rclpy takes an empty array for one of bytes and would refuse doubles ever after; the table checks the type.
        dynamic_typing=parameter.kind.endswith("_array"),
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
    return result


def create_node(name: str) -> Node:
    """Return a node in the fish's namespace, unless the command line asks for another.

    It lets unknown parameters through to `NodeParameters`, which refuses them by name; rclpy's own refusal names none.
    """
    return Node(name, namespace=NAMESPACE, allow_undeclared_parameters=True)


class NodeParameters:
    """A table's parameters on a node.

    Every change is checked as a whole: the values by their table, then together by ``validate``. A refused change
    leaves the last good values in force. After an accepted one ``on_change`` is called with all values.
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
        known = {name: value for name, value in overrides.items() if not name.startswith(_OWN_BY_RCLPY)}
        self._values = table.checked(known)
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

    def _convert(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Take what people type for a double: `ros2 param set` sends 2000000000 as an integer and 2.0e9 as a text."""
        return [self._as_double(parameter) for parameter in parameters]

    def _as_double(self, parameter: RosParameter) -> RosParameter:
        known = self._table.get(parameter.name)
        if known is None or known.kind != "double" or parameter.type_ not in _NUMBER_LIKE:
            return parameter
        try:
            return RosParameter(parameter.name, RosParameter.Type.DOUBLE, float(parameter.value))
        except ValueError:
            return parameter

    def _merged(self, parameters: list[RosParameter]) -> dict[str, Value]:
        changes = {p.name: p.value for p in parameters if not p.name.startswith(_OWN_BY_RCLPY)}
        for name in changes:
            if self._table.require(name).read_only:
                msg = f"{name} cannot be changed while the node runs: give it when you start the node"
                raise ValueError(msg)
        return self._table.checked({**self._values, **changes})

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            self._validate(self._merged(parameters))
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _accept(self, parameters: list[RosParameter]) -> None:
        self._values = self._merged(parameters)
        self._on_change(self.values)
