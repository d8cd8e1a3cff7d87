"""What the options ask for: the plan of a swim, and what varies in it; and which options do not go together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from fin_sim.materials import material
from fin_sim.swim_command.axes import Axis, parse_axis
from fin_sim.swim_command.options import PLAN_OPTIONS
from fin_sim.swim_command.parameter_values import given_value, read_parameter_file
from fin_sim.swim_command.plan import PARAMETERS, SwimPlan

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable, Mapping, Sequence

    from fin_plant.parameters import Value

_OF_MATERIAL = ("fin.young_modulus", "fin.density")
_DAMPING_TIME = "fin.damping_time"  # follows from a material's loss and the frequency, where it is not given


def plan_of(options: argparse.Namespace) -> tuple[SwimPlan, list[Axis]]:
    """Return the swim that the options ask for, and what varies from one swim to the next: nothing for a single one.

    Raises:
        ValueError: A value that is refused, or options that do not go together.
    """
    plan, axes = _plan(options), [parse_axis(text) for text in options.vary]
    _check_tow_speed(plan, axes, options)
    if options.material:
        plan, axes = _with_grades(options.material, plan, axes)
    if axes and options.animate:
        msg = "--animate shows one swim: leave out --vary and --material, and give fin.young_modulus"
        raise ValueError(msg)
    if options.quick and not axes:
        msg = "--quick is for many swims: add --vary or --material, or leave it out"
        raise ValueError(msg)
    return plan, axes


def refuse_beside_file(options: argparse.Namespace, holder: str, own: tuple[str, ...]) -> None:
    """Refuse options beside a file that holds everything but its ``own`` ones.

    Raises:
        ValueError: There is one.
    """
    names = [*PARAMETERS, *PLAN_OPTIONS, "material", "shape", "params_file"]
    given = [name for name in names if name not in own and getattr(options, name) is not None]
    if given or options.vary or options.quick:
        option = (given or (["vary"] if options.vary else ["quick"]))[0].replace("params_file", "params-file")
        msg = f"--{holder} holds every parameter: leave out --{option} or edit the file"
        raise ValueError(msg)


def _plan(options: argparse.Namespace) -> SwimPlan:
    """Return the plan of parameter file and options, without what a material says."""
    values, run = read_parameter_file(options.params_file) if options.params_file else ({}, {})
    if options.quick:
        _refuse_step(options, run)
    given = {name: getattr(options, name) for name in PARAMETERS}
    values |= {name: given_value(PARAMETERS[name], text) for name, text in given.items() if text is not None}
    if options.material:
        _refuse_twice(values)
    chosen = {name: getattr(options, name) for name in PLAN_OPTIONS if getattr(options, name) is not None}
    plan = SwimPlan(values, **{**run, **chosen})
    if options.shape:
        shaped = plan.fin().shaped(options.shape)
        plan = replace(plan, values={**plan.values, **shaped.as_parameters()})
    return plan


def _with_grades(name: str, plan: SwimPlan, axes: list[Axis]) -> tuple[SwimPlan, list[Axis]]:
    """Return a plan with a material's density and loss, and its softest and stiffest grade as what varies first."""
    _refuse_twice(axis.name for axis in axes)
    cut_from = material(name)
    soft, stiff = cut_from.fins(plan.fin())
    measured = _DAMPING_TIME in plan.values or any(axis.name == _DAMPING_TIME for axis in axes)
    of_material = replace(
        plan,
        values={**plan.values, "fin.density": soft.density},
        loss_factor=None if measured else cut_from.loss_factor,
    )
    return of_material, [Axis("fin.young_modulus", (soft.young_modulus, stiff.young_modulus)), *axes]


def _refuse_twice(names: Iterable[str]) -> None:
    """Refuse what a material gives, where it is among these names too."""
    given = set(names)
    twice = [name for name in _OF_MATERIAL if name in given]
    if twice:
        msg = f"--material gives {twice[0]}: leave one of them out"
        raise ValueError(msg)


def _refuse_step(options: argparse.Namespace, run: Mapping[str, Value]) -> None:
    """Refuse a time step for quick swims, wherever it is given."""
    given = ["--step"] if options.step is not None else []
    given += [f"step in {options.params_file}"] if "step" in run else []
    if given:
        msg = f"--quick chooses its steps by itself, as short as its figures need: leave out {' and '.join(given)}"
        raise ValueError(msg)


def _check_tow_speed(plan: SwimPlan, axes: Sequence[Axis], options: argparse.Namespace) -> None:
    given = options.tow_speed is not None or any(axis.name == "tow_speed" for axis in axes)
    if given and plan.clamp != "towed":
        msg = f"tow_speed is that of a towed body, this one is {plan.clamp}: add --clamp towed or leave it out"
        raise ValueError(msg)
