"""Files that people give to commands, and that are none: one line says which file, why, and no traceback is shown."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

import pytest

from support.processes import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SWIMS = str(ROOT / "tests/data/tail_actuated_fish_swims")
FITTED = str(ROOT / "ros2_ws/src/fin_optimizer/config/fitted_tail_actuated_fish.yaml")
BAD: dict[str, Callable[[Path], object]] = {
    "missing": lambda path: path,
    "empty": lambda path: path.touch(),
    "binary": lambda path: path.write_bytes(bytes(range(256))),
    "a list": lambda path: path.write_text("[1, 2]\n"),
    "a number": lambda path: path.write_text("5\n"),
    "a folder": lambda path: path.mkdir(),
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "huge": lambda path: path.write_bytes(b"a: [" + 4_000_000 * b"1,"),
}
# By command: the module of its main function, and its words; FILE is the one that is none.
COMMANDS = {
    "calibrate": ("fin_optimizer.commands.calibrate", ["--swims", SWIMS, "--settings", "FILE.yaml"]),
    "campaign": ("fin_optimizer.paper.campaign", ["--algorithm", "cma_es", "--space", "FILE.yaml"]),
    "enrich_bag": ("fin_optimizer.commands.enrich_bag", ["FILE.mcap"]),
    "export": ("fin_optimizer.commands.export", ["FILE"]),
    "export_fin": ("fin_optimizer.commands.export_fin", ["FILE"]),
    "predict": ("fin_optimizer.commands.predict", ["--swims", SWIMS, "--fish", "FILE.yaml"]),
    "recover_study": ("fin_optimizer.commands.recover_study", ["FILE"]),
    "repair_bags": ("fin_optimizer.commands.repair_bags", ["FILE.mcap"]),
    "report": ("fin_optimizer.commands.report", ["FILE"]),
    "score_bag": ("fin_optimizer.commands.score_bag", ["--settle", "1", "--duration", "2", "FILE.mcap"]),
    "show_study": ("fin_optimizer.commands.show_study", ["FILE"]),
    "swim --case": ("fin_sim.swim_command.command", ["--case", "FILE.json"]),
    "swim --chain": ("fin_sim.swim_command.command", ["--water", "ideal_2d", "--chain", "FILE.yaml"]),
    "swim --params-file": ("fin_sim.swim_command.command", ["--params-file", "FILE.yaml"]),
}
FISH, SETTINGS = "predict", "calibrate"
# Of the right form outside, not within: the command, the text, and what is said of it.
WRONG_WITHIN = [
    ("campaign", "search: 5\n", "search = 5 must be a mapping"),
    ("campaign", "search: {fin.lenght: {minimum: 1 cm, maximum: 2 cm}}\n", "did you mean fin.length"),
    ("campaign", "stock: {a: 5}\n", "a"),
    ("campaign", "search: {fin.length: {minimum: 1 cm, maximum: 9 m}}\n", "maximum of fin.length"),
    (FISH, "/**: 5\n", "/**"),
    (FISH, "/**: {ros__parameters: 5}\n", "ros__parameters of /** must be names with values, got 5"),
    (FISH, "/**: {ros__parameters: {}}\ncalibration: 7\n", "calibration must be names with values, got 7"),
    (FISH, "/**: {ros__parameters: {}}\ncalibration: {ros__parameters: [1]}\n", "must be names with values, got [1]"),
    (SETTINGS, "parameters: 5\n", "parameters must be names with values, got 5"),
    (SETTINGS, "parameters: {}\nfish: 7\n", "fish must be names with values, got 7"),
    ("swim --params-file", "/**: 5\n", "/** must be names with values, got 5"),
    (
        "swim --params-file",
        "/**: {ros__parameters: [1]}\n",
        "ros__parameters of /** must be names with values, got [1]",
    ),
]


def said(name: str, file: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command on a file, see that it says one line of it, and return that."""
    module, words = COMMANDS[name]
    assert import_module(module).main([word.replace("FILE", str(file.with_suffix(""))) for word in words]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1), err
    assert err.startswith(f"{name.split(maxsplit=1)[0]}: error: ")
    assert err.count(str(file)) == 1, err
    assert not any(word in err for word in ("Errno", "Error", "codec", "char 0", "attribute")), err
    return err


def test_a_file_that_is_none_is_named_once_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, (_, words) in COMMANDS.items():
        for kind, make in BAD.items():
            file = tmp_path / kind.replace(" ", "_") / next(word for word in words if "FILE" in word)
            file.parent.mkdir(exist_ok=True)
            if not file.exists():
                make(file)
            said(name, file, capsys)


@pytest.mark.parametrize(("name", "text", "why"), WRONG_WITHIN)
def test_a_file_with_something_wrong_in_it_is_named(
    name: str, text: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / next(word for word in COMMANDS[name][1] if "FILE" in word)
    file.write_text(text)
    assert why in said(name, file, capsys)


@pytest.mark.parametrize("kind", [kind for kind in BAD if kind != "missing"])
def test_a_swims_file_that_is_none_is_named(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "amplitude10_bias0_1.csv"
    BAD[kind](file)
    assert import_module("fin_optimizer.commands.predict").main(["--fish", FITTED, "--swims", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"predict: error: {file}"), err
    assert err.count("\n") == 1
    assert "codec" not in err
