"""How far simulated speeds carry over to measured ones: the table of docs/reality-gap.md, worked out again."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from fin_optimizer.report.transfer import Transfer, transfer

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
TABLE = {
    "2012, printed fins of 1 mm, E at its middle, C_N 1.0": ("measured_fins_1mm.csv", "C_N", "1.0"),
    "2012, the same, C_N 4.6": ("measured_fins_1mm.csv", "C_N", "4.6"),
    "2014, the authors' simulation": ("later_fins.csv", "paper", "2014"),
    "2015, the authors' simulation": ("later_fins.csv", "paper", "2015"),
}


def pairs(file: str, column: str, value: str) -> tuple[list[float], list[float]]:
    """Return simulated and measured speeds, cm/s."""
    with (DATA / file).open(encoding="utf-8", newline="") as opened:
        rows = [row for row in csv.DictReader(opened) if row[column] == value]
    if file == "later_fins.csv":
        return [float(row["simulated_cm_s"]) for row in rows], [float(row["measured_cm_s"]) for row in rows]
    simulated = [0.5 * (float(row["U_low_cm_s"]) + float(row["U_high_cm_s"])) for row in rows]
    return simulated, [float(row["measured_cm_s"]) for row in rows]


def row(name: str, of: Transfer) -> str:
    """Return the row of the document."""
    assert of.bias is not None
    assert of.error is not None
    assert of.error_left is not None
    return f"| {name} | {of.count} | {of.rank:.2f} | {of.bias:+.0%} | {of.error:.0%} | {of.error_left:.0%} |"


@pytest.mark.parametrize("name", TABLE)
def test_the_table_of_the_document_follows_from_the_data(name: str) -> None:
    found = row(name, transfer(*pairs(*TABLE[name])))
    assert found in (ROOT / "docs" / "reality-gap.md").read_text(encoding="utf-8"), found


def test_a_simulator_that_is_off_by_one_factor_is_mended_by_it() -> None:
    found = transfer([2.0, 4.0, 6.0], [1.0, 2.0, 3.0])
    assert (found.rank, found.bias, found.error, found.error_left) == pytest.approx((1.0, 1.0, 1.0, 0.0))


def test_fins_that_did_not_swim_count_by_their_rank_only() -> None:
    found = transfer([0.5, 2.0, 4.0], [0.0, 1.0, 2.0])
    assert found.rank == pytest.approx(1.0)
    assert found.bias == pytest.approx(1.0)
    assert (found.count, found.error_left) == (3, None)
    backwards = transfer([-1.0, 1.0, 1.0], [1.0, 1.0, 1.0])
    assert (backwards.bias, backwards.error) == (0.0, 0.0)
    assert transfer([-1.0], [1.0]).error == pytest.approx(2.0), "an error of twice the speed is one, not none"
    assert transfer([1.0], [0.0]).text == "There are too few fins that differ for a rank correlation."
