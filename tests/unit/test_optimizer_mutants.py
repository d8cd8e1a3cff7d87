"""Mutation testing of what decides a study: every small change of its code is noticed by its tests, or explained."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from support.mutants import check_every_mutant
from support.source_tree import SOURCE

pytestmark = pytest.mark.long
HERE = Path(__file__).parent
DEB = (
    "test_constrained_searches.py::test_what_meets_all_is_better_than_what_misses_any_and_less_missed_is_better",
    "test_constrained_searches.py::test_a_generation_is_ranked_likewise_and_equals_stay_equal",
    "test_constrained_searches.py::test_parents_are_those_that_meet_the_constraints",
    "test_constrained_searches.py::test_excesses_pass_a_search_by_generations_and_a_fin_without_a_score_has_none",
    "test_constrained_searches.py::test_a_number_that_is_none_is_refused",
)
"""What the searches do under constraints."""
FRONT = "test_known_numbers.py::test_each_fin_of_the_pareto_front_is_a_parent_as_often"
# The files that decide, each with its tests, the quickest first.
TESTS = {
    "goals": ["test_goals.py"],
    "search/space": ["test_search.py", *DEB, "test_space.py"],
    "search/hill_climber": ["test_search.py", *DEB, FRONT, "test_space.py"],
    "search/one_by_one": ["test_one_by_one.py", *DEB],
    "search/genetic": ["test_genetic.py", *DEB, "test_space.py"],
    "search/algorithms": [
        "test_cloud_search.py::test_a_study_names_it_and_two_objectives_are_refused",
        "test_searches.py",
    ],
    "search/many": [
        "test_many.py",
        "test_space_campaign.py::test_candidates_as_columns_are_what_a_plant_is_sent",
        "test_space_campaign.py::test_every_name_that_a_space_can_have_is_a_column",
    ],
    "search/distributions": ["test_space.py"],
    "search/conditions": ["test_conditions.py"],
    "search/names": ["test_names_stock_and_ties.py"],
    "search/stock": ["test_names_stock_and_ties.py"],
    "search/ties": ["test_names_stock_and_ties.py"],
    "search/rules": ["test_rules.py"],
    "search/space_file": [
        f"test_space_file.py::test_{name}"
        for name in (
            "each_form_of_a_dimension_is_read",
            "sheets_are_the_first_that_is_searched_and_give_what_a_tie_may_not_set",
            "points_of_a_profile_begin_halfway_between_root_and_tip_and_leave_the_start_as_it_was",
            "a_profile_of_many_heights_is_searched_at_even_places",
            "stock_may_lie_in_a_file_beside_it",
            "a_file_that_is_not_there_is_told",
            "three_names_at_most_are_proposed",
            "a_slip_is_refused_with_its_numbers",
        )
    ],
    "search/features": [
        "test_gp.py::TestFeatures",
        "test_gp.py::test_sheets_that_are_alike_by_stiffness_thickness_and_density_are_near_each_other",
    ],
    "search/gaussian_process": ["test_gaussian_process.py"],
    "search/gp": [
        "test_gp.py::test_the_likelihood_is_climbed_with_the_best_scores_and_some_others_from_several_starts",
        "test_gp.py::test_the_best_is_the_one_that_is_surely_so",
        "test_gp.py::test_equal_scores_are_no_reason_to_divide_by_nothing",
        "test_gp.py::test_what_failed_is_as_bad_as_the_worst_and_what_swims_is_as_it_is_expected",
        "test_gp.py::test_the_best_is_one_that_meets_the_constraints_and_each_has_a_process",
        "test_gp.py::test_climbs_begin_near_the_best_that_meet_the_constraints",
        "test_gp.py::test_candidates_are_drawn_everywhere_and_near_the_best",
        "test_gp.py::test_a_promise_is_what_is_improved_and_how_likely_each_constraint_is_met",
        "test_gp.py::test_the_most_promising_of_a_pool_are_climbed_from_and_the_best_end_or_start_is_taken",
        "test_gp.py::test_a_climb_goes_round_while_it_leads_on_and_there_are_values_to_change",
        "test_gp.py::test_a_climb_stops_where_the_space_refuses_its_end",
        "test_gp.py::test_weighted_scores_are_costs_as_shares_of_the_front",
        "test_gp.py::test_where_the_front_is_one_fin_or_none_costs_are_shares_of_all_that_is_known",
        "test_gp.py::test_one_objective_is_the_score_itself",
        "test_gp.py::test_of_very_many_the_best_and_the_latest_are_modelled",
        "test_gp.py::test_what_is_next_to_what_was_tried_is_as_good_as_tried_and_a_step_is_not",
        "test_gp.py::test_of_few_values_the_most_promising_that_can_be_is_taken",
        "test_gp.py::test_a_climb_leads_up",
        "test_gp.py::test_halfway_between_two_fins_that_are_alike_most_is_promised",
        "test_gp.py::test_what_was_not_tried_is_tried_before_anything_again",
        "test_gp.py::test_before_three_have_a_score_nothing_is_modelled",
        "test_gp.py::test_the_first_candidates_are_spread_over_the_space",
        "test_searches.py::test_a_seed_that_cannot_be_is_refused[gp]",
        "test_searches.py::test_a_generation_is_waited_for_and_nothing_else[gp]",
    ],
    "search/nsga2": ["test_nsga2.py"],
    "search/pareto": [
        "test_pareto.py",
        "test_constrained_searches.py::test_the_front_is_what_none_beats_in_every_objective",
    ],
    "search/quasi_random": ["test_spread_and_tpe.py", "test_searches.py"],
    "search/random_search": [
        "test_spread_and_tpe.py::test_random_candidates_are_drawn_evenly_each_by_itself",
        "test_searches.py::test_a_seed_that_cannot_be_is_refused[random]",
        "test_searches.py::test_a_generation_is_waited_for_and_nothing_else[random]",
    ],
    "search/tpe": [
        "test_spread_and_tpe.py",
        "test_searches.py::test_a_seed_that_cannot_be_is_refused[tpe]",
        "test_searches.py::test_a_generation_is_waited_for_and_nothing_else[tpe]",
    ],
    "search/cma_es": ["test_genetic.py", "test_space.py"],
    "search/cloud": [
        f"test_cloud_search.py::test_{name}"
        for name in (
            "weights_follow_bayes",
            "a_belief_has_the_moments_of_its_mixture",
            "as_many_fish_count_as_are_to_by_a_power_of_their_likelihood",
            "neighbours_weigh_by_bayes_or_are_as_many_as_are_to_count",
            "what_lies_around_fish_that_are_near_is_a_gaussian_narrower_than_they_are_spread",
            "fins_are_alike_by_their_distance",
            "fish_that_are_all_most_unlikely_count_as_they_are_to_each_other",
            "places_are_drawn_evenly_by_their_weights",
            "a_fin_on_which_all_fish_agree_teaches_nothing",
            "expected_regret_is_that_of_the_mixture",
            "gains_are_the_integral_over_what_a_trial_may_tell",
        )
    ],
    "search/kept_speeds": ["test_kept_speeds.py"],
    "plan": [
        "test_plan.py",
        "test_space_file.py::test_the_short_form_beside_a_file_is_refused",
        "test_space_file.py::test_a_study_goes_on_with_its_copy_and_refuses_another_file",
    ],
    "thinking": ["test_thinking.py"],
    "score/swim": ["test_swim_score.py", "test_measured.py"],
    "score/measured": ["test_measured.py", "test_swim_score.py"],
    "score/mean_speed": ["test_score_limits.py", "test_score.py"],
    "trial/trial": ["test_trial.py"],
    "trial/phases": ["test_trial.py"],
    "study/candidate": ["test_candidate.py", "test_study_goals.py"],
}
SWIM_A_CLOUD = {f"search/{name}" for name in ("cloud_search", "plausible", "told")}
"""Whose tests swim many fish, 10 s a mutant. Most numbers are of how long it looks (how many fish and fins, when the
cloud is drawn anew), and others find fins that are as good: `make bench-search` judges them. `told` is words alone."""
LARGEST = {
    "search/space": 60,
    "search/genetic": 60,
    "search/features": 30,
    "search/gaussian_process": 40,
    "search/nsga2": 40,
    "search/pareto": 40,
    "search/tpe": 30,
    "search/cma_es": 60,
    "score/mean_speed": 170,
    "trial/phases": 140,
}
"""How many mutants are tried, where there are too many for all: a drawn but fixed choice."""
TABLES = {"trial/phases": ["PHASES"]}
"""Tables outside functions whose rows are changed too."""
EQUIVALENT = {
    "search/space": {
        "refused: if self.judge is _allowed: -> if False:": "to judge what is always allowed only takes its time",
    },
    "search/hill_climber": {
        "propose: pareto_front(history) if any((entry.others for entry in history)) else [] -> pareto_front(history)": (
            "of one objective the front is the best one, and to draw among one takes no random number"
        ),
        "gaussian_step: at + int(random.integers(1, dimension.count)) -> "
        "at - int(random.integers(1, dimension.count))": ("as far the other way round is each of the others as often"),
        "gaussian_step: random.random() < 1.0 / len(space.dimensions) -> "
        "random.random() <= 1.0 / len(space.dimensions)": "no draw is exactly that",
    },
    "search/many": {
        "columns_of: len(gait.joints) > 1 and set(searched) & set(names.WHOLE) -> "
        "len(gait.joints) > 1 or set(searched) & set(names.WHOLE)": "one by one is right too, it only takes its time",
        "columns_of: len(gait.joints) > 1 -> len(gait.joints) >= 1": "likewise",
        "columns_of: True -> False": "there are as many columns as parameters",
    },
    "search/conditions": {
        "refusal: True -> False": "between so many values there is one sign less",
        "met: True -> False": "between so many values there is one sign less",
        "_power: None -> 1.0": "neither is a whole number",
        "_name: None -> 1.0": "the names are kept in their order; nothing is kept beside them",
    },
    "search/rules": {
        "_numbers: True -> False": "a row has as many numbers as there are columns",
        "refusal: _numbers(parameters, fin, gait) if self.conditions else {} -> _numbers(parameters, fin, gait)": (
            "what nobody asks for only takes its time"
        ),
    },
    "search/space_file": {
        "_choice: 'Scalar' -> 'another'": "a type's name is for who reads it",
    },
    "search/stock": {
        "parameters: True -> False": "there are three of each",
        "refusal: True -> False": "a sheet has two edges, and so has a fin",
    },
    "search/algorithms": {
        "_can: not choices -> choices": (
            "the one that cannot choose has one objective only: it is in no list of those that can"
        ),
    },
    "search/features": {
        "__init__: True -> False": "both are of each parameter",
    },
    "search/gaussian_process": {
        "log_improvement_with_slope: variance <= _SMALLEST_VARIANCE -> variance < _SMALLEST_VARIANCE": (
            "no variance is exactly that"
        ),
        "predict: False -> True": "what is not finite was refused before: to look again only takes its time",
        "predict_with_slope: False -> True": "what is not finite was refused before: to look again only takes its time",
    },
    "search/gp": {
        "_single_scores: costs > 1.0 -> costs >= 1.0": "both are 1 there",
        "propose: 1 -> 2": "of so few fins two threads make the same sums",
        "_pool: unit[random.integers(len(unit), size=_NEAR)] "
        "+ distance * random.standard_normal((_NEAR, unit.shape[1])) -> "
        "unit[random.integers(len(unit), size=_NEAR)] "
        "- distance * random.standard_normal((_NEAR, unit.shape[1]))": ("as far the other way is as likely"),
        "_limits: True -> False": "each fin with a score has all excesses",
        "_new: np.abs(own[:, None] - others) < _SAME -> np.abs(own[:, None] - others) <= _SAME": (
            "no place is exactly that far"
        ),
        "_new: True -> False": "there is a column a parameter",
        "_most_promising: 1.0 -> 2.0": "where all scores are alike each is 0, whatever it is divided by",
    },
    "search/nsga2": {
        "_crossed: 1.0 -> 2.0": "the spread ends at the bound: what lies beyond it is rounding",
        "propose: len(made) >= self.population -> len(made) > self.population": "more are drawn, none taken",
        "_selected: if len(order) >= self.population: -> if False:": "what comes after them is cut off anyway",
        "_selected: len(order) >= self.population -> len(order) > self.population": "likewise",
        "spread: drawn * alpha <= 1.0 -> drawn * alpha < 1.0": "both formulas give 1 there",
    },
    "search/tpe": {
        "propose: None -> 1.0": "of the trial under way Optuna reads neither value nor times",
        "_new_trial: list(entry.objectives[:self.objectives]) if scored else None -> "
        "list(entry.objectives[:self.objectives])": "of trials without a score no values are read",
        "_new_trial: None -> 1.0": "what is read are the values; the times are not",
    },
    "search/quasi_random": {
        "_make: 2 -> 3": "points that are made beforehand change none",
        "_make: len(made) < wanted -> len(made) <= wanted": "likewise",
        "propose: 1 -> 2": "points are made in blocks: one more than wanted changes none",
        "_make: 0 -> 1": "of what was refused: blocks are counted, one point more is none; the sequence's has a test",
    },
    "search/pareto": {
        "front: -1 -> 1": "no later point dominates one before, whichever objective is the first to be sorted by",
        "ranks: _plane_ranks(objectives) if objectives.shape[1] == _PLANE else _general_ranks(objectives) -> "
        "_general_ranks(objectives)": "both find the same fronts, the one in less time",
    },
    "search/genetic": {
        "propose: 1 -> 2": "two genes can be cut in one place only; the first cut of three has a test of its own",
        "mutated: if not rows.size: -> if False:": "a redraw of nothing changes nothing, it only takes its time",
        "_stepped: if not rows.size: -> if False:": "likewise",
        "_stepped: random.random(len(parents)) < 1.0 / len(space.dimensions) -> "
        "random.random(len(parents)) <= 1.0 / len(space.dimensions)": "no draw is exactly that",
        "_stepped: parents[:, column] + random.integers(1, dimension.count, len(parents)) -> "
        "parents[:, column] - random.integers(1, dimension.count, len(parents))": (
            "as far the other way round is each of the others as often"
        ),
    },
    "search/cloud": {
        "regret: slower <= NEAR -> slower < NEAR": "no draw misses by exactly that",
        "_softened: 0.0 -> 1.0": "the power is below 1: to look above only takes its time",
        "_softened: 40 -> 41": "forty halvings leave no digit to find",
        "_softened: 1.0 / np.sum(weights(math.exp(middle)) ** 2) >= fewest -> "
        "1.0 / np.sum(weights(math.exp(middle)) ** 2) > fewest": "no power leaves exactly so many",
        "drawn: self.logarithms[fish] + random.standard_normal((count, len(values))) @ spread.T -> "
        "self.logarithms[fish] - random.standard_normal((count, len(values))) @ spread.T": (
            "as far the other way is as likely"
        ),
        "belief: softened > _LEAST * softened.max() -> softened >= _LEAST * softened.max()": (
            "no weight is exactly that"
        ),
        "belief: _LEAST * softened.max() -> _LEAST / softened.max()": (
            "of fish with next to no weight a few more are left out, which changes no digit that counts"
        ),
        "belief: weights > weights.max() + math.log(_LEAST) -> weights >= weights.max() + math.log(_LEAST)": (
            "no weight is exactly that"
        ),
        "gains: logarithms[true, fin] + error -> logarithms[true, fin] - error": "as far the other way is as likely",
    },
    "search/kept_speeds": {
        "keep: '.npy.partial' -> 'another'": "what is half written has any name",
    },
    "search/cma_es": {
        "propose: True -> False": "what is shown and what was drawn come in pairs",
        "_tell: True -> False": "that there are as many scores as candidates was checked above",
        "_tell: 0.0 -> 1.0": "without any score all candidates are equal, whatever they count as",
    },
    "score/swim": {
        "start_of_swim: '' -> 'another'": "neither is a number",
        "refuse_folded: 0.0 -> 1.0": "a hinge at 1 rad is no folded one either",
    },
    "score/measured": {
        "energy_per_metre: self.mean_speed > 0.0 -> self.mean_speed >= 0.0": (
            "no mean is exactly 0: a speed that stays at 0 is refused before"
        ),
        "steady_speed: 'velocity' -> 'another'": "what velocity lacks was refused for the mean speed before",
        "steady_speed: 'no speed' -> 'another'": "likewise",
    },
    "score/mean_speed": {
        "_check_gaps: 0 -> 1": "a gap of one nanosecond",
        "__init__: super().__init__(reason) -> pass": "an exception keeps what it was made from before that",
        "_speed_before: stamps > start -> stamps >= start": "a usable sample at the start is one of those before",
        "_block_means: 0 -> 1": "one block is too few for all who ask, as none is",
        "_disturbed: window.end_ns - start < length -> window.end_ns - start <= length": "likewise",
        "_disturbed: means > rest -> means >= rest": "a mean of exactly that speed",
        "_disturbed: means.max() >= _STOPPED * rest -> means.max() > _STOPPED * rest": "likewise",
        "_disturbed: abs(means[most] - median) <= _CARRIED * abs(median) + _CARRIED_BY -> "
        "abs(means[most] - median) < _CARRIED * abs(median) + _CARRIED_BY": "likewise",
    },
    "trial/trial": {
        "__init__: 1 -> 2": "any place below 0 is before the first phase",
        "__init__: self._progress_at = 0.0 -> pass": "the first phase sets it before anybody asks",
        "__init__: 0.0 -> 1.0": "the first phase sets it before anybody asks",
        "has: 0 -> 1": "the first phase has no rule",
        "has: self._index >= 0 -> self._index > 0": "the first phase has no rule",
        "looks_up: frozenset() if self._index < 0 else PHASES[self._index].looks_up -> PHASES[self._index].looks_up": (
            "the last phase looks up nothing"
        ),
    },
    "trial/phases": {
        "same_value: list | tuple -> tuple": "a list is one already",
        "_wrong: '' -> 'another'": "neither is a value of a fin",
        "_not_at_start: 0.0 -> 1.0": "a tail without an angle is straight",
        "settle: course.window.start_ns if course.window else 0 -> course.window.start_ns": "a swim has a window",
        "measure: course.window.end_ns if course.window else 0 -> course.window.end_ns": "a swim has a window",
        "settle: 0 -> 1": "a swim has a window",
        "measure: 0 -> 1": "a swim has a window",
        "close the bag: 'reply' -> 'another'": "it is over at once",
        "close the bag: 'the bag was not closed' -> 'another'": "it is over at once",
    },
}
"""Mutants that do the same as the original, with the reason."""


def test_every_file_of_the_searches_is_among_those_that_are_changed() -> None:
    room = SOURCE / "fin_optimizer/fin_optimizer/search"
    files = {f"search/{path.stem}" for path in room.glob("[a-z]*.py")}
    assert files == {name for name in TESTS if name.startswith("search/")} | SWIM_A_CLOUD


@pytest.mark.timeout(1500)
@pytest.mark.parametrize("name", TESTS)
def test_every_mutant_is_killed_or_explained(name: str, tmp_path: Path) -> None:
    """Of the files in `LARGEST` as many as stand there, drawn with a fixed seed; of the others all."""
    module = importlib.import_module(f"fin_optimizer.{name.replace('/', '.')}")
    tests = [str(HERE / test) for test in TESTS[name]]
    check_every_mutant(
        module, tests, EQUIVALENT.get(name, {}), tmp_path, tables=TABLES.get(name, ()), largest=LARGEST.get(name, 400)
    )
