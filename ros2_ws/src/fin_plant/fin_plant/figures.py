"""All figures of the workspace are made here: drawn into a file, in matplotlib's own style, whatever the user's is.

A user's matplotlibrc may ask for LaTeX, and Jupyter names its own backend to whatever it starts: neither is wanted in
the picture of a swim.
"""

from __future__ import annotations

import logging
import os
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

from fin_plant.private_folder import private_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from types import ModuleType

    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray


@cache
def _matplotlib() -> ModuleType:
    """Load matplotlib, half a second, away from the user's settings; the environment is as before afterwards."""
    own = {"MPLBACKEND": "Agg", "MPLCONFIGDIR": str(private_folder("fin_figures")), "MATPLOTLIBRC": ""}
    before = {name: os.environ.get(name) for name in own}
    os.environ.update(own)
    logger = logging.getLogger("matplotlib")
    level = logger.level
    logger.setLevel(logging.ERROR)  # of what a file of settings in the current folder says
    try:
        import matplotlib as mpl  # noqa: PLC0415
        from matplotlib import font_manager  # noqa: F401, PLC0415  (keeps its list of fonts in the folder above)
    finally:
        logger.setLevel(level)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    return mpl


@contextmanager
def own_style(**settings: object) -> Iterator[None]:
    """Draw and save with matplotlib's defaults and these settings (``font_size=9``); also a function's decorator."""
    mpl = _matplotlib()
    with mpl.rc_context(mpl.rcParamsDefault):
        mpl.rcParams.update({name.replace("_", ".", 1): value for name, value in settings.items()})
        yield


def empty_figure(width: float, height: float) -> Figure:
    """Return a figure of these inches without axes, saved with 150 dots an inch unless told otherwise.

    Make, fill and save it within `own_style`.
    """
    _matplotlib()
    from matplotlib.figure import Figure  # noqa: PLC0415  (loaded in its own way by the line above)

    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def new_figure(width: float, height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, NDArray[np.object_]]:
    """Return a figure of these inches and its axes, shape (rows, columns). Make, fill and save it in `own_style`."""
    figure = empty_figure(width, height)
    axes: NDArray[np.object_] = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.grid(visible=True, color="#e4e7eb", linewidth=0.8)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


FORMATS = (".png", ".pdf", ".svg")
"""What a picture's name may end in."""


def check_picture(path: Path) -> None:
    """Refuse a file name that no picture can be written to.

    Raises:
        ValueError: Another ending than those of `FORMATS`.
    """
    if path.suffix.lower() not in FORMATS:
        msg = f"{path}: a picture's name must end in {', '.join(FORMATS[:-1])} or {FORMATS[-1]}"
        raise ValueError(msg)


def try_to_draw(path: Path, draw: Callable[[], object]) -> str:
    """Draw a picture; return an empty text, or the one sentence to say where that failed.

    A picture shows what is known already: whatever goes wrong with it, numbers and exit code stay.
    """
    try:
        draw()
    except Exception as error:  # noqa: BLE001  (fonts, codecs, disks: matplotlib's errors have no common class)
        what = getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
        return f"the picture {path} could not be drawn: {what[:200]}"
    return ""
