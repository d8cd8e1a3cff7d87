"""The fish without its fin: body, peduncle, motor and the water around it, as validated values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import elliprd

from fin_plant import checks
from fin_sim.motor import Motor
from fin_sim.water_settings import (
    ADDED_MASSES,
    DRAGS,
    MODELS,
    TIP_TERMS,
    WAKES,
    AddedMass,
    Drag,
    Model,
    TipTerm,
    Wake,
    settings,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

WATER_DENSITY = 1000.0
"""Fresh water, kg/m^3, as in both papers."""


def ellipsoid_added_mass_factors(length: float, width: float, height: float) -> tuple[float, float, float]:
    """Return the added-mass factors (surge, sway, yaw) of an ellipsoid with these full axes in m.

    The added masses are the factors times the displaced mass, the added inertia is the yaw factor times the moment of
    inertia of the displaced water. Lamb, *Hydrodynamics* (1932), articles 114 and 115, with the integrals in
    Carlson's symmetric form: alpha_i = 2/3 a b c R_D(others, own^2).

    Raises:
        ValueError: An axis that is not a positive length.
    """
    a, b, c = (
        0.5 * checks.number(name, value, 0.0, unit="m", exclusive_minimum=True)
        for name, value in (("length", length), ("width", width), ("height", height))
    )
    volume = 2.0 / 3.0 * a * b * c
    alpha = volume * float(elliprd(b * b, c * c, a * a))
    beta = volume * float(elliprd(c * c, a * a, b * b))
    surge = alpha / (2.0 - alpha)
    sway = beta / (2.0 - beta)
    if a == b:
        return surge, sway, 0.0
    difference, total = a * a - b * b, a * a + b * b
    yaw = difference**2 * (beta - alpha) / (total * (2.0 * difference + total * (alpha - beta)))
    return surge, sway, yaw


@dataclass(frozen=True)
class Body:
    """Rigid body of the fish in Kirchhoff's planar model.

    Attributes:
        mass: kg.
        added_surge: X, added mass forward, kg.
        added_sway: Y, added mass sideways, kg.
        inertia: J about the vertical axis through the centre of mass, kg m^2.
        added_inertia: N, kg m^2.
        drag_area: S C_D, wetted area times drag coefficient, m^2.
        lift_area: S C_L, area times slope of the lift coefficient, m^2/rad.
        yaw_drag: K_D, yaw damping moment over r |r|, N m s^2.
        tail_offset: c, from the centre of mass back to the first joint, m.
        linear_drag: Drag over speed where it is viscous, N s/m; beside the quadratic one of the drag area.

    Raises:
        ValueError: A value that is not finite, negative, or a mass or inertia of zero.
    """

    mass: float
    added_surge: float
    added_sway: float
    inertia: float
    added_inertia: float
    drag_area: float
    lift_area: float
    yaw_drag: float
    tail_offset: float
    linear_drag: float = 0.0

    def __post_init__(self) -> None:
        for item in fields(self):
            positive = item.name in {"mass", "inertia"}
            value = checks.number(f"body.{item.name}", getattr(self, item.name), 0.0, exclusive_minimum=positive)
            object.__setattr__(self, item.name, value)

    @classmethod
    def ellipsoid(
        cls,
        length: float,
        width: float,
        height: float,
        *,
        drag_area: float,
        lift_area: float,
        yaw_drag: float,
        tail_offset: float | None = None,
        density: float = WATER_DENSITY,
    ) -> Body:
        """Return a neutrally buoyant ellipsoid with full axes in m; the tail joins at its end unless given.

        Raises:
            ValueError: As for the class.
        """
        surge, sway, yaw = ellipsoid_added_mass_factors(length, width, height)
        mass = density * math.pi / 6.0 * length * width * height
        inertia = mass * (length**2 + width**2) / 20.0
        return cls(
            mass=mass,
            added_surge=surge * mass,
            added_sway=sway * mass,
            inertia=inertia,
            added_inertia=yaw * inertia,
            drag_area=drag_area,
            lift_area=lift_area,
            yaw_drag=yaw_drag,
            tail_offset=0.5 * length if tail_offset is None else tail_offset,
        )


@dataclass(frozen=True)
class Link:
    """One rigid link of the tail; its joint sits at its front end.

    Attributes:
        length: m.
        root_height: Height at the joint, m.
        tip_height: Height at the rear end, m; linear in between.
        mass_per_area: Solid mass over side area, kg/m^2.
        stiffness: K of its joint, N m/rad; without meaning for a driven joint.
        damping: D of its joint, N m s/rad.
        profile: Further points of its height between the ends: distance behind the joint and height, m, in order.

    Raises:
        ValueError: A value that is not finite or negative, a length of zero, no height at all, or a profile whose
            points are not in order between the ends.
    """

    length: float
    root_height: float
    tip_height: float
    mass_per_area: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    profile: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for item in fields(self)[:-1]:
            positive = item.name == "length"
            value = checks.number(f"link {item.name}", getattr(self, item.name), 0.0, exclusive_minimum=positive)
            object.__setattr__(self, item.name, value)
        if self.root_height + self.tip_height <= 0.0:
            msg = "link root_height and tip_height are both 0: give at least one end a height above 0 m"
            raise ValueError(msg)
        for distance, height in self.profile:
            checks.number("link profile distance", distance, 0.0, self.length, unit="m")
            checks.number("link profile height", height, 0.0, unit="m")
        if any(after[0] <= before[0] for before, after in pairwise(self.stations)):
            msg = f"link profile = {self.profile} must lie in order between 0 and {self.length:g} m"
            raise ValueError(msg)

    @property
    def stations(self) -> tuple[tuple[float, float], ...]:
        """Distance behind the joint and height, m, of both ends and of the profile's points between them."""
        return ((0.0, self.root_height), *self.profile, (self.length, self.tip_height))

    @property
    def area(self) -> float:
        """Side area in m^2."""
        return sum(0.5 * (d + e) * (b - a) for (a, d), (b, e) in pairwise(self.stations))


@dataclass(frozen=True)
class Water:
    """The water.

    Attributes:
        density: rho, kg/m^3.
        normal_drag: C_N, coefficient of the resistive force normal to a link.
        oscillating_drag: a in C = a KC^(-1/3) of a tail that beats, 0 for the same coefficient at any amplitude; see
            `oscillating_drag`.
        current_x: Velocity of the steady, uniform stream in the tank frame, m/s.
        current_y: The same to the left, m/s.
        model: Where the kinetic energy of the water comes from, see `water_settings`.
        wake: Whether the trailing edge sheds Lighthill's wake.
        drag: Whether the water resists: without, every coefficient of drag, lift and damping counts as 0.
        tip_term: In three dimensions, virtual mass per length that sheds the wake: the strip's at the trailing edge,
            or scaled by what is left of the last link's.
        added_mass: In three dimensions, of each link by itself, or a matrix of the body and all links.
        gap: In the plane, between the links of the tail and between body and tail, m; 0 where no water passes.

    Raises:
        ValueError: A value that is not finite or out of range, or an unknown name.
    """

    density: float = WATER_DENSITY
    normal_drag: float = 1.0
    oscillating_drag: float = 0.0
    current_x: float = 0.0
    current_y: float = 0.0
    model: Model = "strip"
    wake: Wake = "lighthill"
    drag: Drag = "on"
    tip_term: TipTerm = "strip"
    added_mass: AddedMass = "links"
    gap: float = 0.0

    def __post_init__(self) -> None:
        words = {"model": MODELS, "wake": WAKES, "drag": DRAGS, "tip_term": TIP_TERMS, "added_mass": ADDED_MASSES}
        for name, names in words.items():
            checks.choice(f"water.{name}", getattr(self, name), names)
        checks.number("water.density", self.density, 0.0, unit="kg/m^3", exclusive_minimum=True)
        checks.number("water.normal_drag", self.normal_drag, 0.0)
        checks.number("water.oscillating_drag", self.oscillating_drag, 0.0)
        checks.number("ideal_2d.gap", self.gap, 0.0, unit="m")
        for name in ("current_x", "current_y"):
            checks.number(f"water.{name}", getattr(self, name), unit="m/s")

    @property
    def has_matrix(self) -> bool:
        """Whether the water that one link moves moves the others."""
        return self.model == "surface_3d" and self.added_mass == "matrix"

    @property
    def resists(self) -> bool:
        """Whether drag, lift, yaw damping and the resistive force act."""
        return self.drag == "on"

    @property
    def flows(self) -> bool:
        """Whether there is a current."""
        return self.current_x != 0.0 or self.current_y != 0.0

    def over_ground(
        self, surge: NDArray[np.float64], sway: NDArray[np.float64], heading: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a velocity through the water as one over ground, both in body axes, m/s; all of one shape."""
        if not self.flows:
            return surge, sway
        sine, cosine = np.sin(heading), np.cos(heading)
        return (
            surge + self.current_x * cosine + self.current_y * sine,
            sway + self.current_y * cosine - self.current_x * sine,
        )


@dataclass(frozen=True)
class Fish:
    """A fish as the laboratory keeps it between fins.

    Attributes:
        body: Its rigid body.
        water: What it swims in.
        peduncle: Driven links between the body and the fin; empty for a fin that sits on the servo's joint.
        motor: What drives each servo; without one its angle is prescribed, whatever torque that takes.
        axes: Full length, width and height of the ellipsoid that stands for the body, m; none where nobody gave them.
    """

    body: Body
    water: Water = field(default_factory=Water)
    peduncle: tuple[Link, ...] = ()
    motor: Motor | None = None
    axes: tuple[float, float, float] | None = None

    @property
    def driven_joints(self) -> int:
        """Number of servos: one for each peduncle link and one at the fin's root."""
        return len(self.peduncle) + 1

    @classmethod
    def from_parameters(cls, values: Mapping[str, object]) -> Fish:
        """Build the fish from the simulator's parameters ``body.*``, ``water.*`` and ``peduncle.*``, and its motor.

        An added mass below 0 stands for the ellipsoid's own.

        Raises:
            ValueError: A value that is refused.
        """
        own = {name: value for name, value in values.items() if not isinstance(value, str)}
        axes = [float(own[f"body.{axis}"]) for axis in ("length", "width", "height")]  # type: ignore[arg-type]
        coefficients = {
            name: float(own[f"body.{name}"])  # type: ignore[arg-type]
            for name in ("drag_area", "lift_area", "yaw_drag", "tail_offset")
        }
        density = float(own["water.density"])  # type: ignore[arg-type]
        body = Body.ellipsoid(*axes, density=density, **coefficients)
        given = {item.name: own.get(f"body.{item.name}") for item in fields(Body) if item.name not in coefficients}
        chosen = {name: float(value) for name, value in given.items() if value is not None and float(value) >= 0.0}  # type: ignore[arg-type]
        body = Body(**{**{item.name: getattr(body, item.name) for item in fields(Body)}, **chosen})
        water = _water(values)
        return cls(
            body,
            water,
            _peduncle(values),
            Motor.from_parameters(values),
            (axes[0], axes[1], axes[2]),
        )


def _water(values: Mapping[str, object]) -> Water:
    """Return the water of the parameters ``water.*``.

    Raises:
        ValueError: A value that is refused.
    """
    own: dict[str, Any] = {
        item.name: values["ideal_2d.gap" if item.name == "gap" else f"water.{item.name}"] for item in fields(Water)
    }
    chosen = settings(str(values["water.preset"]), own["model"], own["wake"], own["drag"])
    return Water(**{**own, **chosen._asdict()})


def _peduncle(values: Mapping[str, object]) -> tuple[Link, ...]:
    """Return the links of the arrays ``peduncle.*``, one entry a link.

    Raises:
        ValueError: Arrays of different lengths, or a value that is refused.
    """
    names = ("length", "root_height", "tip_height", "mass_per_area")
    columns = {name: list(values.get(f"peduncle.{name}", ())) for name in names}  # type: ignore[call-overload]
    sizes = {f"peduncle.{name}": len(column) for name, column in columns.items()}
    if len(set(sizes.values())) > 1:
        shown = ", ".join(f"{name} {size}" for name, size in sizes.items())
        msg = f"the peduncle's arrays have different numbers of entries ({shown}): give one entry a link in each"
        raise ValueError(msg)
    return tuple(Link(*row) for row in zip(*columns.values(), strict=True))
