"""README and the written pages say what the code says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_page_of_parameters_is_what_the_tables_give() -> None:
    script = (
        f"import sys; sys.path.insert(0, {str(ROOT / 'scripts')!r}); import write_parameters_page as w; print(w.page())"
    )
    written = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    page = (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8")
    assert page.strip() == written.strip(), "run `make pages`"


def test_the_readme_names_every_topic_with_its_type() -> None:
    topics = pytest.importorskip("fin_plant.topics", reason="needs the ROS wheels or a sourced ROS")
    for topic in topics.ALL_TOPICS:
        line = f"| `{topic.name}` | `{topic.type_name.replace('/msg/', '/')}` |"
        assert line in README, f"the README's table lacks {line}"


def test_every_file_that_the_readme_shows_is_there() -> None:
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        if not link.startswith("http"):
            assert (ROOT / link).is_file(), link


def test_every_parameter_in_the_readmes_table_exists() -> None:
    page = (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8")
    section = README.split("## Parameters")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (`[^|]+) \|", section, flags=re.MULTILINE)
    names = [name for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert len(names) > 10
    for name in names:
        full = f"search.young_modulus{name}" if name.startswith(".") else name
        assert f"| `{full}` |" in page, name
