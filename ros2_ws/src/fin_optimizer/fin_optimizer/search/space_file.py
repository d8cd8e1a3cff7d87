"""A search space as a YAML file: what is searched, what is in stock, what is held fixed and what must be met."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from fin_optimizer.search import names
from fin_optimizer.search.conditions import Condition
from fin_optimizer.search.rules import Rules, condition_units
from fin_optimizer.search.space import Choice, Dimension, Space
from fin_optimizer.search.stock import SETS, sheet
from fin_optimizer.search.ties import ties
from fin_plant import checks, text_file, yaml_file
from fin_plant.units import in_range, quantity

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from fin_optimizer.search.space import AnyDimension, Scalar
    from fin_optimizer.search.stock import Sheet
    from fin_plant.parameters import Parameter

SPACE_FILE = "space.yaml"
"""A study's copy of the file that it was begun with."""
_SECTIONS = ("search", "stock", "ties", "conditions")
_RANGE = ("minimum", "maximum", "log", "step")
_CHOICES, _POINTS = "choices", "points"
_MOST_POINTS = 100
_POSITIONS = "fin.profile_position"
_FORMS = "minimum and maximum (and log or step), or choices"


@dataclass(frozen=True)
class SpaceFile:
    """What a file says.

    Attributes:
        space: What is searched, every candidate one that can be.
        rules: What follows from a candidate, and what it must meet.
        start: Parameters of the fin and of the gait that are not searched.
        files: Contents of the files that were read, by the name that each has in a study's folder.
    """

    space: Space
    rules: Rules
    start: Mapping[str, Any]
    files: Mapping[str, bytes] = field(compare=False)


def read_space(path: Path, start: Mapping[str, Any], joints: int = 1) -> SpaceFile:
    """Read a search space.

    Args:
        path: Of the file.
        start: All parameters of the fin and of the gait that the search starts from.
        joints: Driven joints of the tail.

    Raises:
        ValueError: It cannot be read, or something in it is refused; the message names the file and the entry.
    """
    with text_file.named(path, "space"):
        content, files = read_content(path)
        return space_of(content, files, start, joints)


def read_content(path: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return what a file says, the stock in its place, and the files that were read.

    Raises:
        OSError: A file cannot be read.
        ValueError: It is no space.
    """
    files = {SPACE_FILE: text_file.read_bytes(path)}
    content = yaml_file.read(path)
    if not isinstance(content, dict) or not set(content) <= set(_SECTIONS):
        unknown = sorted(set(content) - set(_SECTIONS)) if isinstance(content, dict) else []
        hint = f"; {', '.join(unknown)} is none of them" if unknown else ""
        msg = f"it must be a mapping with {', '.join(_SECTIONS)}{hint}"
        raise ValueError(msg)
    stock = content.get("stock")
    if isinstance(stock, str):
        if Path(stock).name != stock or not stock.endswith(".yaml") or stock == SPACE_FILE:
            msg = f"stock = {stock!r} must be sheets, or the name of another .yaml file beside this one"
            raise ValueError(msg)
        try:
            files[stock] = text_file.read_bytes(path.parent / stock)
            content["stock"] = yaml_file.read(path.parent / stock)
        except (OSError, ValueError) as error:
            msg = f"stock {stock} cannot be read: {getattr(error, 'strerror', None) or error}"
            raise ValueError(msg) from error
    return content, files


def space_of(
    content: Mapping[str, Any], files: Mapping[str, bytes], start: Mapping[str, Any], joints: int = 1
) -> SpaceFile:
    """Return the space that the content of a file describes; see `read_space`.

    Raises:
        ValueError: Something in it is refused.
    """
    start = dict(start)
    stock = _stock(content.get("stock"))
    searched = dict(_section(content, "search"))
    start |= _profile(searched, start)
    heights = len(start[names.HEIGHTS])
    dimensions = _dimensions(searched, names.searchable(heights, joints), heights)
    if stock:
        dimensions.insert(0, _sheets(stock))
    if not dimensions:
        msg = "it searches nothing: name a parameter in search, or two sheets in stock"
        raise ValueError(msg)
    searched_names = [dimension.name for dimension in dimensions]
    _refuse_twice(searched_names, stock)
    tied = ties(content["ties"], {*searched_names, *(SETS if stock else ())}, start) if "ties" in content else ()
    units = condition_units(heights, joints)
    conditions = tuple(Condition.parse(text, units) for text in _list(content, "conditions"))
    rules = Rules(stock, tied, conditions)
    fixed = {name: value for name, value in start.items() if name not in {*searched_names, *rules.given}}
    return SpaceFile(rules.applied_to(Space(tuple(dimensions)), fixed), rules, fixed, files)


def _section(content: Mapping[str, Any], name: str) -> dict[str, Any]:
    found = content.get(name, {})
    if not isinstance(found, dict):
        msg = f"{name} = {found!r} must be a mapping"
        raise ValueError(msg)
    return found


def _list(content: Mapping[str, Any], name: str) -> list[object]:
    found = content.get(name, [])
    if not isinstance(found, list):
        msg = f"{name} = {found!r} must be a list, each entry with a dash before it"
        raise ValueError(msg)
    return found


def _stock(entries: object) -> dict[str, Sheet]:
    if entries is None:
        return {}
    if not isinstance(entries, dict) or not entries:
        msg = f"stock = {entries!r} must be a mapping of the names of sheets to what each is"
        raise ValueError(msg)
    return {name: sheet(name, entry) for name, entry in entries.items()}


def _sheets(stock: Mapping[str, Sheet]) -> Choice:
    if len(stock) == 1:
        msg = f"stock holds one sheet, {next(iter(stock))}: give two or more, or its E, thickness and density as fin.*"
        raise ValueError(msg)
    return Choice(names.STOCK, tuple(stock), traits=tuple(sheet.traits for sheet in stock.values()))


def _profile(searched: dict[str, Any], start: Mapping[str, Any]) -> dict[str, Any]:
    """Spread ``fin.profile_height`` with its number of points over single heights; return where they lie."""
    entry = searched.get(names.HEIGHTS)
    if entry is None:
        return {}
    if not isinstance(entry, dict) or _POINTS not in entry:
        msg = f"{names.HEIGHTS} needs points, their number between root and tip, beside {_FORMS}"
        raise ValueError(msg)
    if start[_POSITIONS]:
        msg = f"{names.HEIGHTS} has points, and the fin has {_POSITIONS} = {start[_POSITIONS]}: leave one of them out"
        raise ValueError(msg)
    count = checks.whole_number(f"{names.HEIGHTS}: points", entry[_POINTS], 1, _MOST_POINTS)
    rest = {name: value for name, value in entry.items() if name != _POINTS}
    spread = {names.height(place): rest for place in range(1, count + 1)}
    if twice := [name for name in spread if name in searched]:
        msg = f"{twice[0]} is searched twice, by itself and as one of {count} points: keep one"
        raise ValueError(msg)
    del searched[names.HEIGHTS]
    searched |= spread
    middle = 0.5 * (start["fin.height"] + start["fin.tip_height"])
    return {_POSITIONS: [place / (count + 1) for place in range(1, count + 1)], names.HEIGHTS: [middle] * count}


def _dimensions(searched: Mapping[str, Any], known: Mapping[str, Parameter], heights: int) -> list[AnyDimension]:
    dimensions: list[AnyDimension] = []
    for name, entry in searched.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=3)
            hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(known)}"
            if names.height_place(name) is not None:
                hint = (
                    f"the fin's profile has {heights} points; give fin.profile_position, or {names.HEIGHTS} with points"
                )
            msg = f"search: {name} is not a parameter that can be searched: {hint}"
            raise ValueError(msg)
        dimensions.append(_dimension(name, entry, known[name]))
    return dimensions


def _dimension(name: str, entry: object, parameter: Parameter) -> AnyDimension:
    """Return how one parameter is searched; unit and range are its table's."""
    if not isinstance(entry, dict):
        msg = f"{name} = {entry!r} must be a mapping with {_FORMS}"
        raise ValueError(msg)
    if _CHOICES in entry:
        if len(entry) > 1 or not isinstance(entry[_CHOICES], list):
            msg = f"{name}: choices stand alone, as a list, for example {{choices: [1, 2]}}"
            raise ValueError(msg)
        return Choice(name, tuple(_choice(name, each, parameter) for each in entry[_CHOICES]), parameter.unit)
    if parameter.kind not in {"double", "integer"}:
        msg = f"{name} has no order: give choices, a list of some of {parameter.allowed}"
        raise ValueError(msg)
    if not {"minimum", "maximum"} <= set(entry) <= set(_RANGE):
        wrong = [each for each in entry if each not in _RANGE]
        hint = f", not {', '.join(wrong)}" if wrong else ""
        msg = f"{name} needs {_FORMS}{hint}"
        raise ValueError(msg)
    low, high = (in_range(f"{bound} of {name}", entry[bound], parameter) for bound in ("minimum", "maximum"))
    log = entry.get("log", False)
    if not isinstance(log, bool):
        msg = f"{name}: log = {log!r} must be true or false"
        raise ValueError(msg)
    step = quantity(f"step of {name}", entry["step"], parameter.unit) if "step" in entry else 0.0
    if "step" in entry:
        checks.number(f"step of {name}", step, 0.0, unit=parameter.unit, exclusive_minimum=True)
    return Dimension(name, low, high, parameter.unit, log, step, whole=parameter.kind == "integer")


def _choice(name: str, given: object, parameter: Parameter) -> Scalar:
    if parameter.kind == "double":
        return in_range(name, given, parameter)
    return cast("Scalar", parameter.check(given))


def _refuse_twice(searched: Collection[str], stock: Mapping[str, Sheet]) -> None:
    """Refuse two searches of one parameter.

    Raises:
        ValueError: There are.
    """
    if stock and (twice := [name for name in SETS if name in searched]):
        msg = f"{twice[0]} is searched twice, by itself and with the sheets in stock: leave one of them out"
        raise ValueError(msg)
    places = {name: names.drive_place(name) for name in searched}
    for whole, column in names.WHOLE.items():
        twice = [name for name, place in places.items() if place is not None and place[1] == column]
        if whole in searched and twice:
            msg = f"{whole} is searched twice, for the whole tail and as {twice[0]}: leave one of them out"
            raise ValueError(msg)
