"""Pictures of swims: figures over a variation, one swim's course and figures over time, and an animation."""

from __future__ import annotations

import math
import shutil
from typing import TYPE_CHECKING

import numpy as np

from fin_plant.figures import new_figure, own_style

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fin_sim.swim_command.axes import Axis
    from fin_sim.swim_command.variation import Cell
    from fin_sim.swim_result import Swim

BODY_COLOUR, TAIL_COLOUR, FIN_COLOUR, PATH_COLOUR = "#29588a", "#595961", "#ed8c24", "#9aa5b1"
_FRAMES_PER_SECOND = 25
# A GIF of more frames takes minutes to write and tens of megabytes.
_MOST_FRAMES = 750
ANIMATIONS = (".gif", ".mp4")
_LARGEST_LEGEND = 6
_SPREAD = 20.0
"""Largest over smallest value from which on an axis is logarithmic."""


@own_style()
def plot_swim(swim: Swim, path: Path, title: str = "") -> None:
    """Draw course, forward speed, joint angles and servo power of a swim into a PNG, PDF or SVG.

    Raises:
        OSError: The file cannot be written.
    """
    figure, axes = new_figure(10.0, 7.0, 2, 2)
    figure.suptitle(title, fontsize="medium")
    course, speed, joints, power = axes.flat
    course.plot(
        100.0 * swim.tip_path[:, 0], 100.0 * swim.tip_path[:, 1], color=FIN_COLOUR, lw=0.6, label="trailing edge"
    )
    course.plot(100.0 * swim.x, 100.0 * swim.y, color=BODY_COLOUR, label="centre of mass")
    course.set(xlabel="x, cm", ylabel="y, cm", title="Course", aspect="equal", adjustable="datalim")
    course.legend(frameon=False)
    speed.plot(swim.time, 100.0 * swim.surge, color=BODY_COLOUR)
    speed.axhline(
        100.0 * swim.mean_speed, color=FIN_COLOUR, ls="--", label=f"mean over the run {100 * swim.mean_speed:.2f}"
    )
    speed.set(xlabel="time, s", ylabel="forward speed, cm/s", title="Forward speed")
    speed.legend(frameon=False)
    few = len(swim.chain.links) <= _LARGEST_LEGEND
    dashes = iter(("-", "--", ":") * len(swim.chain.links))
    for index, (driven, angles) in enumerate(zip(swim.chain.driven, swim.joint_angles.T, strict=True), start=1):
        style = {"color": TAIL_COLOUR, "ls": next(dashes)} if driven else {}
        label = f"joint {index} ({'driven' if driven else 'hinge'})" if few else None
        joints.plot(swim.time, np.degrees(angles), label=label, **style)
    joints.set(xlabel="time, s", ylabel="angle, degrees", title="Joints")
    if few:
        joints.margins(y=0.2)
        joints.legend(frameon=False, fontsize="small", loc="upper right", ncols=3)
    power.plot(swim.time, 1000.0 * swim.servo_power, color=FIN_COLOUR)
    power.set(xlabel="time, s", ylabel="servo power, mW", title="Servo power")
    figure.savefig(path, dpi=120)


@own_style()
def plot_variation(axes: list[Axis], rows: list[dict[str, Cell]], path: Path, title: str = "") -> None:
    """Draw mean and steady speed of a variation, as far as its rows have them, into a PNG, PDF or SVG.

    Over one number curves; over two a curve for each value of the second, or a map where those would be too many.

    Args:
        axes: One or two.
        rows: A row a swim, with the numbers that vary and the figures by name; fewer if it was cut short.
        path: The file.
        title: Heading.

    Raises:
        OSError: The file cannot be written.
    """
    speeds = [name for name in ("mean_speed", "steady_speed") if name in rows[0]]
    figure, panels = new_figure(5.0 + 2.5 * len(speeds), 4.5, 1, len(speeds))
    figure.suptitle(title, fontsize="medium")
    first, second = axes[0], (axes[1] if len(axes) > 1 else None)
    for panel, name in zip(panels.flat, speeds, strict=True):
        panel.set(xlabel=_label(first), title=f"{name.replace('_', ' ')}, cm/s")
        numbers = second and not first.of_words and not second.of_words
        if second and numbers and len(second.values) > _LARGEST_LEGEND and len(first.values) > 1:
            _draw_map(figure, panel, first, second, [(row[first.name], row[second.name], row[name]) for row in rows])
        else:
            _draw_curves(panel, first, second, name, rows)
    figure.savefig(path, dpi=120)


def _label(axis: Axis) -> str:
    return f"{axis.name}, {axis.unit}" if axis.unit else axis.name


def _draw_curves(panel: Axes, first: Axis, second: Axis | None, name: str, rows: list[dict[str, Cell]]) -> None:
    for value in second.values if second else (None,):
        chosen = [row for row in rows if second is None or row[second.name] == value]
        speeds = [math.nan if row[name] is None else 100.0 * row[name] for row in chosen]
        shown = value if isinstance(value, str) else f"{value:g}" if second else ""
        label = f"{second.name} = {shown} {second.unit}".rstrip() if second else None
        panel.plot([row[first.name] for row in chosen], speeds, marker="o", ms=3, label=label)
    panel.set(ylim=(0.0, None))
    _scale(panel, "x", first)
    if second:
        panel.legend(frameon=False, fontsize="small")


def _draw_map(
    figure: Figure,
    panel: Axes,
    first: Axis,
    second: Axis,
    speeds: list[tuple[float | None, float | None, float | None]],
) -> None:
    """Draw a speed over two numbers as colours, and mark the fastest swim; what has none stays white."""
    columns = {value: index for index, value in enumerate(sorted(set(first.values)))}
    lines = {value: index for index, value in enumerate(sorted(set(second.values)))}
    table = np.full((len(lines), len(columns)), math.nan)
    for x, y, speed in speeds:
        if speed is not None:
            table[lines[y], columns[x]] = 100.0 * speed
    panel.grid(visible=False)
    mesh = panel.pcolormesh(list(columns), list(lines), table, cmap="viridis", shading="nearest")
    figure.colorbar(mesh, ax=panel, pad=0.02)
    panel.set(ylabel=_label(second))
    _scale(panel, "x", first)
    _scale(panel, "y", second)
    if np.isfinite(table).any():
        line, column = np.unravel_index(np.nanargmax(table), table.shape)
        x, y = list(columns)[int(column)], list(lines)[int(line)]
        panel.plot([x], [y], "o", ms=9, mfc="none", mec="tab:red", mew=1.8)
        note = f"fastest {np.nanmax(table):.3g} cm/s\nat {x:.4g} {first.unit}, {y:.4g} {second.unit}"
        panel.annotate(
            note,
            (x, y),
            xytext=(0.02, 0.98),
            textcoords="axes fraction",
            va="top",
            fontsize="small",
            color="white",
            bbox={"facecolor": "black", "alpha": 0.45, "edgecolor": "none"},
        )


def _scale(panel: Axes, direction: str, varied: Axis) -> None:
    """Make an axis logarithmic where its values span more than a decade, with labels at 1, 2 and 5."""
    if varied.of_words or not min(varied.values) > 0.0 or max(varied.values) < _SPREAD * min(varied.values):
        return
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter  # noqa: PLC0415  (see own_style)

    panel.set(**{f"{direction}scale": "log"})
    axis = panel.xaxis if direction == "x" else panel.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_formatter(NullFormatter())


def check_animation(path: Path) -> None:
    """Refuse a file that no animation can be written to.

    Raises:
        ValueError: Not .gif or .mp4, or .mp4 without the program ffmpeg.
    """
    if path.suffix.lower() not in ANIMATIONS:
        msg = f"{path}: an animation's name must end in {' or '.join(ANIMATIONS)}"
        raise ValueError(msg)
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        msg = f"{path}: MP4 needs the program ffmpeg, which is not installed: install it or write a .gif"
        raise ValueError(msg)


@own_style()
def animate_swim(swim: Swim, path: Path, body_axes: tuple[float, float]) -> None:
    """Draw a swim from above as GIF or MP4 in real time: body, tail, fin and the path swum.

    Args:
        swim: The swim.
        path: The file, .gif or .mp4.
        body_axes: Length and width of the body, m.

    Raises:
        ValueError: See `check_animation`.
        OSError: The file cannot be written.
    """
    # Loaded within the figures' own style: `own_style` has brought matplotlib in by now.
    from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter  # noqa: PLC0415
    from matplotlib.collections import LineCollection  # noqa: PLC0415
    from matplotlib.patches import Ellipse  # noqa: PLC0415

    check_animation(path)
    frames = max(2, min(round(swim.duration * _FRAMES_PER_SECOND), _MOST_FRAMES))
    samples = np.linspace(0, len(swim.time) - 1, frames).round().astype(int)
    joints, centre = 100.0 * swim.joint_path, 100.0 * np.stack((swim.x, swim.y), axis=-1)
    figure, axes = new_figure(8.0, 4.5)
    axis: Axes = axes[0, 0]
    reach = 100.0 * body_axes[0]
    low = np.minimum(centre.min(axis=0) - 0.6 * reach, joints.min(axis=(0, 1)) - 0.1 * reach)
    high = np.maximum(centre.max(axis=0) + 0.6 * reach, joints.max(axis=(0, 1)) + 0.1 * reach)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x, cm", ylabel="y, cm", aspect="equal")
    (path_line,) = axis.plot([], [], color=PATH_COLOUR, lw=1.0)
    body = Ellipse((0.0, 0.0), 100.0 * body_axes[0], 100.0 * body_axes[1], color=BODY_COLOUR)
    axis.add_patch(body)
    colours = [TAIL_COLOUR if driven else FIN_COLOUR for driven in swim.chain.driven]
    tail = LineCollection([], colors=colours, linewidths=3.0, capstyle="round")
    axis.add_collection(tail, autolim=False)

    def draw(frame: int) -> list[object]:
        at = samples[frame]
        path_line.set_data(centre[: at + 1, 0], centre[: at + 1, 1])
        body.set_center((float(centre[at, 0]), float(centre[at, 1])))
        body.set_angle(math.degrees(swim.heading[at]))
        tail.set_segments(list(np.stack((joints[at, :-1], joints[at, 1:]), axis=1)))
        axis.set_title(f"{swim.time[at]:5.2f} s   {100.0 * swim.surge[at]:5.2f} cm/s", family="monospace")
        return [path_line, body, tail]

    animation = FuncAnimation(figure, draw, frames=frames, blit=False)  # type: ignore[arg-type]
    rate = max(1, round((frames - 1) / swim.duration))
    writer = FFMpegWriter(fps=rate) if path.suffix.lower() == ".mp4" else PillowWriter(fps=rate)
    animation.save(path, writer=writer, dpi=90)
