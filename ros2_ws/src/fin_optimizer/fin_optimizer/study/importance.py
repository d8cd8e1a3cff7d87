"""How much each searched parameter decides which candidates are good: Optuna's PED-ANOVA.

Optuna has three evaluators. fANOVA and the mean decrease of impurity need scikit-learn, which this project does not;
PED-ANOVA (Watanabe, Bansal & Hutter, IJCAI 2023) needs Optuna alone, and takes milliseconds where they take seconds.
"""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any

import optuna

from fin_optimizer.search.distributions import distributions

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from fin_optimizer.search.space import Space

optuna.logging.set_verbosity(optuna.logging.WARNING)

LEAST = 10
"""Scored candidates below which nothing is said: the best tenth, which PED-ANOVA compares with all, would be none."""


def importances(space: Space, tried: Sequence[Mapping[str, Any]], scores: Sequence[float]) -> dict[str, float]:
    """Return the share of each parameter in how far the best tenth of the candidates differs from all; the sum is 1.

    Args:
        space: Of two parameters or more.
        tried: Candidates with a score.
        scores: Theirs, more is better; those that are not finite are left out.

    Returns:
        The shares by name, the largest first; nothing of fewer than `LEAST` candidates, or where all are equally good.
    """
    known = [(values, score) for values, score in zip(tried, scores, strict=True) if math.isfinite(score)]
    if len(known) < LEAST or len({score for _, score in known}) == 1:
        return {}
    ranges = distributions(space)
    trials = [optuna.create_trial(params=dict(v), distributions=ranges, value=score) for v, score in known]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        study = optuna.create_study(direction="maximize", sampler=optuna.samplers.RandomSampler(seed=0))
        study.add_trials(trials)
        evaluator = optuna.importance.PedAnovaImportanceEvaluator()
        found = optuna.importance.get_param_importances(study, evaluator=evaluator)
    return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))
