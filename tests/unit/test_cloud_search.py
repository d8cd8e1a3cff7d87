"""The choice of the next fin by a cloud of plausible fish."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fin_optimizer.search import cloud as cloud_module
from fin_optimizer.search import plausible
from fin_optimizer.search.algorithms import Swimming, search
from fin_optimizer.search.cloud import Cloud
from fin_optimizer.search.cloud_search import CloudSearch
from fin_optimizer.search.space import Choice, Dimension, Evaluation, Space, Values
from fin_plant.fin import Fin
from fin_plant.gait import PAPER_GAIT, Gait, sub_carangiform
from fin_sim.batch import swim_batch
from fin_sim.swim import PAPER_FISH

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
    each_another = np.array([[0.03, 0.06, 0.03], [0.036, 0.02, 0.02], [0.04, 0.03, 0.07]])
    cloud = Cloud(each_another, np.log([0.2, 0.5, 0.3]), PLACES, 0.15, 0.4)
    belief = cloud.belief(np.array([0]), np.array([0.036]))
    speeds = np.exp(belief.logarithms + 0.5 * belief.variance)
    outcomes = np.linspace(-8.0, 0.0, 20_001)
    expected = []
    for fin in range(3):
        variance = belief.variance[fin] + 0.15**2
        density = np.exp(-0.5 * (outcomes[:, None] - belief.logarithms[:, fin]) ** 2 / variance)
        best = np.max(density * belief.weights @ speeds, axis=1)
        expected.append(np.trapezoid(best, outcomes) / np.sqrt(2.0 * np.pi * variance) / belief.mean.max() - 1.0)
    found = np.mean([cloud.gains(belief, np.random.default_rng(seed)) for seed in range(300)], axis=0)
    assert found == pytest.approx(np.array(expected), abs=2.5e-3)
    assert max(expected) > 0.15


def test_of_very_many_fish_so_many_are_thought_through_by_their_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    def gains(*weights: float, drawn: int = 0) -> list[float]:
        one = Cloud(SPEEDS[: len(weights)], np.log(weights), PLACES, 0.05, 0.0)
        random = np.random.default_rng(3)
        random.random(drawn)
        return list(one.gains(one.belief(np.array([], dtype=np.intp), np.array([])), random))

    two, equal = gains(0.9, 0.1), gains(0.5, 0.5, drawn=1)
    monkeypatch.setattr(cloud_module, "_MOST", 2)
    assert gains(0.9, 0.1) == two
    assert gains(0.499995, 0.499995, 1e-5) == pytest.approx(equal), "the third is drawn once in 100 000 times"


def test_a_fish_far_less_likely_than_the_others_is_not_thought_through() -> None:
    one = Cloud(SPEEDS[:2], np.log([1.0, 5e-7]), PLACES, 0.05, 0.0)
    gains = one.gains(one.belief(np.array([], dtype=np.intp), np.array([])), np.random.default_rng(1))
    assert gains == pytest.approx(np.zeros(3), abs=1e-12)


def test_many_fish_that_are_all_as_likely_are_thought_through() -> None:
    one = Cloud(np.tile(two_fish().speeds, (750, 1)), np.zeros(1500), two_fish().places, 0.05, 0.0)
    gains = one.gains(one.belief(np.array([], dtype=np.intp), np.array([])), np.random.default_rng(1))
    assert gains == pytest.approx([0.035 / 0.03 - 1.0, 0.0, 0.035 / 0.03 - 1.0])


def test_places_are_drawn_evenly_by_their_weights() -> None:
    drawn = cloud_module._systematic(np.array([0.5, 0.25, 0.25]), 8, np.random.default_rng(1))
    assert drawn.tolist() == [0, 0, 0, 0, 1, 1, 2, 2]
    short = cloud_module._systematic(np.array([0.4, 0.4]), 4, np.random.default_rng(1))
    assert short.tolist() == [0, 0, 1, 1], "weights whose sum is less by rounding"


def test_fish_drawn_anew_stand_for_the_same_belief() -> None:
    random = np.random.default_rng(2)
    numbers, kinds = random.standard_normal((1500, 2)), np.zeros(1500, dtype=np.intp)

    def likelihood(rows: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-0.5 * ((rows[:, 0] - 1.5) / 0.2) ** 2))

    weights = likelihood(numbers) / likelihood(numbers).sum()
    fresh, fresh_kinds, importance = plausible.drawn_around(numbers, kinds, weights, 1500, 0.35, random)
    again = np.exp(importance) * likelihood(fresh)
    again /= again.sum()
    # Prior and likelihood are Gaussian: the mean of the first number is 1.5 / (1 + 0.2^2).
    assert again @ fresh[:, 0] == pytest.approx(1.5 / 1.04, abs=0.03)
    assert again @ fresh[:, 1] == pytest.approx(0.0, abs=0.1)
    assert 1.0 / np.sum(again**2) > 3.0 / np.sum(weights**2) / 4.0
    assert set(fresh_kinds.tolist()) <= set(range(len(plausible.KINDS)))


def test_speeds_of_plausible_fish_are_the_simulators() -> None:
    fins = plausible.Fins((Fin(), Fin(young_modulus=4e9, length=0.1)), (PAPER_GAIT, PAPER_GAIT), DURATION)
    kinds = np.array([0, 6], dtype=np.intp)
    speeds = plausible.speeds(fins, np.zeros((2, fins.numbers)), kinds)
    for row, kind in zip(speeds, kinds, strict=True):
        segments, hinges, reactive = plausible.KINDS[kind]
        built = [replace(fin, segments=segments, hinges=hinges) for fin in fins.fins]
        swims = swim_batch(built, PAPER_FISH, PAPER_GAIT, DURATION, reactive=reactive)
        assert row == pytest.approx(swims.mean_forward_speed, rel=2e-3)


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
