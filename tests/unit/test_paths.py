"""A `~` is a home, also where no shell has said so."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from fin_plant.paths import given_path


def test_a_home_stands_at_the_start_of_a_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/homes/ann")
    assert given_path("~/x") == Path("/homes/ann/x")
    assert given_path("~") == Path("/homes/ann")
    assert given_path("~root/x") == Path("~root").expanduser() / "x"
    assert given_path("a/~/x~") == Path("a/~/x~")
    assert given_path("./~") == Path("./~")


def test_a_home_of_nobody_is_refused_and_no_folder_of_its_name_is_meant(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="~nobody_of_that_name is nobody's home here"):
        given_path("~nobody_of_that_name/x")
    parser = argparse.ArgumentParser()
    parser.add_argument("path", type=given_path)
    with pytest.raises(SystemExit):
        parser.parse_args(["~nobody_of_that_name"])
    assert "~nobody_of_that_name is nobody's home here" in capsys.readouterr().err
