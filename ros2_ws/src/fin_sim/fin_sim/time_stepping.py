"""The equations of motion integrated: a chain advanced through time, step by step.

The classical Runge-Kutta method of order 4, in the exponential form of Cox & Matthews (Journal of Computational Physics
176, 2002, eq. 26 to 29) for the springs and dampers of the hinges, whose effect on the straight chain is linear and is
integrated exactly. Without springs it is the classical method, with them the step is not bound by the stiffest hinge.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from fin_plant import checks
from fin_sim.compiled import kernel
from fin_sim.dynamics import (
    BODY_STATES,
    RECORD_HEAD,
    SCRATCH_COLUMNS,
    SURGE,
    SWAY,
    YAW_RATE,
    evaluate_with_added_mass,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.chain import Chain

    Array = NDArray[np.float64]


def propagator(chain: Chain, step: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return which states the hinges' springs and dampers move, and how over one step.

    Args:
        chain: The chain.
        step: Time step in s.

    Returns:
        Positions in the state, shape (S,), and matrices, shape (7, S, S): the linear part L, exp(L step / 2),
        exp(L step), and the weights of Cox & Matthews (2002), eq. 26 to 29: of the half steps, of the first, the two
        middle and the last stage.
    """
    response, rows = chain.elastic_response()
    passive = [index for index, is_driven in enumerate(chain.driven) if not is_driven]
    count, size = len(passive), 2 * len(passive) + len(rows) - len(passive)
    if not passive:
        return np.zeros(0, dtype=np.int64), np.zeros((7, 0, 0))
    links = len(chain.links)
    angles = [BODY_STATES + index for index in passive]
    rates = [BODY_STATES + links + index for index in passive]
    accelerated = [SURGE + row if row < YAW_RATE - SURGE + 1 else BODY_STATES + links + row - 3 for row in rows]
    states = angles + rates + [state for state in accelerated if state not in rates]
    linear = np.zeros((size, size))
    linear[:count, count : 2 * count] = np.eye(count)
    for row, state in zip(response, accelerated, strict=True):
        linear[states.index(state), : 2 * count] = row
    return np.array(states, dtype=np.int64), exponential_matrices(linear, step)


def exponential_matrices(linear: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the matrices that move a linear part over one step, see `propagator`, shape (7, S, S)."""
    half, half_1, _, _ = exponential_functions(0.5 * step * linear)
    exponential, phi_1, phi_2, phi_3 = exponential_functions(step * linear)
    return np.stack(
        (
            linear,
            half,
            exponential,
            0.5 * step * half_1,
            step * (phi_1 - 3.0 * phi_2 + 4.0 * phi_3),
            step * (2.0 * phi_2 - 4.0 * phi_3),
            step * (4.0 * phi_3 - phi_2),
        )
    )


def exponential_functions(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return exp(A), phi_1(A), phi_2(A) and phi_3(A) with phi_(j+1)(A) = (phi_j(A) - 1/j!) / A, A of shape (S, S).

    The exponential of one block matrix holds them all (Al-Mohy & Higham, SIAM J. Sci. Comput. 33, 2011, theorem 2.1).
    """
    size = len(matrix)
    block = np.zeros((4 * size, 4 * size))
    block[:size, :size] = matrix
    for part in range(3):
        block[part * size : (part + 1) * size, (part + 1) * size : (part + 2) * size] = np.eye(size)
    result = scipy.linalg.expm(block)
    return tuple(result[:size, part * size : (part + 1) * size] for part in range(4))


@kernel
def _add_product(matrix: Array, vector: Array, result: Array) -> None:
    """Add matrix @ vector to result; shapes (S, S), (S,), (S,)."""
    for row in range(result.shape[0]):
        total = 0.0
        for column in range(result.shape[0]):
            total += matrix[row, column] * vector[column]
        result[row] += total


@kernel
def integrate(
    state: Array,
    motion: Array,
    links: Array,
    body: Array,
    added: Array | None,
    free: bool,
    distributed: bool,
    step: float,
    every: int,
    stiff: NDArray[np.int64],
    matrices: Array,
    samples: Array,
    records: Array,
) -> int:
    """Advance a chain through time and keep every so many states.

    Args:
        state: Shape (n,) with n = 6 + 2 N, the first state; overwritten with the last.
        motion: Shape (2 steps + 1, N, 3): the driven joints' angle, rate and acceleration at every half step.
        links: As for `evaluate`.
        body: As for `evaluate`.
        added: `Chain.added_mass`.
        free: As for `evaluate`.
        distributed: As for `evaluate`.
        step: Time step in s.
        every: Steps between two samples; divides the number of steps.
        stiff: Shape (S,), and
        matrices: shape (7, S, S), from `propagator`.
        samples: Written, shape (steps / every + 1, n).
        records: Written, shape (steps / every + 1, ``RECORD_HEAD`` + N); see `evaluate`.

    Returns:
        The number of samples whose states are finite; less than all where the integration broke off.
    """
    size, count, stiff_count = state.shape[0], links.shape[0], stiff.shape[0]
    steps = (motion.shape[0] - 1) // 2
    scratch = np.zeros((count, SCRATCH_COLUMNS))
    slope = np.zeros((4, size))
    rest = np.zeros((4, stiff_count))  # of each stage: derivative less the linear part
    stage, record = np.zeros(size), np.zeros(records.shape[1])
    begin, middle, part = np.zeros(stiff_count), np.zeros(stiff_count), np.zeros(stiff_count)
    linear, propagate_half, propagate = matrices[0], matrices[1], matrices[2]
    weight_half, weight_first, weight_middle, weight_last = matrices[3], matrices[4], matrices[5], matrices[6]
    for index in range(steps + 1):
        at = 2 * index
        evaluate_with_added_mass(state, motion[at], links, body, added, free, distributed, slope[0], record, scratch)
        if index % every == 0:
            row = index // every
            samples[row] = state
            records[row] = record
            finite = True
            for i in range(size):
                finite = finite and np.isfinite(state[i]) and np.isfinite(slope[0, i])
            if not finite:
                return row
        if index == steps:
            break
        for i in range(stiff_count):
            begin[i] = state[stiff[i]]
        for number in range(4):
            if number > 0:
                drive = motion[at + (number + 1) // 2]
                evaluate_with_added_mass(
                    stage, drive, links, body, added, free, distributed, slope[number], record, scratch
                )
            for i in range(stiff_count):
                part[i] = state[stiff[i]] if number == 0 else stage[stiff[i]]
                rest[number, i] = 0.0
            _add_product(linear, part, rest[number])
            for i in range(stiff_count):
                rest[number, i] = slope[number, stiff[i]] - rest[number, i]
            if number == 3:  # noqa: PLR2004  (the last of four stages)
                break
            reach = step if number == 2 else 0.5 * step  # noqa: PLR2004
            for i in range(size):
                stage[i] = state[i] + reach * slope[number, i]
            part[:] = 0.0
            if number == 0:
                _add_product(propagate_half, begin, part)
                _add_product(weight_half, rest[0], part)
                middle[:] = part
            elif number == 1:
                _add_product(propagate_half, begin, part)
                _add_product(weight_half, rest[1], part)
            else:
                _add_product(propagate_half, middle, part)
                for i in range(stiff_count):
                    begin[i] = 2.0 * rest[2, i] - rest[0, i]
                _add_product(weight_half, begin, part)
            for i in range(stiff_count):
                stage[stiff[i]] = part[i]
        for i in range(stiff_count):
            begin[i] = state[stiff[i]]
        part[:] = 0.0
        _add_product(propagate, begin, part)
        _add_product(weight_first, rest[0], part)
        for i in range(stiff_count):
            middle[i] = rest[1, i] + rest[2, i]
        _add_product(weight_middle, middle, part)
        _add_product(weight_last, rest[3], part)
        for i in range(size):
            state[i] += step / 6.0 * (slope[0, i] + 2.0 * (slope[1, i] + slope[2, i]) + slope[3, i])
        for i in range(stiff_count):
            state[stiff[i]] = part[i]
    return int(steps // every + 1)


class StepError(ArithmeticError):
    """A swim whose state stopped being finite: says when, and what may help."""

    def __init__(self, time: float) -> None:
        """Note the time in s since the sample that `Stepper.advance` started from."""
        super().__init__(
            f"the state stopped being finite after {time:.3f} s: "
            "the step is too long for this fin and gait; use a shorter step or a slower gait"
        )
        self.time = time


class Stepper:
    """A chain ready to be advanced: its tables and its propagator for one step length."""

    def __init__(self, chain: Chain, step: float, every: int = 1) -> None:
        """Prepare.

        Args:
            chain: The chain.
            step: Time step in s.
            every: Steps from one kept sample to the next.

        Raises:
            ValueError: A step that is not positive, or less than one step a sample.
        """
        self.chain = chain
        self.step = checks.number("step", step, 0.0, 1.0, unit="s", exclusive_minimum=True)
        self.every = checks.whole_number("steps a sample", every, 1)
        self._links, self._body, self._added = chain.link_table(), chain.body_vector(), chain.added_mass()
        self._free, self._distributed = chain.clamp == "free", chain.reactive == "distributed"
        self._stiff, self._matrices = propagator(chain, step)

    @property
    def sample_time(self) -> float:
        """Time from one sample to the next in s."""
        return self.step * self.every

    def start(self) -> NDArray[np.float64]:
        """Return the state at the origin, at rest in the water or under tow, shape (6 + 2 N,)."""
        state = np.zeros(BODY_STATES + 2 * len(self._links))
        state[SURGE], state[SWAY] = self.chain.held_velocity
        return state

    def half_step_times(self, samples: int, first: int = 0) -> NDArray[np.float64]:
        """Return the times at which `advance` needs the driven joints' motion, in s since sample 0.

        Args:
            samples: Number of samples to advance by.
            first: Sample to advance from. A swim advanced in slices has bit for bit the times of one in a piece.
        """
        steps = np.arange(2 * samples * self.every + 1, dtype=np.float64)
        return 0.5 * self.step * (2 * first * self.every + steps)

    def advance(
        self, state: NDArray[np.float64], motion: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Advance ``state`` in place through the driven joints' ``motion``.

        Args:
            state: Shape (6 + 2 N,).
            motion: Shape (2 samples * every + 1, driven joints, 3), angle, rate and acceleration at
                `half_step_times`.

        Returns:
            States, shape (samples + 1, 6 + 2 N), the first one that of the start; and their records, shape
            (samples + 1, ``RECORD_HEAD`` + N), see `evaluate`.

        Raises:
            StepError: The state stopped being finite; its time is since the first of these samples.
        """
        links = len(self._links)
        samples = (len(motion) - 1) // (2 * self.every)
        drive = np.zeros((len(motion), links, 3))
        drive[:, np.array(self.chain.driven)] = motion
        states = np.zeros((samples + 1, len(state)))
        records = np.zeros((samples + 1, RECORD_HEAD + links))
        finite = integrate(
            state,
            drive,
            self._links,
            self._body,
            self._added,
            self._free,
            self._distributed,
            self.step,
            self.every,
            self._stiff,
            self._matrices,
            states,
            records,
        )
        if finite <= samples:
            raise StepError(finite * self.sample_time)
        return states, records


def steps_a_sample(sample_time: float, longest: float) -> int:
    """Return into how many equal steps a sample is divided, so that none is longer than ``longest`` s; at least one."""
    return max(1, math.ceil(sample_time / longest - 1e-9))


def stepper_of(chain: Chain, step: float, every: int = 1, *, quick: bool = False) -> Stepper:
    """Return what advances a chain in its water; arguments and errors as `Stepper`; ``quick``: as `PlaneStepper`."""
    if chain.water.model == "ideal_2d":
        from fin_sim.ideal_2d.plane_stepper import PlaneStepper  # noqa: PLC0415  (strips need no plane)

        return PlaneStepper(chain, step, every, quick=quick)
    return Stepper(chain, step, every)
