"""A swimmer of one's own: its file, the command that swims it, and what is refused."""

from __future__ import annotations

import copy
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fin_sim.ideal_2d.errors import StrokeError
from fin_sim.ideal_2d.swimmer_file import Spring, read_swimmer, swimmer_from
from fin_sim.swim_command.command import main
from fin_sim.swim_command.swimmer import swim_swimmer

PAGE = Path(__file__).parents[2] / "docs" / "water.md"
THICK: dict[str, Any] = {
    "period": 2.0,
    "density": 1.0,
    "links": [
        {"name": "middle", "ellipse": [1.0, 0.5]},
        {
            "name": "front",
            "ellipse": [1.0, 0.5],
            "at": [1.2, 0.0],
            "own": [-1.2, 0.0],
            "angle": {"amplitude": -0.6, "phase": 1.5707963267948966},
        },
        {
            "name": "rear",
            "ellipse": [1.0, 0.5],
            "joined_to": "middle",
            "at": [-1.2, 0.0],
            "own": [1.2, 0.0],
            "angle": {"amplitude": 0.6},
        },
    ],
}


def changed(*path: Any, to: Any) -> dict[str, Any]:
    """Return the swimmer with one value changed; None takes it away."""
    content = copy.deepcopy(THICK)
    place: Any = content
    for key in path[:-1]:
        place = place[key]
    if to is None:
        del place[path[-1]]
    else:
        place[path[-1]] = to
    return content


def written(folder: Path, content: object) -> Path:
    path = folder / "swimmer.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def test_the_command_tells_the_net_motion_of_the_reference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fin_sim.ideal_2d.swimmer_picture._FRAMES", 6)  # each takes a tenth of a second to draw
    path = written(tmp_path, THICK)
    files = [str(tmp_path / name) for name in ("stroke.csv", "stroke.png", "stroke.gif")]
    arguments = ["--water", "ideal_2d", "--chain", str(path), "--json"]
    assert main([*arguments, "--csv", files[0], "--plot", files[1], "--animate", files[2]]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["dx"] == pytest.approx(0.136973641812, abs=1e-8)
    assert told["dy"] == pytest.approx(-0.0208055578474, abs=1e-8)
    assert told["dtheta"] == pytest.approx(0.0, abs=1e-10)
    assert told["speed"] == pytest.approx(told["distance"] / 2.0)
    assert told["links"] == ["middle", "front", "rear"]
    assert told["units"]["dx"] == "m"
    assert all(Path(file).stat().st_size > 1000 for file in files)
    last = Path(files[0]).read_text(encoding="utf-8").splitlines()[-1].split(",")
    assert float(last[1]) == pytest.approx(told["dx"], abs=1e-12)


def test_the_table_fits_a_narrow_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["--water", "ideal_2d", "--chain", str(written(tmp_path, THICK))]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("dtheta" in line for line in lines)
    assert max(map(len, lines)) <= 60


def test_the_swimmer_of_the_page_swims_as_the_page_says() -> None:
    text = PAGE.read_text(encoding="utf-8")
    block = re.search(r"```yaml\n(period:.*?)```", text, re.DOTALL)
    assert block
    swum = swim_swimmer(swimmer_from(yaml.safe_load(block[1])))
    assert f"{swum.figures['dx']:.4f} m forward" in text


def test_a_fin_on_an_ellipse_is_sealed_and_bends_by_its_spring() -> None:
    content = {
        "strokes": 2,
        "links": [
            {"ellipse": [0.07, 0.0225]},
            {"fin": 0.03, "mass": 0.01, "angle": {"amplitude": 0.2}},
            {"fin": 0.05, "spring": {"stiffness": 0.2, "damping": 0.002}},
        ],
    }
    swimmer = swimmer_from(content)
    assert [member.sealed for member in swimmer.linkage.members] == [False, True, True]
    assert swimmer.joints[1] == Spring(0.2, 0.002, 0.0)
    swum = swim_swimmer(swimmer)
    assert np.max(np.abs(swum.angles[:, 1])) > 0.01
    assert swum.time[-1] == pytest.approx(2.0)
    assert swum.figures["strokes"] == 2


def test_a_joint_may_have_harmonics_and_an_offset() -> None:
    angle = {"offset": 0.1, "harmonics": [{"order": 2, "amplitude": 0.3, "phase": 0.5}]}
    joint = swimmer_from(changed("links", 1, "angle", to=angle)).joints[0]
    assert joint.at(np.array([0.2]))[0] == pytest.approx(0.1 + 0.3 * np.sin(0.9))  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "the file must be a mapping of density, links, period, strokes"),
        (changed("links", to=[]), "links must be a list of 2 to 12 links"),
        (changed("speed", to=1), "the file has the unknown key speed"),
        (changed("period", to=0.0), r"period = 0 is outside the allowed range"),
        (changed("links", 0, "ellipse", to=None), "link middle has no shape: give it one of ellipse, outline and fin"),
        (changed("links", 1, "fin", to=1.0), "link front has ellipse and fin"),
        (changed("links", 0, "at", to=[0, 0]), "link middle is the first, it has no joint: leave out at"),
        (
            changed("links", 1, "own", to=None),
            r"link front: own = None must be \[x, y\], m, where its joint is",
        ),
        (changed("links", 2, "joined_to", to="tail"), "link rear is joined_to tail: it must be a link before it"),
        (changed("links", 2, "name", to="front"), "links are named middle, front, front"),
        (changed("links", 1, "angle", to=None), "link front: its joint needs either angle, how it moves, or spring"),
        (changed("links", 1, "angle", to={"phase": 1.0}), "link front: angle has a phase without an amplitude"),
        (changed("links", 1, "angle", to={"amplitude": "x"}), "link front: amplitude must be a number, got 'x'"),
        (changed("links", 1, "ellipse", to=[1.0, 0.001]), "link front: an ellipse of semi-axes 1 and 0.001 m is more"),
        (changed("links", 1, "mass", to=-1.0), "link front: mass = -1"),
        (changed("links", 1, "own", to=[math.inf, 0.0]), r"link front: own = \[inf, 0.0\] must be \[x, y\]"),
        (changed("links", 1, "angle", to={"harmonics": [{"order": 2}]}), "link front: a wave has no amplitude"),
    ],
)
def test_a_file_that_describes_no_swimmer_is_refused(content: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        swimmer_from(content)


def test_an_outline_that_crosses_itself_is_told_with_file_and_link(tmp_path: Path) -> None:
    loop = [[float(np.cos(t)), float(np.sin(t) * np.cos(t))] for t in np.arange(21) * 2.0 * np.pi / 21]
    content = changed("links", 1, "ellipse", to=None)
    content["links"][1]["outline"] = loop
    path = written(tmp_path, content)
    with pytest.raises(ValueError, match=re.escape(f"{path}: link front: the outline crosses itself near")):
        read_swimmer(path)


def test_nothing_that_moves_is_refused() -> None:
    content = copy.deepcopy(THICK)
    for link in content["links"][1:]:
        link["angle"] = {"offset": 0.1}
    with pytest.raises(ValueError, match="no joint has an angle with waves: nothing moves"):
        swimmer_from(content)


def test_a_collision_ends_the_command_with_its_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, changed("links", 1, "angle", to={"amplitude": 2.5}))
    assert main(["--water", "ideal_2d", "--chain", str(path)]) == 1
    assert re.search(r"members 1 and 2 collide at t = 0\.\d+ s of the stroke", capsys.readouterr().err)
    with pytest.raises(StrokeError):
        swim_swimmer(read_swimmer(path))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "--chain swims in a plane ideal flow alone: add --water ideal_2d"),
        (("--water", "strip"), "add --water ideal_2d"),
        (("--water", "ideal_2d", "--frequency", "3"), "--chain holds every parameter: leave out --frequency"),
        (("--water", "ideal_2d", "--case", "a.json"), "--chain and --case both say what swims"),
    ],
)
def test_options_that_a_chain_has_not_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    assert main(["--chain", str(written(tmp_path, THICK)), *arguments]) == 2
    assert message in capsys.readouterr().err
