"""Studies for the report: without a trial, without a score, with one, a typical one, and one of ten thousand trials."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

from fin_optimizer.report.simulated import Curve, Simulated
from fin_optimizer.report.study_facts import StudyFacts
from fin_optimizer.search.space import Choice, Dimension, Space, generator
from fin_optimizer.study.candidate import TrialRecord
from fin_optimizer.study.settings import Settings
from fin_optimizer.trial.result import Outcome

MODULUS = Dimension("fin.young_modulus", 0.5e9, 4e9, "Pa", log=True)
LENGTH = Dimension("fin.length", 0.05, 0.1, "m")
SHEET = Choice("fin.hinges", ("midpoint", "</script><b>$x_{"))
SPACE = Space((MODULUS, LENGTH, SHEET))
DETAILS = {"seed": 7, "search.algorithm": "random", "measurement.duration": 0.4, "measurement.settle": 0.1}
SETTINGS = Settings(SPACE, details=DETAILS)
NOON = datetime(2026, 1, 2, 12, tzinfo=UTC)


def trial(
    number: int,
    outcome: Outcome = Outcome.OK,
    score: float | None = 0.02,
    *,
    candidate: int | None = None,
    reason: str = "",
) -> TrialRecord:
    fin = number if candidate is None else candidate
    return TrialRecord(
        number=number,
        candidate=fin,
        values=SPACE.drawn(generator(3, fin)),
        outcome=outcome,
        reason=reason,
        measured={"mean_speed": score} if outcome is Outcome.OK and score is not None else {},
        spread=0.001 if outcome is Outcome.OK else None,
        samples=10,
        plant="/fish",
        bag=f"bags/trial_{number:04d}",
        started=NOON + timedelta(seconds=number),
        ended=NOON + timedelta(seconds=number + 1),
    )


def scored(count: int) -> list[TrialRecord]:
    return [trial(number, score=0.01 + 1e-6 * ((37 * number) % count)) for number in range(count)]


SIMULATED = Simulated(
    curves={LENGTH.name: Curve([0.05, 0.1], [0.01, math.nan]), SHEET.name: Curve(SHEET.choices, [0.01, 0.02])},
    map=None,
    again={0: 0.011, 1: 0.010, 2: 0.012, 3: math.nan},
    film={"rate": 25.0, "start": 0.0, "beat": 1.0, "body": [10, 5], "driven": [True], "frames": [[0] * 7, [1] * 7]},
    numbers=[("mean thrust", "2.3 mN")],
    is_the_plant=True,
)
EMPTY = StudyFacts("empty", SETTINGS, [])
WITHOUT_SCORE = StudyFacts("none", SETTINGS, [trial(0, Outcome.FAILED, reason="no velocity")])
ONE = StudyFacts("one", SETTINGS, scored(1))
TYPICAL = StudyFacts(
    "typical <&>",
    SETTINGS,
    [*scored(12), trial(12, Outcome.INFEASIBLE, reason='too <b>long</b> </script> "x"'), trial(13, Outcome.RUNNING)],
    {"plant": "simulator", "body.length": 0.14},
    {"version.numpy": "2"},
    "those of a bag",
    frozenset({"bags/trial_0000"}),
    SIMULATED,
)
TEN_THOUSAND = StudyFacts(
    "large", SETTINGS, [*scored(10_000), *(trial(n, Outcome.FAILED) for n in range(10_000, 10_900))]
)
