"""The choice of the next fin by a cloud of plausible fish."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.search import cloud as cloud_module
from fin_optimizer.search import plausible
from fin_optimizer.search.algorithms import Swimming, search
from fin_optimizer.search.cloud import Belief, Cloud
from fin_optimizer.search.cloud_search import CloudSearch
from fin_optimizer.search.space import Choice, Dimension, Evaluation, Space, Values
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT, Gait, sub_carangiform
from fin_sim.batch import swim_batch
from fin_sim.batch.lanes import lane_figures
from fin_sim.swim import PAPER_FISH

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from fin_sim.batch.task import Task

    Array = NDArray[np.float64]

STOCK = Space((Choice("fin.young_modulus", (1.6e9, 3.3e9), "Pa"), Choice("fin.thickness", (2e-4, 3e-4, 5e-4), "m")))
FISH, DURATION = 24, 4.0


def swum(values: Values) -> tuple[Fin, Gait]:
    return Fin(**{name.removeprefix("fin."): value for name, value in values.items()}), PAPER_GAIT


def cloud_search(seed: int = 1) -> CloudSearch:
    return CloudSearch(STOCK, seed, swum, DURATION, fish=FISH)


def speed_of(values: Values) -> float:
    """Return the speed of a fish that is none of the cloud's."""
    body = replace(PAPER_FISH.body, drag_area=2.0 * PAPER_FISH.body.drag_area)
    fins = [replace(swum(values)[0], segments=3)]
    return float(swim_batch(fins, replace(PAPER_FISH, body=body), PAPER_GAIT, DURATION).mean_forward_speed[0])


def history_of(trials: int, one: CloudSearch) -> list[Evaluation]:
    random, history = np.random.default_rng(4), list[Evaluation]()
    for _ in range(trials):
        values = one.propose(history)
        history.append(Evaluation(values, speed_of(values) * (1.0 + 0.05 * random.standard_normal())))
    return history


def two_fish(noise: float = 0.05, discrepancy: float = 0.0) -> Cloud:
    speeds = np.array([[0.02, 0.03, 0.03], [0.04, 0.03, 0.02]])
    return Cloud(speeds, np.zeros(2), np.array([[0.0], [10.0], [20.0]]), noise, discrepancy)


def test_weights_follow_bayes() -> None:
    belief = two_fish().belief(np.array([0]), np.array([0.03]))
    apart = np.log(0.03 / np.array([0.02, 0.04]))
    likely = np.exp(-0.5 * (apart / 0.05) ** 2)
    assert belief.weights == pytest.approx(likely / likely.sum())
    assert belief.mean == pytest.approx(belief.weights @ two_fish().speeds)


def test_a_fin_on_which_all_fish_agree_teaches_nothing() -> None:
    cloud = two_fish()
    gains = cloud.gains(cloud.belief(np.array([], dtype=int), np.array([])), np.random.default_rng(1))
    assert gains[1] == pytest.approx(0.0, abs=1e-12)
    # Whichever fish it is, the best fin is known afterwards: 0.035 m/s in the mean instead of 0.03.
    assert gains[0] == pytest.approx(0.035 / 0.03 - 1.0, rel=1e-6)


def test_what_no_fish_explains_is_learnt_for_fins_alike_and_not_for_others() -> None:
    speeds = np.full((3, 3), 0.03)
    cloud = Cloud(speeds, np.zeros(3), np.array([[0.0], [0.1], [9.0]]), 0.02, 0.1)
    belief = cloud.belief(np.array([0, 0, 0, 0]), np.full(4, 0.036))
    assert belief.mean[0] > 0.035
    assert belief.mean[1] == pytest.approx(belief.mean[0], rel=5e-3)
    assert belief.mean[2] == pytest.approx(0.03, rel=1e-2)
    assert belief.deviation[2] > 3.0 * belief.deviation[0]


def test_the_order_of_trials_changes_no_belief() -> None:
    cloud = two_fish(discrepancy=0.03)
    one = cloud.belief(np.array([0, 1, 2]), np.array([0.021, 0.03, 0.028]))
    other = cloud.belief(np.array([2, 0, 1]), np.array([0.028, 0.021, 0.03]))
    assert one.mean == pytest.approx(other.mean)


NOTHING = np.array([], dtype=np.intp)
SPEEDS = np.array([[0.02, 0.03, 0.025], [0.04, 0.03, 0.02], [0.05, 0.01, 0.03]])
PLACES = np.array([[0.0, 0.0], [1.0, 0.5], [3.0, 4.0]])


def test_fins_are_alike_by_their_distance() -> None:
    apart = 0.04 * np.exp(-0.5 * np.array([[0.0, 1.25, 25.0], [1.25, 0.0, 16.25], [25.0, 16.25, 0.0]]))
    assert Cloud(SPEEDS, np.zeros(3), PLACES, 0.1, 0.2)._likeness() == pytest.approx(apart)


def test_a_belief_has_the_moments_of_its_mixture() -> None:
    """Each fish's logarithms are normal: their moments after two trials by the inverse of the covariance."""
    cloud = Cloud(SPEEDS, np.log([0.2, 0.5, 0.3]), PLACES, 0.1, 0.2)
    belief = cloud.belief(np.array([0, 1]), np.array([0.036, 0.024]))
    like = cloud._likeness()
    inverse = np.linalg.inv(like[:2, :2] + 0.01 * np.eye(2))
    left = np.log([0.036, 0.024]) - np.log(SPEEDS[:, :2])
    weights = np.array([0.2, 0.5, 0.3]) * np.exp([-0.5 * each @ inverse @ each for each in left])
    weights /= weights.sum()
    at = np.log(SPEEDS) + np.array([like[:, :2] @ inverse @ each for each in left])
    variance = np.diag(like - like[:, :2] @ inverse @ like[:2])
    mean = weights @ np.exp(at + variance / 2.0)
    assert belief.weights == pytest.approx(weights)
    assert belief.variance == pytest.approx(variance)
    assert belief.mean == pytest.approx(mean)
    assert belief.deviation == pytest.approx(np.sqrt(weights @ np.exp(2.0 * at + 2.0 * variance) - mean**2))
    assert belief.effective_size == pytest.approx(1.0 / (weights @ weights))
    assert belief.best == 0


def test_fish_that_are_all_most_unlikely_count_as_they_are_to_each_other() -> None:
    belief = Cloud(SPEEDS, np.log([0.2, 0.5, 0.3]) - 1000.0, PLACES, 0.1, 0.2).belief(np.array([], int), np.array([]))
    assert belief.weights == pytest.approx([0.2, 0.5, 0.3])


def test_gains_are_the_integral_over_what_a_trial_may_tell() -> None:
    """A trial weighs the fish, and moves what no fish explains too."""
    each_another = np.array([[0.03, 0.06, 0.03], [0.036, 0.02, 0.02], [0.04, 0.03, 0.07]])
    cloud = Cloud(each_another, np.log([0.2, 0.5, 0.3]), PLACES, 0.15, 0.4)
    belief = cloud.belief(np.array([0]), np.array([0.036]))
    outcomes = np.linspace(-8.0, 0.0, 20_001)
    expected = []
    for fin in range(3):
        total = belief.variance[fin] + 0.15**2
        share = belief.covariance[fin] / total
        left = outcomes[:, None] - belief.logarithms[:, fin]
        density = belief.weights * np.exp(-0.5 * left**2 / total)
        variance = belief.variance - share * belief.covariance[fin]
        after = belief.logarithms[None] + left[:, :, None] * share + 0.5 * variance
        best = np.max(np.einsum("of,ofn->on", density, np.exp(after)), axis=1)
        expected.append(np.trapezoid(best, outcomes) / np.sqrt(2.0 * np.pi * total) / belief.mean.max() - 1.0)
    found = np.mean([cloud.gains(belief, np.random.default_rng(seed)) for seed in range(100)], axis=0)
    assert found == pytest.approx(np.array(expected), abs=8e-3)
    assert max(expected) > 0.15


def test_expected_regret_is_that_of_the_mixture() -> None:
    """The fish that is believed in with one part of four is best with another fin, and misses a quarter."""
    speeds = np.array([[0.04, 0.03, 0.01], [0.02, 0.03, 0.01]])
    far = np.array([[0.0], [10.0], [20.0]])
    belief = Cloud(speeds, np.log([0.25, 0.75]), far, 0.05, 0.0).belief(NOTHING, np.array([]))
    slower, sure = cloud_module.regret(belief, np.random.default_rng(1))
    assert belief.best == 1
    assert slower == pytest.approx(0.25 * (1.0 - 0.03 / 0.04), rel=1e-6)
    assert sure == pytest.approx(0.75)


def test_what_lies_between_the_fish_of_a_cloud_is_believed_where_few_are_near() -> None:
    """A fish between those of a thin cloud: its speed with a fin that was not tried follows from its neighbours'."""
    random = np.random.default_rng(3)
    drag = random.standard_normal(1000)
    place = random.standard_normal(1000)
    logarithms = np.log(0.03) + np.stack((0.5 * drag, 0.5 * drag + 0.5 * place, 0.5 * place), axis=1)
    cloud = Cloud(np.exp(logarithms), np.zeros(1000), np.array([[0.0], [10.0], [20.0]]), 0.002, 0.0)
    belief = cloud.belief(np.array([0, 1]), 0.03 * np.exp([0.4, 0.9]))  # drag 0.8 and place 1
    assert np.log(belief.mean[2] / 0.03) == pytest.approx(0.5, abs=0.02)
    assert belief.effective_size > 3.0
    narrow = np.exp(-0.5 * (((logarithms[:, 0] - np.log(0.03) - 0.4) / 0.002) ** 2))
    assert narrow.sum() ** 2 / (narrow**2).sum() < 6.0, "the weights alone would have collapsed"


FARTHER = 2.0 - np.sqrt(3.0)
"""Of two fish that count fully and two that count so much less, three count: (2 + 2 q)^2 / (2 + 2 q^2) = 3."""


def thin_cloud() -> Cloud:
    """Return a cloud of 150 fish, of which three are to count: 0 and 1 swim the first fin as it is measured.

    2 and 3 swim it faster by sqrt(2000) times the noise of 1 %, and nobody believes in the others.
    """
    speeds = np.full((150, 2), 0.05)
    speeds[:4, 0] = 0.03 * np.exp(0.01 * np.sqrt([0.0, 0.0, 2000.0, 2000.0]))
    speeds[:4, 1] = [0.02, 0.04, 0.03, 0.06]
    return Cloud(speeds, np.where(np.arange(150) < 4, 0.0, -1e6), np.array([[0.0], [30.0]]), 0.01, 0.0)


def test_as_many_fish_count_as_are_to_by_a_power_of_their_likelihood() -> None:
    even, apart = np.zeros(4), np.array([0.0, 0.0, 1e3, 1e3])
    assert cloud_module._softened(even, even, 4.0) is None
    assert cloud_module._softened(np.zeros(2), np.array([0.0, 1.0]), 1.5) is None, "1.65 count"
    softened = cloud_module._softened(even, apart, 3.0)
    assert softened == pytest.approx(np.array([1.0, 1.0, FARTHER, FARTHER]) / (2.0 + 2.0 * FARTHER))
    least = cloud_module._softened(even, 1e3 * apart, 3.0)  # the power is exp(-10) at least
    assert least is not None
    assert np.log(least[2] / least[0]) == pytest.approx(-1e6 * np.exp(-10.0))


def test_neighbours_weigh_by_bayes_or_are_as_many_as_are_to_count() -> None:
    found = thin_cloud().neighbours(np.array([0]), np.array([0.03]))
    expected = np.array([1.0, 1.0, FARTHER, FARTHER]) / (2.0 + 2.0 * FARTHER)
    assert found[:4] == pytest.approx(expected)
    assert not found[4:].any()
    cloud = Cloud(SPEEDS, np.log([0.2, 0.5, 0.3]), PLACES, 0.1, 0.2)
    tried, scores = np.array([0, 1]), np.array([0.036, 0.024])
    assert cloud.neighbours(tried, scores) == pytest.approx(cloud.belief(tried, scores).weights)


def test_what_lies_around_fish_that_are_near_is_a_gaussian_narrower_than_they_are_spread() -> None:
    belief = thin_cloud().belief(np.array([0]), np.array([0.03]))
    weights = np.array([1.0, 1.0, FARTHER, FARTHER]) / (2.0 + 2.0 * FARTHER)
    logarithms = np.log(thin_cloud().speeds[:4])
    around = 0.36 * np.cov(logarithms.T, aweights=weights, ddof=0)
    left = np.log(0.03) - logarithms[:, 0]
    total = around[0, 0] + 0.01**2
    likely = np.exp(-0.5 * left**2 / total)
    assert belief.weights == pytest.approx(likely / likely.sum()), "of 150 fish four are left"
    assert belief.logarithms == pytest.approx(logarithms + np.outer(left, around[0]) / total)
    assert belief.covariance == pytest.approx(around - np.outer(around[0], around[0]) / total, abs=1e-12)


def test_places_are_drawn_evenly_by_their_weights() -> None:
    drawn = cloud_module._systematic(np.array([0.5, 0.25, 0.25]), 8, np.random.default_rng(1))
    assert drawn.tolist() == [0, 0, 0, 0, 1, 1, 2, 2]
    short = cloud_module._systematic(np.array([0.4, 0.4]), 4, np.random.default_rng(1))
    assert short.tolist() == [0, 0, 1, 1], "weights whose sum is less by rounding"


def test_fish_drawn_anew_stand_for_the_same_belief() -> None:
    random = np.random.default_rng(2)
    numbers, kinds = random.standard_normal((1500, 2)), np.arange(1500) % len(plausible.KINDS)

    def likelihood(rows: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-0.5 * ((rows[:, 0] - 1.5) / 0.2) ** 2))

    weights = likelihood(numbers) / likelihood(numbers).sum()
    fins = plausible.Fins((Fin(),), (PAPER_GAIT,), DURATION)
    prior = plausible.Fish.of(fins, numbers, kinds)
    prior.swum = 1500
    fresh = plausible.drawn_around(numbers, kinds, weights, 1500, random)
    both = plausible.with_fresh(prior, fins, prior, weights, fresh)
    again = np.exp(both.importance) * likelihood(both.numbers)
    again /= again.sum()
    # Prior and likelihood are Gaussian: the mean of the first number is 1.5 / (1 + 0.2^2).
    assert again @ both.numbers[:, 0] == pytest.approx(1.5 / 1.04, abs=0.03)
    assert again @ both.numbers[:, 1] == pytest.approx(0.0, abs=0.1)
    assert 1.0 / np.sum(again**2) > 1.5 / np.sum(weights**2)
    assert set(fresh[1].tolist()) <= set(range(len(plausible.KINDS)))
    assert both.left == 1500


def test_a_cloud_swims_slice_by_slice_and_is_kept(tmp_path: Path) -> None:
    one = replace(cloud_search(), kept=tmp_path)
    parts = [one.prepare([])]
    while parts[-1] < 1.0:
        parts.append(one.prepare([]))
    assert parts == [16 / 24, 1.0]
    (file,) = tmp_path.iterdir()
    again = replace(cloud_search(), kept=tmp_path)
    assert again.prepare([]) == 1.0
    assert again.told([]) == one.told([]) == cloud_search().told([])
    file.write_bytes(file.read_bytes()[:200])
    assert replace(cloud_search(), kept=tmp_path).prepare([]) < 1.0, "a broken file is made again"
    other = CloudSearch(STOCK, 1, swum, 2.0 * DURATION, fish=FISH, kept=tmp_path)
    assert other.prepare([]) < 1.0, "another swim has other speeds"


def test_speeds_of_plausible_fish_are_the_simulators() -> None:
    fins = plausible.Fins((Fin(), Fin(young_modulus=4e9, length=0.1)), (PAPER_GAIT, PAPER_GAIT), DURATION)
    kinds = np.array([0, 6], dtype=np.intp)
    rows = PAPER_GAIT.rows()
    rows[:, 0] /= np.hypot(1.0, 2.0 * np.pi * rows[:, 1] * plausible.SERVO_LAG)  # as of a filter of first order
    lagging = Gait.from_rows(rows)
    speeds = plausible.speeds(fins, np.zeros((2, fins.numbers)), kinds)
    for row, kind in zip(speeds, kinds, strict=True):
        segments, hinges, reactive = plausible.KINDS[kind]
        built = [replace(fin, segments=segments, hinges=hinges) for fin in fins.fins]
        swims = swim_batch(built, PAPER_FISH, lagging, DURATION, reactive=reactive)
        assert row == pytest.approx(swims.mean_forward_speed, rel=2e-3)


def test_a_swim_that_ran_away_is_swum_in_shorter_steps_or_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    fins = plausible.Fins((Fin(), Fin(young_modulus=4e9)), (PAPER_GAIT, PAPER_GAIT), DURATION)
    steps: list[int] = []
    honest = lane_figures

    def broken(task: Task, columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float64]:
        steps.append(task.steps)
        found = honest(task, columns)
        if len(steps) < 3:
            found[0] *= 1e20
        return found

    kinds = np.array([0], dtype=np.intp)
    right = plausible.speeds(fins, np.zeros((1, fins.numbers)), kinds)
    monkeypatch.setattr(plausible, "lane_figures", broken)
    assert plausible.speeds(fins, np.zeros((1, fins.numbers)), kinds) == pytest.approx(right, rel=2e-3)
    assert steps == [steps[0], 4 * steps[0], 8 * steps[0]]
    monkeypatch.setattr(plausible, "_STEP_PARTS", (1,))
    steps.clear()
    assert np.isnan(plausible.speeds(fins, np.zeros((1, fins.numbers)), kinds)).tolist() == [[True, False]]


def test_a_study_that_goes_on_proposes_the_same_to_the_last_bit() -> None:
    history = history_of(4, cloud_search())
    for count, entry in enumerate(history):
        assert cloud_search().propose(history[:count]) == entry.values
    assert cloud_search().told(history) == cloud_search().told(history)


def test_it_finds_the_best_fin_of_a_small_stock_and_says_when_enough_is_known() -> None:
    one = cloud_search()
    history = history_of(8, one)
    told = one.told(history)
    true = {tuple(values.values()): speed_of(values) for values in one.candidates}
    assert true[tuple(told.best.values())] >= 0.97 * max(true.values())
    assert told.gain < one.told(history[:1]).gain
    assert told.deviation < 0.2 * told.speed
    assert told.effective_fish >= 1.0


def test_a_belief_is_drawn_from_once_a_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[int] = []

    def counted(belief: Belief, count: int, random: np.random.Generator) -> Array:
        drawn.append(count)
        return draw(belief, count, random)

    draw = Belief.drawn
    monkeypatch.setattr(Belief, "drawn", counted)
    one = cloud_search()
    history = history_of(1, one)
    drawn.clear()
    told, proposed = one.told(history), one.propose(history)
    assert len(drawn) == 2, "for the gains, and for the regret"
    assert (one.told(history), one.propose(history), len(drawn)) == (told, proposed, 2)
    assert cloud_search().propose(history) == proposed, "whether it was told or not"
    drawn.clear()
    one.propose([*history, Evaluation(proposed, None, pending=True)])
    assert len(drawn) == 1, "the next trial has random numbers of its own"


def test_what_failed_or_swims_just_now_is_not_proposed() -> None:
    one = cloud_search()
    first = one.propose([])
    for pending in (False, True):
        assert one.propose([Evaluation(first, None, pending=pending)]) != first


def test_fins_of_a_continuous_space_are_spread_over_it() -> None:
    space = Space((Dimension("fin.length", 0.05, 0.12, "m"), Dimension("fin.young_modulus", 1e9, 4e9, "Pa", log=True)))
    one = CloudSearch(space, 1, swum, DURATION, fish=8)
    lengths = [values["fin.length"] for values in one.candidates]
    assert len(lengths) > 200
    assert np.ptp(lengths) > 0.068


def test_every_value_of_a_grid_is_a_candidate() -> None:
    space = Space((Dimension("fin.length", 0.05, 0.12, "m", step=0.01), Choice("fin.thickness", (2e-4, 3e-4), "m")))
    assert len(CloudSearch(space, 1, swum, DURATION, fish=8).candidates) == 16


def test_tails_of_two_joints_are_refused_with_what_to_use() -> None:
    one = CloudSearch(STOCK, 1, lambda values: (swum(values)[0], sub_carangiform(0.2, 0.9)), DURATION, fish=8)
    with pytest.raises(ValueError, match="one driven joint, this one has 2: use gp"):
        one.propose([])


def test_a_study_names_it_and_two_objectives_are_refused() -> None:
    swimming = Swimming(swum, 1.0, 4.0)
    made = search("cloud", STOCK, 3, {}, swimming=swimming)
    assert isinstance(made, CloudSearch)
    assert (made.settle, made.duration) == (1.0, 4.0)
    with pytest.raises(ValueError, match="needs objective speed"):
        search("cloud", STOCK, 3, {})
    with pytest.raises(ValueError, match="one objective only"):
        search("cloud", STOCK, 3, {}, objectives=2, swimming=swimming)
    with pytest.raises(ValueError, match="knows no constraints"):
        search("cloud", STOCK, 3, {}, constraints=1, swimming=swimming)
