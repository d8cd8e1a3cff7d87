"""Checks with their targets, and the page that states them."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fin_plant.fin import Fin

if TYPE_CHECKING:
    from collections.abc import Iterable

_WIDTH = 120


def _filled(text: str) -> str:
    """Return Markdown with its paragraphs wrapped evenly; tables keep their lines."""
    blocks = text.strip().split("\n\n")
    return "\n\n".join(
        block
        if block.lstrip().startswith("|")
        else textwrap.fill(" ".join(block.split()), _WIDTH, break_long_words=False, break_on_hyphens=False)
        for block in blocks
    )


def table_head(columns: Iterable[str]) -> str:
    """Return the head of a table with these columns, in Markdown."""
    names = list(columns)
    return f"| {' | '.join(names)} |\n|{'---|' * len(names)}"


@dataclass(frozen=True)
class Check:
    """One figure with its target.

    Attributes:
        name: What is measured.
        value: The figure, an error or deviation in the unit of the target.
        target: The largest absolute value that passes.
        note: The numbers behind it, for the reader.
        finding: A miss tells of somebody else's numbers and is no defect of this project.
    """

    name: str
    value: float
    target: float
    note: str = ""
    finding: bool = False

    @property
    def passed(self) -> bool:
        """Whether the figure meets its target; a figure that is not finite does not."""
        return abs(self.value) <= self.target

    def row(self) -> str:
        """Return the row of the page's table."""
        verdict = "yes" if self.passed else "**no**"
        return f"| {self.name} | {self.value:.2g} | {self.target:.2g} | {verdict} | {self.note} |"


PUBLISHED_TOLERANCE = 0.1
"""Deviation from a published figure, relative to it, that still counts as agreement."""


@dataclass(frozen=True)
class Published(Check):
    """A figure whose target is what others published, met within `PUBLISHED_TOLERANCE` of it; a miss is a finding."""

    finding: bool = True

    @property
    def passed(self) -> bool:
        """Whether the figure agrees with the published one."""
        return abs(self.value - self.target) <= PUBLISHED_TOLERANCE * abs(self.target)

    def row(self) -> str:
        """Return the row of the page's table."""
        verdict = "yes" if self.passed else "**no**"
        tolerance = f"+- {PUBLISHED_TOLERANCE:.0%}"
        return f"| {self.name} | {self.value:.3g} | {self.target:.3g} {tolerance} | {verdict} | {self.note} |"


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: Its heading.
        checks: Figures with targets.
        text: What to know, as Markdown; lines of a table among it.
        figure: Name of the picture in ``docs/figures``, or empty.
        caption: What the picture shows.
    """

    title: str
    checks: list[Check] = field(default_factory=list)
    text: str = ""
    figure: str = ""
    caption: str = ""

    def markdown(self) -> str:
        """Return the part as Markdown."""
        parts = [f"## {self.title}"]
        if self.text:
            parts.append(_filled(self.text))
        if self.checks:
            head = ["| check | figure | target | met | |", "|---|---|---|---|---|"]
            parts.append("\n".join([*head, *(check.row() for check in self.checks)]))
        if self.figure:
            parts.append(f"![{self.caption}](figures/{self.figure})\n\n*{self.caption}*")
        return "\n\n".join(parts)


def render(sections: list[Section]) -> str:
    """Return the page."""
    checks = [check for section in sections for check in section.checks]
    met = sum(check.passed for check in checks)
    findings = sum(check.finding and not check.passed for check in checks)
    told = f"; of those that do not, {findings} compare with the papers' published points, where a miss is a finding"
    head = f"""
Made by `make validation` (`./run fin_sim validation`) from what is committed; do not edit it by hand. {met} of
{len(checks)} figures meet their target{told if findings else ""}. Symbols:
E Young's modulus, U speed, S C_D drag area, C_N coefficient of the
resistive force. The *default fin* is what the simulator swims where nothing is said: {Fin().describe()}, hinges in
the middles of {Fin().segments} segments, driven at 0.9 Hz and 15 degrees either way on a body of 14 cm. Its size is
that of the papers' fin; they print a thickness of 1 mm, with which their own equation 3 makes the fin rigid at 0.9 Hz,
and 0.208 mm gives the hinge stiffnesses that they print."""
    return (
        "\n\n".join(
            ["# Validation of the simulated fish", _filled(head), *(section.markdown() for section in sections)]
        )
        + "\n"
    )
