"""Mutation testing of the safety module: every small change of its code is noticed by its tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from fin_servo_driver import safety
from support.mutants import check_every_mutant, mutants

pytestmark = pytest.mark.long
TESTS = Path(__file__).with_name("test_safety.py")
EQUIVALENT = {
    "within_rate: elapsed <= 0.0 -> elapsed < 0.0": "no time gives a reach of 0, hence the same angle",
}
"""Mutants that do the same as the original, with the reason."""


def test_there_are_mutants_of_every_kind() -> None:
    names = {name.partition(":")[0] for name, _ in mutants(Path(safety.__file__).read_text(encoding="utf-8"))}
    assert names >= {"within_angle", "within_rate", "limit", "restart", "feed", "forget", "expired"}


@pytest.mark.timeout(1500)
def test_every_mutant_of_the_safety_module_is_killed_or_explained(tmp_path: Path) -> None:
    check_every_mutant(safety, [TESTS], EQUIVALENT, tmp_path)
