"""Pictures of a swimmer of one's own: its path and poses over a stroke, and an animation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fin_plant.figures import new_figure, own_style
from fin_sim.picture import BODY_COLOUR, FIN_COLOUR, PATH_COLOUR, check_animation

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from fin_sim.ideal_2d.linkage import Linkage

_POSES, _FRAMES = 5, 120


def _lines(
    linkage: Linkage, angles: NDArray[np.float64], place: complex, heading: float
) -> list[NDArray[np.complex128]]:
    return [place + np.exp(1j * heading) * line for line in linkage.outlines(angles)]


def _limits(
    axes: Axes,
    linkage: Linkage,
    angles: NDArray[np.float64],
    place: NDArray[np.complex128],
    heading: NDArray[np.float64],
) -> None:
    every = max(1, len(place) // 40)
    points = np.concatenate(
        [
            point
            for pose in zip(angles[::every], place[::every], heading[::every], strict=True)
            for point in _lines(linkage, *pose)
        ]
    )
    margin = 0.05 * max(float(np.ptp(points.real)), float(np.ptp(points.imag)))
    axes.set(
        xlim=(points.real.min() - margin, points.real.max() + margin),
        ylim=(points.imag.min() - margin, points.imag.max() + margin),
        xlabel="x, m",
        ylabel="y, m",
        aspect="equal",
    )


@own_style()
def plot_swimmer(
    linkage: Linkage,
    time: NDArray[np.float64],
    angles: NDArray[np.float64],
    place: NDArray[np.complex128],
    heading: NDArray[np.float64],
    path: Path,
    title: str,
) -> None:
    """Draw poses along the path, and the joints' angles over time, into a PNG, PDF or SVG.

    Args:
        linkage: What swam.
        time: s, shape (S,).
        angles: Of the joints, rad, shape (S, J).
        place: Of the first member, x + i y, m, shape (S,).
        heading: rad, shape (S,).
        path: The file.
        title: Above the picture.

    Raises:
        OSError: The file cannot be written.
    """
    figure, axes = new_figure(10.0, 4.5, 1, 2)
    figure.suptitle(title, fontsize="medium")
    course, joints = axes.flat
    for number, at in enumerate(np.linspace(0, len(time) - 1, _POSES).round().astype(int)):
        for line in _lines(linkage, angles[at], place[at], heading[at]):
            fade = 0.25 + 0.75 * number / (_POSES - 1)
            course.plot(line.real, line.imag, color=BODY_COLOUR, lw=1.2, alpha=fade)
    course.plot(place.real, place.imag, color=FIN_COLOUR, lw=1.2, label="first link")
    _limits(course, linkage, angles, place, heading)
    course.set_title(f"{_POSES} poses, the last one darkest")
    course.legend(frameon=False)
    for index, angle in enumerate(angles.T, start=1):
        joints.plot(time, np.degrees(angle), label=f"joint {index}")
    joints.set(xlabel="time, s", ylabel="angle, degrees", title="Joints")
    joints.legend(frameon=False)
    figure.savefig(path)


@own_style()
def animate_swimmer(
    linkage: Linkage,
    time: NDArray[np.float64],
    angles: NDArray[np.float64],
    place: NDArray[np.complex128],
    heading: NDArray[np.float64],
    path: Path,
) -> None:
    """Draw a swimmer over time as GIF or MP4; arguments as `plot_swimmer`.

    Raises:
        ValueError: See `check_animation`.
        OSError: The file cannot be written.
    """
    from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter  # noqa: PLC0415  (after `own_style`)

    check_animation(path)
    frames = min(_FRAMES, len(time))
    samples = np.linspace(0, len(time) - 1, frames).round().astype(int)
    figure, axes = new_figure(8.0, 4.5)
    axis: Axes = axes[0, 0]
    _limits(axis, linkage, angles, place, heading)
    (trail,) = axis.plot([], [], color=PATH_COLOUR, lw=1.0)
    shown = [
        axis.plot([], [], color=FIN_COLOUR if member.section.is_fin else BODY_COLOUR)[0] for member in linkage.members
    ]

    def draw(frame: int) -> list[object]:
        at = samples[frame]
        trail.set_data(place.real[: at + 1], place.imag[: at + 1])
        for line, points in zip(shown, _lines(linkage, angles[at], place[at], heading[at]), strict=True):
            line.set_data(points.real, points.imag)
        axis.set_title(f"{time[at]:6.2f} s", family="monospace")
        return [trail, *shown]

    animation = FuncAnimation(figure, draw, frames=frames, blit=False)  # type: ignore[arg-type]
    rate = max(1, min(50, round(frames / (time[-1] - time[0]))))
    writer = FFMpegWriter(fps=rate) if path.suffix.lower() == ".mp4" else PillowWriter(fps=rate)
    animation.save(path, writer=writer, dpi=90)
