"""Simulated speeds that are kept: by all that they follow from, whole or not at all, and nothing else is read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fin_optimizer.search import kept_speeds
from fin_optimizer.search.kept_speeds import content_key, keep, kept

if TYPE_CHECKING:
    import pytest

SPEEDS = np.array([[0.02, 0.03], [0.04, np.nan]])


class Runs:
    """What makes a folder where it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __reduce__(self) -> tuple[object, ...]:
        return Path.mkdir, (self._folder,)


def test_what_is_kept_is_found_again_and_written_over(tmp_path: Path) -> None:
    path = tmp_path / "clouds" / "deep" / "one.npy"
    assert kept(path, (2, 2)) is None
    for speeds in (SPEEDS, 2.0 * SPEEDS):
        keep(path, speeds)
        assert np.array_equal(np.asarray(kept(path, (2, 2))), speeds, equal_nan=True)
    assert [each.name for each in path.parent.iterdir()] == ["one.npy"]


def test_a_file_of_anything_else_is_none(tmp_path: Path) -> None:
    path, folder = tmp_path / "one.npy", tmp_path / "made"
    keep(path, SPEEDS)
    assert kept(path, (4,)) is None
    np.save(path, SPEEDS.astype(np.float32))
    assert kept(path, (2, 2)) is None
    with path.open("wb") as file:
        np.savez(file, SPEEDS)
    assert kept(path, (2, 2)) is None
    np.save(path, np.array([Runs(folder)], dtype=object), allow_pickle=True)
    assert kept(path, (1,)) is None
    assert not folder.exists(), "what a file has pickled is never run"


def test_a_disk_that_refuses_is_no_loss(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    keep(tmp_path / "file" / "one.npy", SPEEDS)


def test_what_decides_has_a_name_of_its_own() -> None:
    many = np.arange(5000.0)
    other = np.where(many == 2500.0, -1.0, many)  # which numpy does not show
    found = {content_key(*each) for each in ((many,), (other,), (many, 1.0), (many, "1.0"), ())}
    assert len(found) == 5
    assert {len(name) for name in found} == {32}
    assert content_key(many, 1.0) == content_key(many.copy(), 1.0)


def test_another_simulator_has_other_names(monkeypatch: pytest.MonkeyPatch) -> None:
    before = content_key(SPEEDS)
    monkeypatch.setattr(kept_speeds, "simulator_digest", lambda: "another")
    assert content_key(SPEEDS) != before
