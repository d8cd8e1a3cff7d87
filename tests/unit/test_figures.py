"""Pictures do not depend on the user's matplotlib, and one that fails takes nothing else with it."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from fin_plant import figures

DRAW = """
import hashlib, sys
from pathlib import Path
from fin_plant import figures

@figures.own_style()
def draw():
    figure, axes = figures.new_figure(4.0, 3.0)
    axes[0, 0].plot([1.0, 2.0], label="a_b")
    axes[0, 0].set(title="50 %", xlabel="E, Pa")
    axes[0, 0].legend()
    figure.savefig("picture.png", metadata={"Software": None})

print(figures.try_to_draw(Path("picture.png"), draw) or hashlib.sha256(Path("picture.png").read_bytes()).hexdigest())
"""


def _drawn(folder: Path, **environment: str) -> str:
    folder.mkdir()
    paths = os.pathsep.join(sys.path)
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", DRAW],
        cwd=folder,
        env={name: value for name, value in os.environ.items() if not name.startswith("MPL")}
        | {"PYTHONPATH": paths}
        | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert result.stderr == ""
    return result.stdout.strip()


def test_a_picture_is_the_same_whatever_the_users_matplotlib_is_set_to(tmp_path: Path) -> None:
    settings = tmp_path / "config" / "matplotlibrc"
    settings.parent.mkdir()
    settings.write_text("text.usetex: True\nfont.size: 30\nsavefig.dpi: 20\nno.such.key: 1\n")
    plain = _drawn(tmp_path / "plain")
    assert len(plain) == hashlib.sha256().digest_size * 2
    nonsense = {"MPLBACKEND": "no such backend", "MPLCONFIGDIR": str(settings.parent)}
    assert _drawn(tmp_path / "folder", **nonsense) == plain
    no_home = {"MATPLOTLIBRC": str(settings), "HOME": "/proc/no", "XDG_CACHE_HOME": ""}
    assert _drawn(tmp_path / "file", **no_home) == plain
    inline = "module://matplotlib_inline.backend_inline"
    assert _drawn(tmp_path / "jupyter", MPLBACKEND=inline, MPLCONFIGDIR="/proc/no") == plain


def test_drawing_leaves_the_settings_of_who_draws_as_they_were(tmp_path: Path) -> None:
    with mpl.rc_context({"font.size": 31.0}):
        with figures.own_style(axes_linewidth=3.0):
            assert mpl.rcParams["font.size"] == mpl.rcParamsDefault["font.size"]
            assert mpl.rcParams["axes.linewidth"] == 3.0
            figures.new_figure(3.0, 2.0)[0].savefig(tmp_path / "picture.png")
        assert mpl.rcParams["font.size"] == 31.0


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (RuntimeError("latex could\nnot be found"), "latex could not be found"),
        (OSError(28, "No space left on device"), "No space left on device"),
        (AssertionError(), "AssertionError"),
    ],
)
def test_a_picture_that_fails_is_one_sentence(error: Exception, reason: str) -> None:
    def draw() -> None:
        raise error

    assert figures.try_to_draw(Path("p.png"), draw) == f"the picture p.png could not be drawn: {reason}"
    assert figures.try_to_draw(Path("p.png"), lambda: None) == ""
