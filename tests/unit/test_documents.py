"""README and the written pages say what the code says."""

from __future__ import annotations

import ast
import json
import re
import shlex
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from fin_plant.gait import JointDrive
from fin_sim import case as case_files
from fin_sim.fish import Body, Link
from fin_sim.swim_command.command import main as swim_main

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SIMULATOR = (ROOT / "docs" / "simulator.md").read_text(encoding="utf-8")
CONFIG = ROOT / "ros2_ws" / "src" / "fin_sim" / "config"


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


def test_the_head_of_each_room_lists_its_files() -> None:
    heads = sorted((ROOT / "ros2_ws" / "src").glob("fin_*/fin_*/**/__init__.py"))
    rooms = [path.parent for path in heads if path.parent.name != "commands"]  # of which each is an executable
    assert len(rooms) > 20
    for room in rooms:
        head = ast.get_docstring(ast.parse((room / "__init__.py").read_text(encoding="utf-8"))) or ""
        files = {path.stem for path in room.glob("*.py")} - {"__init__"}
        lacking = {name for name in files if re.search(rf"\b{name}\b", head) is None}
        assert not lacking, f"{room.name}/__init__.py does not list {', '.join(sorted(lacking))}"


def swim(command: str, capsys: pytest.CaptureFixture[str]) -> float:
    """Run a command line of the program swim; return the mean speed in m/s."""
    words = shlex.split(command)
    assert swim_main([*words[words.index("swim") + 1 :], *(() if "--json" in words else ("--json",))]) == 0
    return float(json.loads(capsys.readouterr().out)["mean_speed"])


@pytest.mark.parametrize("file", ["my_fish.yaml", "my_case.json"])
def test_the_example_of_a_file_swims_by_each_command_shown_at_the_speed_stated(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (text,) = re.findall(rf"```{Path(file).suffix[1:]}\n(.*?)```", SIMULATOR, re.DOTALL)
    Path(file).write_text(text, encoding="utf-8")
    commands = re.findall(rf"^    \./run fin_sim (swim .*{file}.*)$", SIMULATOR, re.MULTILINE)
    assert commands
    speeds = [swim(command, capsys) for command in commands]
    (stated,) = re.findall(r"mean speed of ([0-9.]+) m/s", SIMULATOR[SIMULATOR.index(text) :].split("\n## ")[0])
    assert speeds[-1] == pytest.approx(float(stated), abs=0.6e-4)
    if file == "my_case.json":
        assert len(Path("trajectory.csv").read_text().splitlines()) == 202
        assert "201 rows of a free swim" in SIMULATOR


def test_the_page_of_the_simulator_names_every_key_of_a_case() -> None:
    keys = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`[^|]+) \|", SIMULATOR, re.MULTILINE))))
    known = {item.name for kind in (Body, Link, JointDrive) for item in fields(kind)} | case_files._KEYS
    assert keys - {path.stem for path in CONFIG.glob("*.yaml")} == known


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*")), ids=lambda path: path.name)
def test_a_parameter_file_that_comes_with_the_package_swims_as_it_says(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert f"| `{file.name}` |" in SIMULATOR
    monkeypatch.chdir(file.parent)
    (command,) = re.findall(r"^#   (swim .*?)(?:   .*)?$", file.read_text(encoding="utf-8"), re.MULTILINE)
    assert swim(command, capsys) > 0.005


def test_what_the_page_on_the_architecture_names_is_there() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    files = [path for folder in ("ros2_ws/src", "tests", "docs") for path in (ROOT / folder).rglob("*")]
    known = "\n".join(f"/{path.relative_to(ROOT)}" for path in files)
    named = re.findall(r"`(?:[\w./]+: )?([\w./]+)`", page)
    paths = {word.rstrip("/") for word in named if re.search(r"\.(py|md)$|/$", word)} - {"bags/trial_*"}
    assert sorted(path for path in paths if f"/{path}" not in known) == []
    code = "\n".join(path.read_text(encoding="utf-8") for path in files if path.suffix == ".py")
    names = {word.rpartition(".")[2] for word in named if "/" not in word and not word.endswith((".py", ".md"))}
    files_on_disk = {"json", "log", "end", "csv"}
    assert sorted(n for n in names - files_on_disk if not re.search(rf"\b{n}\b", code) and f"/{n}." not in known) == []
