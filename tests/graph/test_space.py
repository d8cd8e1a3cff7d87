"""A study over a space from a file, on the simulator: sheets, lengths and beats, gone on with from its own copy."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import pytest

from fin_optimizer.commands.export import export
from fin_optimizer.score.recorded import score_bag
from fin_optimizer.search.space_file import SPACE_FILE
from fin_optimizer.study.folder import read_settings

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from support.processes import StartedProcess

    Start = Callable[..., StartedProcess]

pytestmark = pytest.mark.graph
SPACE = """
search:
  fin.length: {minimum: 50 mm, maximum: 120 mm, step: 5 mm}
  gait.frequency: {minimum: 0.8 Hz, maximum: 2.5 Hz}
stock:
  PET_0.35: {material: PET, thickness: 0.35 mm, sheet: [210 mm, 297 mm]}
  offcut: {young_modulus: 2.31 GPa, spread: 0.09 GPa, density: 1190, thickness: 0.30 mm, sheet: [90 mm, 45 mm]}
ties: {fin.area: 20 cm^2}
conditions: [fin.length >= 2.5 * fin.height]
"""
SHORT = ("measurement.duration:=1.5", "search.algorithm:=genetic", "search.population:=2")


def begin(start: Start, folder: Path, *arguments: str) -> StartedProcess:
    words = [word for each in (f"study_folder:={folder}", *arguments, *SHORT) for word in ("-p", each)]
    return start("fin_optimizer", "optimizer", "--ros-args", *words)


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "trials.csv").open(newline="") as file:
        return list(csv.DictReader(file))


SEARCHED = ("stock", "fin.length [m]", "gait.frequency [Hz]")


def test_sheets_lengths_and_beats_are_searched_and_gone_on_with_from_the_studys_copy(
    start: Start, tmp_path: Path
) -> None:
    file, folder = tmp_path / "mine.yaml", tmp_path / "study"
    file.write_text(SPACE, encoding="utf-8")
    start("fin_sim", "simulator", "--ros-args", "-p", "speed:=0.0")
    assert begin(start, folder, "trials:=1", f"space:={file}").wait(90) == 0
    file.write_text(SPACE.replace("2.5 *", "2.4 *"), encoding="utf-8")
    changed = begin(start, folder, "trials:=4", f"space:={file}")
    assert changed.wait(60) == 2
    assert "fin.length >= 2.5 * fin.height there and fin.length >= 2.4 * fin.height here" in changed.output()
    assert begin(start, folder, "trials:=4").wait(120) == 0
    assert (folder / SPACE_FILE).read_text(encoding="utf-8") == SPACE

    rows = table(folder)
    assert [row["outcome"] for row in rows] == ["OK"] * 4
    settings = read_settings(folder)
    for row in rows:
        scored, bag = score_bag(folder / row["bag"])
        assert repr(scored.value) == row["speed [m/s]"]
        sheet = settings.rules.stock[row["stock"]] if settings.rules is not None else None
        assert sheet is not None
        # What the plant says that it swam, and the gait that it was asked for.
        assert float(bag.metadata["fin.thickness"]) == sheet.thickness
        assert float(bag.metadata["fin.young_modulus"]) == sheet.young_modulus
        assert bag.metadata["fin.length"] == row["fin.length [m]"]
        length, height = float(row["fin.length [m]"]), float(row["fin.height [m]"])
        assert length * height == pytest.approx(20e-4)
        assert length >= 2.5 * height
        assert f"frequency={row['gait.frequency [Hz]']}," in bag.metadata["gait.joint_1"]
    written = [path.name for path in export(folder, tmp_path / "tables")]
    assert written == ["study.csv", "study.parquet"]
    head = (tmp_path / "tables" / "study.csv").read_text(encoding="utf-8").splitlines()[0]
    assert all(name in head for name in SEARCHED)


def test_a_space_in_which_nothing_can_be_ends_the_optimiser_before_anything_is_written(
    start: Start, tmp_path: Path
) -> None:
    file, folder = tmp_path / "mine.yaml", tmp_path / "study"
    file.write_text(SPACE.replace("conditions: [", "conditions: [fin.length <= 45 mm, "), encoding="utf-8")
    refused = begin(start, folder, f"space:={file}")
    assert refused.wait(90) == 2
    assert "of 2000 candidates drawn from the space none can be" in refused.output()
    assert "fail the condition fin.length <= 45 mm" in refused.output()
    assert not folder.exists()
