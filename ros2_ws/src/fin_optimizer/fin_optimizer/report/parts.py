"""What a page is made of: sections of paragraphs, facts, tables, plots and a film; the template draws each."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


@dataclass(frozen=True)
class Cell:
    """One cell of a table.

    Attributes:
        text: What stands in it.
        sort: What it is sorted by; its text if left out.
        link: Where it leads to, relative to the page; nowhere if empty.
    """

    text: str
    sort: float | None = None
    link: str = ""


@dataclass(frozen=True)
class Column:
    """A column's head.

    Attributes:
        name: What stands in it.
        unit: Of its numbers.
        is_number: Whether it is set to the right.
        is_minor: Whether a print leaves it out, for which a wide table has no room.
    """

    name: str
    unit: str = ""
    is_number: bool = True
    is_minor: bool = False


@dataclass(frozen=True)
class Table:
    """A table that can be sorted.

    Attributes:
        columns: Its heads.
        rows: A cell a column.
        note: A sentence below it.
        best: The row that is marked, None for none.
    """

    kind: ClassVar[str] = "table"
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    note: str = ""
    best: int | None = None


@dataclass(frozen=True)
class Facts:
    """Names and values, side by side.

    Attributes:
        entries: Each a name and what it is.
        look: ``large`` for what is seen first, ``cards`` for a few numbers, ``list`` for many.
        title: A heading of their own; none if empty.
    """

    kind: ClassVar[str] = "facts"
    entries: Sequence[tuple[str, str]]
    look: Literal["large", "cards", "list"] = "cards"
    title: str = ""


@dataclass(frozen=True)
class Plot:
    """A plot.

    Attributes:
        figure: plotly's ``data`` and ``layout``; a colour may be a variable of the page, ``var(--blue)``.
        says: What it shows, in words: its caption, and what who does not see it is told.
        height: In px.
        is_half: Whether two of them stand side by side where there is room.
    """

    kind: ClassVar[str] = "plot"
    figure: Mapping[str, Any]
    says: str
    height: int = 380
    is_half: bool = False


@dataclass(frozen=True)
class Film:
    """A swim that is drawn on a canvas.

    Attributes:
        data: See `film.film_of`.
        says: What it shows, in words.
    """

    kind: ClassVar[str] = "film"
    data: Mapping[str, Any]
    says: str


Block = Facts | Film | Plot | Table


@dataclass(frozen=True)
class Section:
    """A part of the page with a heading.

    Attributes:
        anchor: Its name in the page's address.
        title: Its heading.
        paragraphs: What is said first.
        blocks: What follows.
    """

    anchor: str
    title: str
    paragraphs: Sequence[str] = ()
    blocks: Sequence[Block] = ()


@dataclass(frozen=True)
class Page:
    """A whole page.

    Attributes:
        title: Its name.
        lead: What was found, a sentence a line.
        facts: What is seen first.
        sections: The rest, in order.
        foot: Who wrote it and when.
    """

    title: str
    lead: Sequence[str]
    facts: Facts
    sections: Sequence[Section]
    foot: str = ""
    notes: Sequence[str] = field(default_factory=tuple)
