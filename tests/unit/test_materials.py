"""The table of materials: ranges with sources, fins named by material."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest

import fin_sim
from fin_plant.fin import Fin
from fin_sim import materials_command
from fin_sim.materials import damping_time, material, materials
from fin_sim.swim import swim
from fin_sim.swim_command.command import main as swim_main
from fin_sim.swim_command.plan import SwimPlan

WANTED = [
    *("LDPE", "HDPE", "PP", "PET", "PMMA", "ABS", "PC", "POM", "nylon", "VeroWhite"),
    *("TangoBlackPlus", "DM9895", "DM9870", "DM8520", "DM8510"),
]


@pytest.mark.parametrize("key", WANTED)
def test_material_states_its_ranges_with_their_sources(key: str) -> None:
    entry = material(key)
    assert entry.name
    assert entry.modulus_source
    assert entry.density_source
    assert 800.0 < entry.density[0] <= entry.density[1] < 1500.0
    if entry.young_modulus is None:
        assert "No modulus" in entry.modulus_source
    else:
        assert 5e5 < entry.young_modulus[0] < entry.young_modulus[1] < 1e10


@pytest.mark.parametrize("key", WANTED)
def test_source_is_one_that_the_file_names_or_says_that_there_is_none(key: str) -> None:
    text = (Path(fin_sim.__file__).parent / "materials.yaml").read_text(encoding="utf-8")
    named = set(re.findall(r"^#   (\w+)  ", text, re.MULTILINE)) | {"greensutra", "No"}
    for source in (material(key).modulus_source, material(key).density_source):
        assert re.match(r"\w+", source)[0] in named, source  # type: ignore[index]


@pytest.mark.parametrize("key", [key for key in WANTED if material(key).young_modulus])
def test_range_of_stiffness_gives_a_range_of_speeds(key: str) -> None:
    soft, stiff = material(key).fins(Fin())
    assert (soft.young_modulus, stiff.young_modulus) == material(key).young_modulus
    slow, fast = sorted(swim(fin, duration=3.0).mean_speed for fin in (soft, stiff))
    assert 0.0 <= slow < fast


def test_hardness_is_converted_by_the_two_formulas_named() -> None:
    def gent(shore: float) -> float:
        return 0.0981e6 * (56.0 + 7.62336 * shore) / (0.137505 * (254.0 - 2.54 * shore))

    def ruess(shore: float) -> float:
        return 1e6 * math.pow(10.0, 0.0235 * shore - 0.6403)

    for key, hardness in (("TangoBlackPlus", (26, 28)), ("DM9870", (68, 72)), ("DM9895", (92, 95))):
        values = [formula(shore) for formula in (gent, ruess) for shore in hardness]
        stated = material(key).young_modulus
        assert stated is not None
        assert stated[0] == pytest.approx(min(values), rel=0.05)
        assert stated[1] == pytest.approx(max(values), rel=0.05)


def test_material_is_found_in_any_case_and_a_near_miss_is_told() -> None:
    assert material("verowhite").key == "VeroWhite"
    with pytest.raises(ValueError, match=r"material 'NYLONS' is not in the table: did you mean nylon"):
        material("NYLONS")


def test_loss_of_a_material_becomes_the_damping_time_of_its_frequency() -> None:
    assert damping_time(0.57, 0.9) == pytest.approx(0.1008, rel=1e-3)
    assert damping_time(0.57, 1.8) == pytest.approx(0.0504, rel=1e-3)
    plan = SwimPlan({}, frequency=2.0, loss_factor=0.13)
    assert plan.fin().damping_time == pytest.approx(0.13 / (2.0 * math.pi * 2.0))
    assert SwimPlan({"fin.damping_time": 0.03}, frequency=2.0).fin().damping_time == 0.03
    with pytest.raises(ValueError, match="frequency = 0 Hz"):
        damping_time(0.1, 0.0)


def test_more_loss_slows_a_fin_cut_from_the_material(capsys: pytest.CaptureFixture[str]) -> None:
    def powers(*arguments: str) -> list[float]:
        assert swim_main(["--material", "LDPE", "--duration", "3", "--json", *arguments]) == 0
        return [row["mean_servo_power"] for row in json.loads(capsys.readouterr().out)]

    assert powers() == pytest.approx(powers("--fin.damping_time", str(0.13 / (2.0 * math.pi * 0.9))))
    assert powers() != pytest.approx(powers("--fin.damping_time", "0"))


def test_material_without_a_modulus_cannot_be_cut() -> None:
    with pytest.raises(ValueError, match=r"give fin\.young_modulus"):
        material("DM8510").fins(Fin())


def test_every_material_is_asked_for_by_a_test() -> None:
    assert sorted(materials()) == sorted(WANTED)


@pytest.mark.parametrize("columns", [60, 80])
def test_listing_has_every_material_with_its_numbers_and_sources(
    columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    assert materials_command.main([]) == 0
    *lines, file = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) < columns
    assert Path(file).is_file()
    assert re.search(r"^PP +1\.07 to 1\.72 +900 to 910 +0\.029$", "\n".join(lines), re.MULTILINE)
    words = " ".join(" ".join(lines).split())
    for entry in materials().values():
        for word in (
            f"{entry.key} ",
            entry.name,
            entry.modulus_source.rstrip("."),
            entry.density_source,
            entry.loss_source,
        ):
            assert word in words


def test_listing_as_json_has_si_units_and_null_for_what_nobody_states(capsys: pytest.CaptureFixture[str]) -> None:
    materials_command.main(["--json"])
    rows = {row["key"]: row for row in json.loads(capsys.readouterr().out)}
    assert list(rows) == list(materials())
    assert rows["PP"]["young_modulus"] == [1.07e9, 1.72e9]
    assert rows["PP"]["units"] == {"young_modulus": "Pa", "density": "kg/m^3"}
    assert rows["DM8510"]["young_modulus"] is None
