"""What every search by name promises: legal candidates, the same ones resumed, and a peak that is found."""

from __future__ import annotations

import pickle
import subprocess
import sys
from functools import cache
from statistics import median
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.parameters import OPTIMIZER_PARAMETERS
from fin_optimizer.search.algorithms import ALGORITHMS, FOR_FINS, search
from fin_optimizer.search.space import Choice, Dimension, Evaluation, Space

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fin_optimizer.search.space import Scalar, Search

MODULUS = Dimension("fin.young_modulus", 1e8, 1e10, "Pa", log=True)
LENGTH = Dimension("fin.length", 0.04, 0.14, "m", step=0.005)
SEGMENTS = Dimension("fin.segments", 1, 20, whole=True)
HINGES = Choice("fin.hinges", ("between", "midpoint", "root"))
STEPS = {"fin.young_modulus": 0.5, "fin.length": 0.02, "fin.segments": 3.0}
NUMBERS = (MODULUS, LENGTH, SEGMENTS)
SQUARE = Space((Dimension("x", 0.0, 1.0), Dimension("y", -2.0, 2.0)))
FEW = {"genetic": 6, "nsga2": 6, "cma_es": 6}
"""Candidates of a generation in these tests: more than two generations are few."""


def long_and_soft(values: Mapping[str, Scalar]) -> str:
    soft = float(values["fin.young_modulus"]) < 1e9
    return "too soft for its length" if soft and float(values["fin.length"]) > 0.1 else ""


def mixed(name: str) -> Search:
    """Return a search over a range, steps, whole numbers and, where it can, choices, of which some cannot be."""
    dimensions = (*NUMBERS, HINGES) if ALGORITHMS[name].choices else NUMBERS
    return search(name, Space(dimensions, long_and_soft), 5, STEPS, FEW.get(name, 0))


def told(values: Mapping[str, Scalar], number: int) -> Evaluation:
    """Return a candidate's score and cost, some without, some that still swim."""
    if number % 7 == 3:
        return Evaluation(values, None, pending=number > 9)
    length, segments = float(values["fin.length"]), float(values["fin.segments"])
    between = values.get("fin.hinges") == "between"
    score = -((length - 0.08) ** 2) * 100.0 - 0.01 * abs(segments - 7) + 0.1 * between
    return Evaluation(values, score, (-1.0 - length,))


@cache
def undisturbed(name: str) -> list[Evaluation]:
    one = mixed(name)
    history: list[Evaluation] = []
    while len(history) < 18:
        history.append(told(one.propose(history), len(history)))
    return history


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_candidate_is_one_of_the_spaces(name: str) -> None:
    space = mixed(name).space
    for entry in undisturbed(name):
        assert space.check(entry.values) == entry.values
        assert long_and_soft(entry.values) == ""


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_search_begun_again_at_any_length_goes_on_with_the_same_candidates(name: str) -> None:
    whole = undisturbed(name)
    lengths = range(len(whole))
    assert [mixed(name).propose(whole[:length]) for length in lengths] == [entry.values for entry in whole]


@pytest.mark.parametrize("name", ALGORITHMS)
def test_what_was_asked_before_changes_nothing(name: str) -> None:
    whole = undisturbed(name)
    used = mixed(name)
    for length in (17, 4, 14):
        before = list(whole[:length])
        assert used.propose(before) == whole[length].values
        assert before == whole[:length]
    better = [*whole[:12], Evaluation(whole[12].values, 9.0, (-0.1,)), *whole[13:]]
    assert used.propose(better) == mixed(name).propose(better)
    assert pickle.loads(pickle.dumps(used)).propose(whole[:15]) == whole[15].values  # noqa: S301  (our own)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_another_seed_gives_other_candidates(name: str) -> None:
    space = mixed(name).space
    other = search(name, space, 6, STEPS, FEW.get(name, 0))
    assert other.propose([]) != undisturbed(name)[0].values


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_generation_is_waited_for_and_nothing_else(name: str) -> None:
    assert mixed(name).needed(8) == (6 if name in FEW else 0)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_candidates_are_proposed_also_where_none_has_a_score(name: str) -> None:
    one = mixed(name)
    history: list[Evaluation] = []
    while len(history) < 14:
        history.append(Evaluation(one.propose(history), None))
    assert len({tuple(entry.values.values()) for entry in history}) > 10


def peak(x: float, y: float) -> float:
    """Return a smooth hill with its top, 0, at (0.3, 1)."""
    return -((x - 0.3) ** 2) - (y - 1.0) ** 2 / 16.0


@cache
def regret(name: str, count: int, seed: int) -> float:
    """Return how far the best of ``count`` candidates is from the top."""
    one = search(name, SQUARE, seed, {"x": 0.1, "y": 0.4}, FEW.get(name, 0))
    history: list[Evaluation] = []
    while len(history) < count:
        values = one.propose(history)
        history.append(Evaluation(values, peak(values["x"], values["y"])))
    return -max(entry.score for entry in history if entry.score is not None)


@pytest.mark.parametrize(
    ("name", "count", "most"),
    [
        ("gp", 16, 1e-4),
        ("tpe", 60, 3e-3),
        ("cma_es", 90, 1e-3),
        ("nsga2", 90, 1e-3),
        ("genetic", 90, 1e-3),
        ("hill_climber", 60, 2e-3),
        ("quasi_random", 60, 1e-2),
    ],
)
def test_a_smooth_peak_is_found_within_so_many_candidates(name: str, count: int, most: float) -> None:
    """The other ones' budgets are theirs; drawn evenly, half of all attempts with 60 end farther off than 4e-3."""
    found = [regret(name, count, seed) for seed in range(3)]
    assert median(found) < most
    if name != "quasi_random":
        assert median(found) < median(regret("random", count, seed) for seed in range(15))


@pytest.mark.parametrize(
    ("name", "dimensions", "objectives", "message"),
    [
        (
            "cma_es",
            (*NUMBERS, HINGES),
            1,
            r"cma_es cannot choose \(fin.hinges\): for choices use hill_climber,",
        ),
        ("cma_es", NUMBERS, 2, "cma_es knows one objective only: for several use hill_climber, tpe, gp, nsga2"),
        ("genetic", (*NUMBERS, HINGES), 2, "genetic knows one objective only: for several use hill_climber, tpe, gp"),
        ("cma_es", (MODULUS,), 1, "CMA-ES needs at least 2 parameters"),
    ],
)
def test_what_a_search_cannot_do_is_refused_with_those_that_can(
    name: str, dimensions: tuple[Dimension | Choice, ...], objectives: int, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        search(name, Space(dimensions), 1, STEPS, objectives=objectives)


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_seed_that_cannot_be_is_refused(name: str) -> None:
    assert search(name, Space(NUMBERS), 0, STEPS).propose([]).keys() == STEPS.keys()
    with pytest.raises(ValueError, match="seed = -1"):
        search(name, Space(NUMBERS), -1, STEPS)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("hill_climber", "HillClimber"),
        ("genetic", "GeneticAlgorithm"),
        ("cma_es", "CmaEs"),
        ("tpe", "Tpe"),
        ("gp", "GpSearch"),
        ("nsga2", "Nsga2"),
        ("random", "RandomSearch"),
        ("quasi_random", "QuasiRandom"),
    ],
)
def test_each_name_is_its_own_search(name: str, kind: str) -> None:
    made = search(name, Space(NUMBERS), 1, STEPS)
    assert type(getattr(made, "search", made)).__name__ == kind


def test_a_study_may_name_every_search() -> None:
    assert list(OPTIMIZER_PARAMETERS["search.algorithm"].choices) == [*ALGORITHMS, *FOR_FINS]


@pytest.mark.parametrize(
    ("name", "population", "size"),
    [("nsga2", 0, 20), ("nsga2", 8, 8), ("genetic", 0, 100), ("genetic", 7, 7), ("cma_es", 0, 7), ("cma_es", 9, 9)],
)
def test_the_population_is_the_searches_own_unless_given(name: str, population: int, size: int) -> None:
    made = search(name, Space(NUMBERS), 1, STEPS, population)
    assert [made.needed(size - 1), made.needed(size)] == [0, size]


def test_the_hill_climber_loads_nothing_that_takes_its_time() -> None:
    """A study with it begins at once: what the others want is loaded with them."""
    code = (
        "import sys; from fin_optimizer.search.algorithms import search; "
        "from fin_optimizer.search.space import Dimension, Space; "
        "search('hill_climber', Space((Dimension('x', 0.0, 1.0),)), 1, {'x': 0.1}); "
        "print(*[name for name in ('scipy', 'optuna', 'cmaes', 'threadpoolctl') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
