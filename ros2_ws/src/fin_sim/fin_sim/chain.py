"""From fish and fin to the chain of rigid links that the kernel integrates."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
import scipy.linalg

from fin_plant import checks, validity
from fin_plant.fin import Fin, ProfiledFin
from fin_plant.gait import MAXIMUM_JOINTS
from fin_sim.fish import Body, Fish, Link, Water
from fin_sim.oscillating_drag import chain_coefficients

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_plant.gait import Gait
    from fin_sim.motor import Motor

Clamp = Literal["free", "fixed", "towed"]
Reactive = Literal["tip", "distributed"]
CLAMPS = ("free", "fixed", "towed")
REACTIVE_FORMS = ("tip", "distributed")
# One more than the joints of a gait: a fin of 20 `midpoint` segments has 21 links.
MAXIMUM_LINKS = MAXIMUM_JOINTS + 1

# Columns of the kernel's table of links. Moments are integrals over the link of density times (distance from the
# joint)^j: VIRTUAL_j of the virtual mass per length pi/4 rho d^2, SOLID_j of the solid mass per length.
# PRESCRIBED is 1 where the joint's angle is; a joint with a motor has its `Motor.constants`, which else are 0.
# After them come the pieces between the points of its profile, along each of which the height is linear: distance of
# its end behind the joint, height at its front and slope. A link of fewer pieces than another ends with columns of 0.
FIRST_PIECE = 17
(
    LENGTH,
    VIRTUAL_0,
    VIRTUAL_1,
    VIRTUAL_2,
    SOLID_0,
    SOLID_1,
    SOLID_2,
    TIP_VIRTUAL,
    STIFFNESS,
    DAMPING,
    PRESCRIBED,
    RESISTIVE,
    STALL_TORQUE,
    BACK_EMF,
    GAIN,
    RATE_GAIN,
    ROTOR,
) = range(FIRST_PIECE)
_NO_MOTOR = (0.0,) * (FIRST_PIECE - STALL_TORQUE)
PIECE_COLUMNS = 3
PIECE_END, PIECE_HEIGHT, PIECE_SLOPE = range(PIECE_COLUMNS)


# Three points integrate polynomials of degree 5 exactly; the moments' have degree 4.
_GAUSS_POINTS, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


def link_moments(link: Link, power: int) -> list[float]:
    """Return the integrals over a link of d^power s^j for j = 0, 1, 2, with d the height and s the distance."""
    total = np.zeros(3)
    for (start, low), (end, high) in pairwise(link.stations):
        half = 0.5 * (end - start)
        distance = start + half * (1.0 + _GAUSS_POINTS)
        height = low + (high - low) * 0.5 * (1.0 + _GAUSS_POINTS)
        density = half * _GAUSS_WEIGHTS * height**power
        total += np.array([density.sum(), density @ distance, density @ distance**2])
    return [float(value) for value in total]


def _pieces(link: Link) -> list[float]:
    """Return the columns of a link's pieces."""
    columns = []
    for (start, low), (end, high) in pairwise(link.stations):
        columns += [end, low, (high - low) / (end - start)]
    return columns


def convective_form(reactive: str, water: Water) -> Reactive:
    """Return the form of the convective force in this water.

    Without a wake nothing acts at the trailing edge, and what the water's kinetic energy asks for remains: in the
    distributed form each link's Munk moment, which the form at the tip does not have.

    Raises:
        ValueError: An unknown form.
    """
    checks.choice("reactive", reactive, REACTIVE_FORMS)
    return "distributed" if water.wake == "none" else cast("Reactive", reactive)


@dataclass(frozen=True)
class Chain:
    """A body with its tail in water: all that the equations of motion need.

    Attributes:
        body: The rigid body.
        links: From the head to the tail, 1 to 21.
        driven: For each link whether its joint is driven; at least one is.
        water: The water.
        reactive: Form of Lighthill's force, ``distributed`` (energy-consistent) or ``tip`` (the papers'); without a
            wake it is always ``distributed``, see `convective_form`.
        clamp: ``free`` body, ``fixed`` body, or ``towed`` forward at ``tow_speed``.
        tow_speed: m/s, for ``towed``.
        motor: What drives each driven joint; where there is none its angle is prescribed.
        axes: Full axes of the body's ellipsoid, m: the flow around it in the plane or in three dimensions needs them.
        normal_drags: C_N of each link, where a gait has decided it (`for_gait`); else the water's, of every link.

    Raises:
        ValueError: No link, too many, no driven joint, unknown names, or what its water has not.
    """

    body: Body
    links: tuple[Link, ...]
    driven: tuple[bool, ...]
    water: Water
    reactive: Reactive = "distributed"
    clamp: Clamp = "free"
    tow_speed: float = 0.0
    motor: Motor | None = None
    normal_drags: tuple[float, ...] = ()
    axes: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        checks.whole_number("number of links", len(self.links), 1, MAXIMUM_LINKS)
        object.__setattr__(self, "reactive", convective_form(self.reactive, self.water))
        if self.water.has_matrix and self.axes is None:
            msg = "water.added_mass = matrix needs the body's length, width and height: give axes, or take links"
            raise ValueError(msg)
        checks.choice("clamp", self.clamp, CLAMPS)
        checks.number("tow_speed", self.tow_speed, unit="m/s")
        if len(self.driven) != len(self.links):
            msg = f"driven names {len(self.driven)} joints, the chain has {len(self.links)} links: name every joint"
            raise ValueError(msg)
        if not any(self.driven):
            msg = "no joint is driven: a fish needs at least one driven joint to swim"
            raise ValueError(msg)
        if self.water.model == "ideal_2d":
            from fin_sim.ideal_2d.plane_fish import slice_of  # noqa: PLC0415  (strips need no plane)

            slice_of(self)

    def for_gait(self, gait: Gait) -> Chain:
        """Return the chain with the resistive coefficients of this gait; itself where they depend on none."""
        if self.water.oscillating_drag == 0.0 or len(gait.joints) != sum(self.driven):
            return self
        return replace(self, normal_drags=chain_coefficients(self.water, gait, self.links, self.driven))

    def link_table(self) -> NDArray[np.float64]:
        """Return the kernel's table, shape (links, ``FIRST_PIECE`` + 3 times the most pieces of a link)."""
        drags = self.normal_drags or (self.water.normal_drag,) * len(self.links)
        rows = [self._link_row(*link) for link in zip(self.links, self.driven, drags, strict=True)]
        table = np.zeros((len(rows), max(map(len, rows))))
        for row, values in zip(table, rows, strict=True):
            row[: len(values)] = values
        if self.water.model == "surface_3d":
            from fin_sim.surface_3d.factors import factors  # noqa: PLC0415  (strips need no table)

            kept = factors(self.links)
            table[:, VIRTUAL_0 : VIRTUAL_2 + 1] *= 0.0 if self.water.has_matrix else kept
            table[-1, TIP_VIRTUAL] *= kept[-1, 0] if self.water.tip_term == "scaled" else 1.0
        return table

    def _link_row(self, link: Link, is_driven: bool, normal_drag: float) -> list[float]:
        virtual = 0.25 * math.pi * self.water.density
        return [
            link.length,
            *(virtual * moment for moment in link_moments(link, 2)),
            *(link.mass_per_area * moment for moment in link_moments(link, 1)),
            virtual * link.tip_height**2 if self.water.wake == "lighthill" else 0.0,
            0.0 if is_driven else link.stiffness,
            0.0 if is_driven else link.damping,
            float(is_driven and self.motor is None),
            -0.5 * self.water.density * normal_drag if self.water.resists else 0.0,
            *(self.motor.constants if is_driven and self.motor else _NO_MOTOR),
            *_pieces(link),
        ]

    def added_mass(self) -> NDArray[np.float64] | None:
        """Return the matrix of added mass that takes the place of the links' virtual moments.

        The body's own added mass is left out: it stands in `body_vector`.

        Returns:
            Shape (3 + 4 N, 3 + 2 N), see `surface_3d.added_mass.link_matrix`; None where the moments count.

        Raises:
            ValueError: The tail begins inside of the body, or the matrix is not positive.
        """
        if not self.water.has_matrix or self.axes is None:
            return None
        from fin_sim.surface_3d.factors import matrix  # noqa: PLC0415  (strips need none)

        outline = tuple(replace(link, mass_per_area=0.0, stiffness=0.0, damping=0.0) for link in self.links)
        return matrix(outline, self.axes, self.body.tail_offset) * self.water.density

    def warnings(self) -> list[str]:
        """Return what is doubtful about the fin's proportions; the fin begins at the last driven joint."""
        root = sum(self.driven) - 1
        fin = self.links[root:]
        heights = [height for link in fin for _, height in link.stations]
        text = validity.short_tail(sum(link.length for link in fin), max(heights))
        return [text] if text else []

    def body_vector(self) -> NDArray[np.float64]:
        """Return the kernel's body constants, shape (11,), in the order that `dynamics` unpacks."""
        body, half_density = self.body, 0.5 * self.water.density
        if not self.water.resists:
            body = replace(body, drag_area=0.0, linear_drag=0.0, lift_area=0.0, yaw_drag=0.0)
        return np.array(
            [
                body.mass + body.added_surge,
                body.mass + body.added_sway,
                body.inertia + body.added_inertia,
                body.added_surge - body.added_sway,
                half_density * body.drag_area,
                half_density * body.lift_area,
                body.yaw_drag,
                body.tail_offset,
                body.linear_drag,
                self.water.current_x,
                self.water.current_y,
            ]
        )

    @property
    def longest_step(self) -> float:
        """Longest time step in s that resolves the servos' motors; infinite without any."""
        return self.motor.longest_step if self.motor else math.inf

    @property
    def held_velocity(self) -> tuple[float, float]:
        """Forward and sideways velocity through the water of a body that is held or towed, m/s; of a free one 0."""
        if self.clamp == "free":
            return 0.0, 0.0
        speed = self.tow_speed if self.clamp == "towed" else 0.0
        return speed - self.water.current_x, 0.0 - self.water.current_y

    def straight_mass_matrix(self) -> NDArray[np.float64]:
        """Return the mass matrix of sideways motion about the straight chain, shape (2 + links, 2 + links).

        Coordinates: sway velocity, yaw rate and the joint rates; forward motion decouples in the straight chain.
        """
        count = len(self.links)
        body = self.body_vector()
        mass = np.zeros((2 + count, 2 + count))
        mass[0, 0], mass[1, 1] = body[1], body[2]
        sideways = np.zeros(2 + count)  # velocity of the link's joint normal to the chain
        sideways[0], sideways[1] = 1.0, -self.body.tail_offset
        turning = np.zeros(2 + count)
        turning[1] = 1.0
        for index, row in enumerate(self.link_table()):
            turning[2 + index] = 1.0
            first, second, third = row[VIRTUAL_0 : VIRTUAL_2 + 1] + row[SOLID_0 : SOLID_2 + 1]
            mass += first * np.outer(sideways, sideways) + third * np.outer(turning, turning)
            mass -= second * (np.outer(sideways, turning) + np.outer(turning, sideways))
            sideways = sideways - row[LENGTH] * turning
        added = self.added_mass()
        if added is not None:
            from fin_sim.surface_3d.added_mass import straight_kinematics  # noqa: PLC0415

            moves = straight_kinematics([link.length for link in self.links], self.body.tail_offset)[:, 1:]
            mass += moves.T @ added[: added.shape[1]] @ moves
        return mass

    def _joints(self, *, driven: bool) -> list[int]:
        """Return the indices in the mass matrix of the driven joints, or of the passive ones."""
        return [2 + index for index, is_driven in enumerate(self.driven) if is_driven is driven]

    def bending_frequencies(self) -> NDArray[np.float64]:
        """Return the undamped natural frequencies in Hz of the straight tail in still water, lowest first.

        The body and the servos are held; the virtual mass of the water is included. Empty for a tail without passive
        joints.
        """
        passive = self._joints(driven=False)
        if not passive:
            return np.zeros(0)
        mass = self.straight_mass_matrix()[np.ix_(passive, passive)]
        stiffness = np.diag([link.stiffness for link, d in zip(self.links, self.driven, strict=True) if not d])
        squares = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
        return np.sqrt(np.maximum(squares, 0.0)) / (2.0 * math.pi)

    def elastic_response(self) -> tuple[NDArray[np.float64], list[int]]:
        """Return the accelerations that the hinges' springs and dampers cause in the straight chain.

        Returns:
            Matrix of shape (rows, 2 passive joints): its columns are the passive angles and rates, its rows the
            accelerations of sway and yaw (free body only), of the passive joints and of those with a motor; and the
            rows' positions in the kernel's vector of velocities (surge, sway, yaw, joints).
        """
        passive, motors = self._joints(driven=False), self._joints(driven=True) if self.motor else []
        moving = ([0, 1] if self.clamp == "free" else []) + sorted(passive + motors)
        links = [link for link, is_driven in zip(self.links, self.driven, strict=True) if not is_driven]
        load = np.zeros((len(moving), 2 * len(passive)))
        for column, (joint, link) in enumerate(zip(passive, links, strict=True)):
            row = moving.index(joint)
            load[row, column], load[row, len(passive) + column] = -link.stiffness, -link.damping
        mass = self.straight_mass_matrix()
        mass[motors, motors] += self.motor.inertia if self.motor else 0.0
        mass = mass[np.ix_(moving, moving)]
        # Scaled to a unit diagonal: the body weighs up to 1e15 times the tip of a fin that ends in a point.
        scale = 1.0 / np.sqrt(np.diag(mass))
        scaled = scipy.linalg.solve(scale[:, None] * mass * scale, scale[:, None] * load, assume_a="sym")
        return scale[:, None] * scaled, [1 + index for index in moving]


def fin_links(fin: Fin) -> tuple[tuple[Link, ...], tuple[bool, ...]]:
    """Return the links of a fin and which of their joints is driven: the first one.

    ``between``: equal segments, the first rigid with the servo, a hinge between each two. ``midpoint``: a hinge in
    the middle of each segment, so the first link is half a segment long, rigid with the servo, and the last one too.
    """
    segment = fin.length / fin.segments
    if fin.hinges == "between":
        hinges = [segment * index for index in range(1, fin.segments)]
    else:
        hinges = [segment * (index + 0.5) for index in range(fin.segments)]
    ends = [0.0, *hinges, fin.length]
    links = []
    for start, end in pairwise(ends):
        stiffness = fin.hinge_stiffness(start) if start > 0.0 else 0.0
        points = fin.points_between(start, end) if isinstance(fin, ProfiledFin) else ()
        links.append(
            Link(
                length=end - start,
                root_height=fin.height_at(start),
                tip_height=fin.height_at(end),
                mass_per_area=fin.density * fin.thickness,
                stiffness=stiffness,
                damping=stiffness * fin.damping_time + (fin.hinge_damping if start > 0.0 else 0.0),
                profile=tuple((distance - start, height) for distance, height in points),
            )
        )
    return tuple(links), (True,) + (False,) * (len(links) - 1)


def build_chain(
    fish: Fish,
    fin: Fin,
    *,
    reactive: Reactive = "distributed",
    clamp: Clamp = "free",
    tow_speed: float = 0.0,
) -> Chain:
    """Return the chain of a fish with a fin; each link of its peduncle and the fin's root is driven.

    Raises:
        ValueError: More links than a chain can have, or an unknown name.
    """
    links, driven = fin_links(fin)
    return Chain(
        body=fish.body,
        links=fish.peduncle + links,
        driven=(True,) * len(fish.peduncle) + driven,
        water=fish.water,
        reactive=reactive,
        clamp=clamp,
        tow_speed=tow_speed,
        motor=fish.motor,
        axes=fish.axes,
    )
