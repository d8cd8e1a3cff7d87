"""Many swims at once: the same physics as the general kernel, each fin for itself."""

from __future__ import annotations

import math
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_plant.gait import PAPER_GAIT, Gait, JointDrive, carangiform
from fin_plant.gait_follower import GaitFollower
from fin_sim import dynamics
from fin_sim.batch import Status, swim_batch
from fin_sim.batch import step as method
from fin_sim.batch.columns import fin_columns
from fin_sim.batch.equations import (
    DOUBLE,
    SINGLE,
    Drive,
    Hinge,
    LaneBody,
    LaneLink,
    resistive_wrench,
    sine_cosine,
    slip_angle,
)
from fin_sim.batch.lanes import lane_figures
from fin_sim.batch.links import lane_constants, link_columns
from fin_sim.batch.proven import proven_fins
from fin_sim.batch.result import FIGURES
from fin_sim.batch.task import checked_task
from fin_sim.batch.window import window_weights
from fin_sim.chain import (
    DAMPING,
    FIRST_PIECE,
    LENGTH,
    PIECE_HEIGHT,
    PIECE_SLOPE,
    RESISTIVE,
    SOLID_0,
    SOLID_1,
    SOLID_2,
    STIFFNESS,
    TIP_VIRTUAL,
    VIRTUAL_0,
    VIRTUAL_1,
    VIRTUAL_2,
    Chain,
    build_chain,
)
from fin_sim.fish import Fish, Link
from fin_sim.swim import RAMP_TIME, swim
from support.lane_equations import interpret, respond
from support.paper_fish import FISH as PAPER_FISH
from support.paper_fish import paper_columns, paper_fin

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fin_sim.batch import Precision
    from fin_sim.chain import Clamp, Reactive

    Array = NDArray[np.float64]

SWIMMER = Fish(PAPER_FISH.body, PAPER_FISH.water, (Link(0.03, 0.04, 0.03, 0.5), Link(0.02, 0.03, 0.03, 0.5)))
SWIMMER_GAIT = Gait((JointDrive(0.05, 0.9), JointDrive(0.1, 0.9, -0.5), JointDrive(0.2, 0.9, -1.0)))


def lane_links(chain: Chain) -> list[LaneLink]:
    """Return a chain's links as the lane equations take them."""
    result = []
    for row in chain.link_table():
        piece, length = row[RESISTIVE] * row[FIRST_PIECE:], row[LENGTH]
        root, slope = piece[PIECE_HEIGHT], piece[PIECE_SLOPE]
        values = (
            length,
            row[SOLID_0],
            row[SOLID_0] + row[VIRTUAL_0],
            row[SOLID_1] + row[VIRTUAL_1],
            row[SOLID_2] + row[VIRTUAL_2],
            row[VIRTUAL_0],
            row[VIRTUAL_1],
            row[TIP_VIRTUAL],
            root * length / 3,
            root * length**2 / 12,
            slope * length**2 / 12,
            slope * length**3 / 30,
        )
        result.append(LaneLink(*map(float, values)))
    return result


def evaluate(chain: Chain, table: Array, state: Array, drive: Array) -> tuple[Array, Array]:
    """Return the general kernel's derivative and record."""
    links = len(table)
    derivative, record, scratch = (
        np.zeros(len(state)),
        np.zeros(dynamics.RECORD_HEAD + links),
        np.zeros((links, dynamics.SCRATCH_COLUMNS)),
    )
    form = (chain.clamp == "free", chain.reactive == "distributed")
    dynamics.evaluate(state, drive, table, chain.body_vector(), *form, derivative, record, scratch)
    return derivative, record


@pytest.mark.parametrize("reactive", ["tip", "distributed"])
@pytest.mark.parametrize("clamp", ["free", "fixed"])
@pytest.mark.parametrize("segments", [2, 3, 7])
@pytest.mark.parametrize("fish", [PAPER_FISH, SWIMMER])
def test_lane_equations_are_those_of_the_general_kernel(
    reactive: Reactive, clamp: Clamp, segments: int, fish: Fish
) -> None:
    random = np.random.default_rng(segments)
    for tip in (0.025, 0.01, 0.0, 0.04):
        chain = build_chain(fish, paper_fin(segments=segments, tip_height=tip), reactive=reactive, clamp=clamp)
        table, links, driven = chain.link_table(), len(chain.links), fish.driven_joints
        state = random.normal(size=6 + 2 * links)
        state[3:5] *= 0.1
        state[6 + links :] *= 3.0
        drive = random.normal(size=(links, 3))
        expected, record = evaluate(chain, table, state, drive)
        angles, rates = state[6 + driven : 6 + links], state[6 + links + driven :]
        torques = -table[driven:, STIFFNESS] * angles - table[driven:, DAMPING] * rates
        response = respond(
            LaneBody(*map(float, chain.body_vector())),
            lane_links(chain),
            [Drive(math.sin(a), math.cos(a), rate, bend) for a, rate, bend in drive[:driven].tolist()],
            [Hinge(a, w, m, 0.0) for a, w, m in np.column_stack((angles, rates, torques)).tolist()],
            (float(state[3]), float(state[4]), float(state[5])),
            free=clamp == "free",
            distributed=reactive == "distributed",
            precision=DOUBLE,
        )
        got = np.array([response.surge, response.sway, response.yaw, *response.hinges], dtype=float)
        wanted = np.concatenate((expected[3:6], expected[6 + links + driven :]))
        assert got == pytest.approx(wanted, rel=1e-9, abs=1e-9 * np.abs(wanted).max())
        forward = math.cos(state[2]) * record[2] + math.sin(state[2]) * record[3]
        assert response.thrust == pytest.approx(forward, rel=1e-9)
        assert response.power == pytest.approx(record[4], rel=1e-9)


class ReferenceStepper:
    """The lanes' method written down plainly, with the accelerations of `dynamics.evaluate`."""

    def __init__(self, chain: Chain, motion: Array, step: float) -> None:
        self.chain, self.motion, self.step = chain, motion, step
        self.table, self.driven, self.links = chain.link_table(), motion.shape[1], len(chain.links)
        passive = self.links - self.driven
        self.stiffness, self.damping = self.table[self.driven :, STIFFNESS].copy(), self.table[self.driven :, DAMPING]
        self.damping = self.damping.copy()
        self.angles, self.rates = np.zeros((4, passive)), np.zeros((4, passive))
        self.velocity, self.slopes = np.zeros(3), np.zeros((3, 3))

    def accelerations(self, state: Array, drive: Array, torque: Array) -> Array:
        """Return those of body and hinges under given torques of the hinges."""
        self.table[self.driven :, STIFFNESS] = 0.0
        self.table[self.driven :, DAMPING] = -torque / state[6 + self.links + self.driven :]
        derivative, _ = evaluate(self.chain, self.table, state, drive)
        return np.concatenate((derivative[3:6], derivative[6 + self.links + self.driven :]))

    def advance(self, index: int) -> None:
        """Take step ``index``."""
        reach = method.HINGE_REACH * self.step
        history, ahead = np.array(method.HINGE_HISTORY), np.array(method.EXTRAPOLATION)
        angle, rate = history @ self.angles, history @ self.rates
        state, drive = np.zeros(6 + 2 * self.links), np.zeros((self.links, 3))
        state[3:6] = self.velocity + self.step * np.array(method.PREDICTOR) @ self.slopes
        state[6 + self.driven : 6 + self.links] = ahead @ self.angles
        rates = ahead @ self.rates
        state[6 + self.links + self.driven :] = np.where(rates == 0.0, 1e-150, rates)
        drive[: self.driven] = self.motion[index]
        count = len(angle)
        alone = self.accelerations(state, drive, np.zeros(count))
        share = np.array([self.accelerations(state, drive, row) - alone for row in 1e-3 * np.eye(count)]).T / 1e-3
        torque = -self.stiffness * (angle + reach * rate) - self.damping * rate
        compliance = self.stiffness * reach**2 + self.damping * reach
        bend = np.linalg.solve(np.eye(count) + share[3:] * compliance, alone[3:] + share[3:] @ torque)
        body = (alone + share @ (torque - compliance * bend))[:3]
        corrector = np.array(method.CORRECTOR)
        self.velocity = self.velocity + self.step * (corrector[0] * body + corrector[1:] @ self.slopes)
        self.slopes = np.vstack((body, self.slopes[:-1]))
        new_rate = rate + reach * bend
        self.rates = np.vstack((new_rate, self.rates[:-1]))
        self.angles = np.vstack((angle + reach * new_rate, self.angles[:-1]))


@pytest.mark.parametrize("reactive", ["tip", "distributed"])
@pytest.mark.parametrize(("fish", "gait"), [(PAPER_FISH, PAPER_GAIT), (SWIMMER, SWIMMER_GAIT)])
def test_a_swim_in_lanes_is_the_same_method_with_the_general_kernel(
    reactive: Reactive, fish: Fish, gait: Gait, monkeypatch: pytest.MonkeyPatch
) -> None:
    interpret(monkeypatch)
    fin, steps, duration = paper_fin(tip_height=0.035), 100, 2.0
    follower = GaitFollower(fish.driven_joints, 0.5)
    follower.command(gait, 0.0)
    motion = follower.motion(np.linspace(duration / steps, duration, steps))
    reference = ReferenceStepper(build_chain(fish, fin, reactive=reactive), motion, duration / steps)
    surge = []
    for index in range(steps):
        reference.advance(index)
        surge.append(reference.velocity[0])
    task = checked_task(fish, gait, duration, reactive, "free", 0.0, 0.5, 0.0, duration / steps, "double")
    swum = lane_figures(task, fin_columns([fin]))[0, FIGURES.index("mean_forward_speed")]
    assert swum == pytest.approx(window_weights(steps + 1, 0.0)[1:] @ surge, rel=1e-9)


@given(st.integers(4, 40), st.floats(0.0, 0.95))
def test_means_over_a_window_are_exact_for_a_cubic_wherever_it_begins(samples: int, begin: float) -> None:
    at, begin = np.linspace(0.0, 1.0, samples), begin * (samples - 2) / (samples - 1)
    exact = (1.0 - begin**4) / (4.0 * (1.0 - begin)) - 2.0 * (1.0 - begin**2) / (2.0 * (1.0 - begin))
    assert window_weights(samples, begin * (samples - 1)) @ (at**3 - 2.0 * at) == pytest.approx(exact, abs=1e-10)


def test_columns_of_links_are_those_of_single_fins() -> None:
    for hinges in ("between", "midpoint"):
        fins = [paper_fin(young_modulus=e, tip_height=tip, hinges=hinges) for e in (1e8, 3e9) for tip in (0.0, 0.04)]
        links = link_columns(SWIMMER, fin_columns(fins))
        columns = lane_constants(links, SWIMMER.water)
        for row, fin in enumerate(fins):
            chain = build_chain(SWIMMER, fin)
            for index, expected in enumerate(lane_links(chain)):
                got = [float(columns[name][row, index]) for name in method.LINK_FIELDS]
                assert got == pytest.approx([getattr(expected, name) for name in method.LINK_FIELDS], rel=1e-12)
            table = chain.link_table()[SWIMMER.driven_joints :]
            assert links["stiffness"][row, SWIMMER.driven_joints :] == pytest.approx(table[:, STIFFNESS], rel=1e-12)
            assert links["damping"][row, SWIMMER.driven_joints :] == pytest.approx(table[:, DAMPING], rel=1e-12)


@pytest.mark.parametrize("reactive", ["tip", "distributed"])
def test_mean_speed_is_within_a_thousandth_of_the_converged_one(reactive: Reactive) -> None:
    shapes = [{}, {"length": 0.05}, {"length": 0.14, "height": 0.0143, "tip_height": 0.0143}]
    fins = [paper_fin(young_modulus=e, **shape) for shape in shapes for e in (5e8, 1.2e9, 4e9, 8e9, 2e11)]
    swum = swim_batch(fins, reactive=reactive)
    converged = [swim(fin, reactive=reactive, step=2e-3) for fin in fins]
    assert swum.mean_speed == pytest.approx([one.mean_speed for one in converged], rel=1e-3)
    assert swum.mean_forward_speed == pytest.approx([one.mean_forward_speed for one in converged], rel=1e-3)
    finer = swim_batch(fins, reactive=reactive, step=5e-3)
    assert finer.mean_speed == pytest.approx(
        [one.mean_speed for one in converged], rel=5e-5
    )  # v |v| has a kink, so less than 4^4 times
    if reactive == "distributed":
        single = swim_batch(fins, reactive=reactive, precision="single")
        assert single.mean_speed == pytest.approx(swum.mean_speed, rel=1e-4)


@pytest.mark.parametrize("clamp", ["fixed", "towed"])
def test_thrust_and_power_of_a_held_body_are_those_of_single_swims(clamp: Clamp) -> None:
    fins, duration, settle = [paper_fin(density=0.0), paper_fin(young_modulus=4e9)], 8.0 / 0.9, 4.0 / 0.9
    tow = {"tow_speed": 0.03} if clamp == "towed" else {}
    swum = swim_batch(fins, duration=duration, settle=settle, clamp=clamp, **tow)  # type: ignore[arg-type]
    for index, fin in enumerate(fins):
        one = swim(fin, duration=duration, clamp=clamp, sample_time=1 / 90, **tow)  # type: ignore[arg-type]
        assert swum.thrust[index] == pytest.approx(np.mean(one.convective_force[-400:, 0]), rel=1e-3)
        assert swum.servo_power[index] == pytest.approx(np.mean(one.servo_power[-400:]), rel=1e-3)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize(("count", "block", "duration"), [(4101, 2048, 10.0), (37, 16, 1.0)])
def test_a_fin_swims_the_same_alone_in_any_batch_and_on_any_number_of_threads(
    count: int, block: int, duration: float, precision: Precision, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both in windows whose fins are proven and in those, 300 times as dear, whose fins swim until they converge."""
    monkeypatch.setattr(import_module("fin_sim.batch.swim_batch"), "_BLOCK", block)
    columns = paper_columns(young_modulus=np.linspace(5e8, 4e9, count), length=0.06)
    task = checked_task(PAPER_FISH, PAPER_GAIT, duration, "distributed", "free", 0.0, RAMP_TIME, 0.0, None, precision)
    assert (proven_fins(task, fin_columns(columns)) == (duration == 10.0)).all()
    together = swim_batch(columns, PAPER_FISH, duration=duration, precision=precision, threads=2)
    apart = swim_batch(columns, PAPER_FISH, duration=duration, precision=precision, threads=1)
    assert np.array_equal(together.mean_speed, apart.mean_speed)
    for index in (0, 7, block, count - 1):
        fin = paper_fin(young_modulus=columns["young_modulus"][index], length=0.06)
        alone = swim_batch([fin], PAPER_FISH, duration=duration, precision=precision)
        assert alone.mean_speed[0] == together.mean_speed[index]


def test_a_refused_and_a_diverging_fin_spoil_nobody_elses_result() -> None:
    moduli = np.array([1.2e9, np.nan, 1.2e9, -1.0, np.inf, 1.2e9])
    swum = swim_batch(paper_columns(young_modulus=moduli, thickness=[2e-4, 2e-4, 0.019, 2e-4, 2e-4, 2e-4], height=0.01))
    refused = Status.REFUSED
    assert swum.status.tolist() == [Status.OK, refused, refused, refused, refused, Status.OK]
    assert swum.mean_speed[0] == swum.mean_speed[5]
    assert np.isnan(swum.mean_speed[1:5]).all()
    assert "fin.young_modulus = nan" in swum.reason(1)
    assert "thickness" in swum.reason(2)
    assert swum.reason(0) == ""
    violent = swim_batch(
        [paper_fin(), paper_fin(young_modulus=1e7)], gait=carangiform(3.0, 10.0), step=0.05, duration=2.0
    )
    assert (violent.status == Status.FOLDED).all()
    assert np.isnan(violent.mean_speed).all()
    assert (violent.largest_hinge_angle > math.pi).all()
    assert "slower or smaller gait" in violent.reason(0)


def test_undamped_fins_swim_by_the_general_kernel() -> None:
    fins = [paper_fin(damping_time=0.0), paper_fin()]
    swum = swim_batch(fins, duration=2.0)
    assert swum.mean_speed[0] == pytest.approx(swim(fins[0], duration=2.0).mean_speed, rel=2e-4)
    assert (swum.status == Status.OK).all()
    assert swum.mean_speed[1] == swim_batch([paper_fin()], duration=2.0).mean_speed[0]


def test_more_links_than_a_chain_can_have_is_a_refused_fin() -> None:
    swum = swim_batch([paper_fin(segments=20, hinges="midpoint"), paper_fin()], SWIMMER, SWIMMER_GAIT, 0.5)
    assert swum.status.tolist() == [Status.REFUSED, Status.OK]
    assert "fewer segments" in swum.reason(0)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"duration": -1.0}, "duration"),
        ({"step": 0.0}, "step"),
        ({"settle": 11.0}, "settle"),
        ({"clamp": "glued"}, "clamp"),
        ({"reactive": "none"}, "reactive"),
        ({"precision": "half"}, "precision"),
        ({"gait": SWIMMER_GAIT}, "gait has 3 rows"),
        ({"threads": -1}, "threads"),
    ],
)
def test_what_all_fins_share_is_refused_by_name(arguments: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        swim_batch([paper_fin()], **arguments)


@pytest.mark.parametrize(
    "columns",
    [{"modulus": [1e9]}, {"young_modulus": ["a"]}, {"young_modulus": [1e9, 2e9], "length": [0.1, 0.1, 0.1]}],
)
def test_columns_that_cannot_be_are_refused(columns: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="fin"):
        swim_batch(columns)


def test_an_empty_batch_is_an_empty_result() -> None:
    assert len(swim_batch([])) == 0


@given(st.floats(-30.0, 30.0))
def test_sine_and_cosine(angle: float) -> None:
    for precision, tolerance in ((DOUBLE, 1e-12), (SINGLE, 1e-6)):
        assert sine_cosine(angle, precision) == pytest.approx((math.sin(angle), math.cos(angle)), abs=tolerance)


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_slip_angle(forward: float, sideways: float) -> None:
    expected = math.atan2(sideways, forward) if math.hypot(forward, sideways) > 1e-20 else 0.0
    got = slip_angle(forward, sideways, math.hypot(forward, sideways), DOUBLE)
    if math.hypot(forward, sideways) > 1e-20 and not (sideways == 0.0 and forward < 0.0):
        assert got == pytest.approx(expected, abs=1e-10)


@settings(deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0), st.floats(-1.0, 1.0))
def test_resistive_integrals_are_those_of_quadrature(front: float, rear: float, root: float, slope: float) -> None:
    link = LaneLink(0.5, *(0.0,) * 7, root * 0.5 / 3, root * 0.5**2 / 12, slope * 0.5**2 / 12, slope * 0.5**3 / 30)
    crossing = front / (front - rear) if front * rear < 0.0 else 0.5
    nodes, weights = np.polynomial.legendre.leggauss(6)
    force = moment = 0.0
    for low, high in ((0.0, crossing), (crossing, 1.0)):
        part = low + (high - low) * 0.5 * (nodes + 1.0)
        v = front + (rear - front) * part
        density = 0.25 * (high - low) * weights * (root + slope * 0.5 * part) * v * np.abs(v)
        force, moment = force + density.sum(), moment + (density * 0.5 * part).sum()
    assert resistive_wrench(front, rear, link) == pytest.approx((force, moment), abs=1e-12)
