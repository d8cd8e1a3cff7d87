"""What is kept of a simulator is another's as soon as its code or its tables are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import fin_plant
import fin_sim
from fin_sim.source_digest import simulator_digest

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("package", [fin_sim, fin_plant])
def test_python_and_tables_count_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: object
) -> None:
    monkeypatch.setattr(package, "__path__", [str(tmp_path)])
    found = [simulator_digest.__wrapped__()]
    for name, text in (("a.py", "a"), ("a.py", "b"), ("deep/b.py", "a"), ("c.yaml", "a"), ("deep/b.txt", "a")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
        found.append(simulator_digest.__wrapped__())
    assert len(set(found)) == 5
    assert found[-1] == found[-2]


def test_a_file_that_has_another_name_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fin_sim, "__path__", [str(tmp_path)])
    (tmp_path / "a.py").write_text("x", encoding="utf-8")
    before = simulator_digest.__wrapped__()
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert simulator_digest.__wrapped__() != before
