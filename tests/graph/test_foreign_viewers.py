"""Other people's programs read a fresh bag of the simulator and of a rehearsal, and a browser shows the fish in it.

    pip install -r requirements/viewers.txt
    VIEWER_PICTURES=docs/figures python -m pytest -m long tests/graph/test_foreign_viewers.py

also writes the pictures of docs/viewers.md, as rerun's viewer draws them in Chromium.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from fin_optimizer.bags.reader import read_bag
from support.browser import CHROMIUM, browser
from support.processes import ROOT, StartedProcess
from support.waiting import wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator


Start = Callable[..., StartedProcess]
pytestmark = pytest.mark.long
READER = ROOT / "tests" / "support" / "read_mcap.cjs"
MCAP_FOR_JAVASCRIPT = ("@mcap/core@2.2.2", "@mcap/support@1.1.0")
PLANTS = ("sim", "rehearsal")
# A browser that draws by the processor alone takes a minute for what a graphics card does at once.
DRAWN_SECONDS = 900.0
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
# The viewer asks for examples and sends statistics: nothing leaves this computer.
NO_NETWORK = ("--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",)
# One view, which goes along with the fish and looks at it from its left.
BLUEPRINT = """
import sys
import rerun.blueprint as b

eye = b.EyeControls3D(position=(-0.12, 0.24, 0.13), look_target=(-0.055, 0.0, -0.005), eye_up=(0, 0, 1))
along = b.SpatialInformation(target_frame="base_link")
view = b.Spatial3DView(origin="/", name="The fish in its tank", eye_controls=eye, spatial_information=along)
b.Blueprint(view, collapse_panels=True, auto_views=False, auto_layout=False).save(*sys.argv[1:])
"""


@pytest.fixture(scope="module", params=PLANTS)
def bag(request: pytest.FixtureRequest, shared_start: Start, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a bag that was just recorded."""
    study = tmp_path_factory.mktemp(str(request.param)) / "study"
    # A busy machine takes a picture of the tracker too late for a swim: as often as it does, the swim is made again.
    again = ("attempts:=10", "failures_in_a_row:=10")
    words = (f"plant:={request.param}", "trials:=1", f"study_folder:={study}", "disk.minimum_free:=0", *again)
    assert shared_start("fin_bringup", "bringup", *words).wait(600.0) == 0
    return max((study / "bags").iterdir())


def mcap(bag: Path) -> Path:
    (path,) = bag.glob("*.mcap")
    return path


@pytest.fixture(scope="module")
def javascript(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the format's own reader for JavaScript."""
    if not shutil.which("node") or not shutil.which("npm"):
        pytest.skip("needs node and npm: apt-get install npm")
    folder = tmp_path_factory.mktemp("javascript")
    words = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts", *MCAP_FOR_JAVASCRIPT]
    done = subprocess.run(words, cwd=folder, check=False, capture_output=True, text=True, timeout=300.0)
    if done.returncode:
        pytest.skip(f"npm install {MCAP_FOR_JAVASCRIPT[0]} did not work: {done.stderr.strip()[-200:]}")
    shutil.copy(READER, folder)
    return folder / READER.name


def rerun(*words: str) -> list[str]:
    pytest.importorskip("rerun", reason="pip install -r requirements/viewers.txt")
    return [sys.executable, "-m", "rerun", *words]


def test_the_reader_for_javascript_reads_every_message_in_the_order_of_time(bag: Path, javascript: Path) -> None:
    words = ["node", str(javascript), str(mcap(bag))]
    told = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    assert told["counts"] == {topic: count for topic, count in read_bag(bag).counts.items() if count}
    assert told["streamed"] == sum(told["counts"].values())
    assert (told["back_in_time"], told["done"]) == (0, True)


def test_rerun_finds_no_fault_in_the_file(bag: Path, tmp_path: Path) -> None:
    words = rerun("mcap", "check", "--full", str(mcap(bag)))
    done = subprocess.run(words, env=quiet(tmp_path), check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split() for line in done.stdout.splitlines() if "/" in line and not line.startswith("/")]
    assert len(rows) > 10
    assert {(row[0], row[-1]) for row in rows} == {("ok", "—")}


def quiet(folder: Path) -> dict[str, str]:
    return os.environ | {"HOME": str(folder), "RERUN_ANALYTICS": "0", "RUST_LOG": "info"}


@pytest.fixture
def viewer(bag: Path, tmp_path: Path) -> Iterator[str]:
    """Yield the address of rerun's viewer for browsers, which serves the bag."""
    blueprint, log = tmp_path / "fish.rbl", tmp_path / "rerun.log"
    application = mcap(bag).stem.replace(".", "_")
    words = rerun(str(mcap(bag)), str(blueprint), "--bind", "127.0.0.1", "--port", "auto", "--renderer", "webgl")
    subprocess.run([sys.executable, "-c", BLUEPRINT, application, str(blueprint)], env=quiet(tmp_path), check=True)
    words += ["--serve-web", "--web-viewer-port", "0"]
    with log.open("wb") as said:
        process = subprocess.Popen(words, env=quiet(tmp_path), stdout=said, stderr=said, start_new_session=True)

    def address() -> re.Match[str] | None:
        return re.search(r"connect at (http://127\.0\.0\.1\S+)", log.read_text())

    try:
        wait_until(address, 120.0, log.read_text)
        found = address()
        assert found
        yield found[1].replace("localhost", "127.0.0.1")
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def shows_a_fish(picture: Path) -> bool:
    """Return whether the view below the viewer's own line has something in the colours of fin and body."""
    with Image.open(picture) as image:
        red, _, blue = np.moveaxis(np.asarray(image.convert("RGB"), dtype=int)[60:-60], 2, 0)
    return bool(np.sum(red - blue > 40) > 300 and np.sum(blue - red > 30) > 1000)


def test_a_browser_shows_the_fish(request: pytest.FixtureRequest, viewer: str, tmp_path: Path) -> None:
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    picture = tmp_path / "fish.png"
    with browser(tmp_path / "profile", (*SOFTWARE, *NO_NETWORK), graphics=True) as tab:
        tab.look(900, 520)
        tab.ask("Page.navigate", url=viewer)

        def drawn() -> bool:
            tab.tell("new Promise((resolve) => setTimeout(resolve, 2000))")
            tab.picture(picture)
            return shows_a_fish(picture)

        wait_until(drawn, DRAWN_SECONDS, lambda: f"a fish in {picture}; the page says {tab.complaints}")
    if folder := os.environ.get("VIEWER_PICTURES"):
        shutil.copy(picture, Path(folder) / f"viewer_rerun_{request.node.callspec.params['bag']}.png")
