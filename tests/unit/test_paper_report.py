"""What the campaign says of its runs follows from their tables."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_optimizer.paper.comparison import Row, markdown, published_curves, rows
from fin_optimizer.paper.experiments import SIMULATION, Campaign, Run, perform, planned_runs
from fin_sim.presets import preset

if TYPE_CHECKING:
    from fin_optimizer.paper.experiments import Table

CAMPAIGN = Campaign()
AREA = preset(SIMULATION).fin.area


def table(*swims: tuple[float, float], length: float = 0.08) -> Table:
    """Return the table of swims, each with E in GPa and a speed in cm/s, of fins of one length in m."""
    modulus, speed = np.array(swims).T
    return {
        "generation": np.zeros(len(speed)),
        "candidate": np.arange(len(speed), dtype=float),
        "young_modulus": modulus * 1e9,
        "length": np.full(len(speed), length),
        "height": np.full(len(speed), AREA / length),
        "speed": speed * 1e-2,
    }


def join(*tables: Table) -> Table:
    return {name: np.concatenate([one[name] for one in tables]) for name in tables[0]}


def row_of(quantity: str, **experiments: list[Table]) -> Row:
    """Return the row that starts so, of runs by experiment."""
    results = {Run(name, at, CAMPAIGN): one for name, runs in experiments.items() for at, one in enumerate(runs)}
    (found,) = (row for row in rows(results) if row.quantity.startswith(quantity))
    return found


def test_runs_that_miss_the_peak_are_counted_with_where_they_ended() -> None:
    curve = table((0.5, 1.0), (1.2, 2.6), (4.0, 2.0))
    runs = [table((1.2, 2.6)), table((0.5, 1.0), (3.0, 2.2)), table((1.21, 2.59)), table((4.0, 2.0))]
    row = row_of("hill climber", simulation=[curve], hill_climber=runs)
    assert row.remark.startswith("2 of 4 runs end within 1% of the highest speed known, 2.6 cm/s; 2 at 2 to 2.2 cm/s, ")
    assert "E 3 to 4 GPa." in row.remark
    assert row.ours.endswith("4 runs of 1 to 2 swims")


def test_runs_that_all_find_the_peak_are_told_so_and_nothing_of_others() -> None:
    row = row_of("genetic", genetic=[table((1.2, 2.6)), table((1.21, 2.6))])
    assert row.remark.startswith("2 of 2 runs end within 1% of the highest speed known, 2.6 cm/s. ")


def test_a_peak_that_only_the_curve_or_another_search_knows_counts() -> None:
    row = row_of("genetic", genetic=[table((1.2, 2.6))], hill_climber=[table((1.5, 2.7))])
    assert row.remark.startswith(
        "0 of 1 runs end within 1% of the highest speed known, 2.7 cm/s; 1 at 2.6 cm/s, E 1.2 "
    )


def test_runs_in_which_no_fin_swam_are_counted_and_spoil_no_mean() -> None:
    row = row_of("genetic", genetic=[table((1.2, 2.6)), table((1.2, math.nan))])
    assert row.remark.startswith("1 of 2 runs end within 1% of the highest speed known, 2.6 cm/s; in 1 no fin swam.")
    assert row.ours.startswith("1.2 +- 0 GPa, 2.6 +- 0 cm/s, 2 runs")
    nothing = row_of("genetic", genetic=[table((1.2, math.nan))])
    assert nothing.ours == "no fin swam in 1 runs of 1 swims"
    assert "highest" not in nothing.remark


@pytest.mark.parametrize(
    ("peak", "says"),
    [
        ((0.9, 2.4), "100 % above and 71 % above in speed, the same and 53 % below in E"),
        ((1.9, 1.2), "the same and 14 % below in speed, 111 % above and the same in E"),
    ],
)
def test_the_simulations_peak_is_beside_the_papers_what_it_is(peak: tuple[float, float], says: str) -> None:
    curve = table((0.2, 0.5), peak, (5.0, 0.6))
    row = row_of("simulation", simulation=[curve])
    assert f"ours is {says}." in row.remark
    assert row.ours == f"{peak[1]:.2f} cm/s at {peak[0]:.2f} GPa"


def test_a_peak_at_an_end_of_the_range_is_told_so() -> None:
    assert row_of("model", model=[table((0.2, 3.0), (5.0, 2.0))]).ours == "3.00 cm/s at 0.20 GPa, an end of the range"
    assert row_of("model", model=[table((0.2, math.nan), (5.0, math.nan))]).ours == "no fin swam"


def test_the_ridge_is_told_by_its_ranges() -> None:
    short = table((0.5, 1.0), (1.0, 1.5), length=0.04)
    long = table((5.0, 2.0), (7.55, 2.2), length=0.14)
    row = row_of("best E of the 14 cm fin", landscape=[join(short, long)])
    assert row.ours == "2.20 cm/s at 7.55 GPa"
    assert row.remark.startswith("E the same; 100% of the fastest of all. The fastest fin of each length, 4 to 14 cm, ")
    assert "swims 1.5 to 2.2 cm/s, with hinges of 0.001733 to 0.002812 N m." in row.remark
    slow = row_of("best E of the 14 cm", landscape=[join(short, table((5.0, 0.3), (7.55, math.nan), length=0.14))])
    assert slow.remark.startswith("E 34 % below; 20% of the fastest of all. ")
    none = row_of("best E of the 14 cm", landscape=[join(short, table((5.0, math.nan), length=0.14))])
    assert none.ours == "no fin swam"
    assert "swims 1.5 cm/s" in none.remark


def test_what_the_searches_found_is_beside_what_the_papers_found() -> None:
    row = row_of("genetic", genetic=[table((1.9, 1.4)), table((2.1, 1.4))])
    assert row.remark.endswith("E: beside Raja Mohamed & Raviraj 25 % above, beside Clark et al. 2012 5 % above.")
    assert (row.paper, row.clark) == ("1.6 GPa", "1.9 GPa")
    row = row_of("hill climber", hill_climber=[table((1.7, 1.4)), table((1.7, math.nan))])
    assert row.remark.endswith("E: beside Raja Mohamed & Raviraj the same.")
    assert row.clark == "not stated"


def test_the_shape_is_beside_the_papers_optimum() -> None:
    row = row_of("shape", shape=[table((7.55, 1.1), length=0.14), table((0.755, math.nan), length=0.04)])
    assert "E the same, length the same, speed 50 % below." in row.remark


def test_a_curve_is_as_far_from_the_published_points_as_all_of_them_are() -> None:
    points = published_curves()["model"]
    swims = zip(points.modulus * 1e-9, points.speed * 1e2 + 0.5, strict=True)
    far = table((0.1, 1.0), *swims, (6.0, 1.0))
    assert row_of("model", model=[far]).remark.endswith("from 12 points read off the figure of 2012: 0.5 cm/s.")
    assert "from 10 points" in row_of("model", model=[table((0.5, 4.0), (5.0, 4.0))]).remark  # the others lie outside


def test_the_fin_that_the_later_paper_states_is_told_to_have_no_peak_only_where_it_has_none() -> None:
    rising = row_of("fin of", stated_fin=[table((0.2, 0.5), (2.0, 1.0), (5.0, 2.0))])
    assert rising.ours == "2.00 cm/s at 5.00 GPa, the end of the range"
    assert rising.remark.startswith("Faster the stiffer")
    peaked = row_of("fin of", stated_fin=[table((0.2, 0.5), (2.0, 1.0), (5.0, 0.9))])
    assert peaked.ours == "1.00 cm/s at 2.00 GPa"
    assert peaked.remark.startswith("Preset")
    assert row_of("fin of", stated_fin=[table((0.2, math.nan))]).ours == "no fin swam"


def test_the_page_states_what_the_experiments_give() -> None:
    """Of those that take a hundred swims; the others' rows take half a million."""
    page = (Path(__file__).parents[2] / "docs" / "paper.md").read_text(encoding="utf-8")
    results = {run: perform([run])[0] for run in planned_runs(CAMPAIGN, ["model", "simulation", "stated_fin"])}
    for line in markdown(CAMPAIGN, results).splitlines():
        assert line in page, f"docs/paper.md lacks {line}; `make campaign` writes runs/campaign/paper.md"
