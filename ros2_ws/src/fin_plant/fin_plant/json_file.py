"""One reader for JSON that people write or change: Python's own takes the last of two equal keys, and `NaN`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, NoReturn

from fin_plant import text_file

if TYPE_CHECKING:
    from pathlib import Path


class _Doubled(dict[str, object]):
    """An object in which a key stands twice."""

    key = ""


def parse(text: str) -> object:
    """Return what a JSON text says.

    Raises:
        ValueError: It is empty or no JSON, or holds NaN, Infinity or a key twice; the message says which, and where.
    """
    if not text.strip():
        msg = "it is empty"
        raise ValueError(msg)
    try:
        content = json.loads(text.removeprefix("\ufeff"), object_pairs_hook=_object, parse_constant=_refuse_constant)
        _require_single(content, "")
    except json.JSONDecodeError as error:
        msg = f"line {error.lineno}: it is no JSON: {error.msg}, at column {error.colno}"
        raise ValueError(msg) from None
    except RecursionError:
        msg = "it is nested too deeply"
        raise ValueError(msg) from None
    return content


def read(path: Path) -> object:
    """Return what a JSON file says; see `parse`.

    Raises:
        ValueError: It is refused, or no text in UTF-8.
        OSError: It cannot be read.
    """
    return parse(text_file.read(path))


def _object(pairs: list[tuple[str, object]]) -> dict[str, object]:
    content = dict(pairs)
    if len(content) == len(pairs):
        return content
    keys = [key for key, _ in pairs]
    doubled = _Doubled(content)
    doubled.key = next(key for index, key in enumerate(keys) if key in keys[:index])
    return doubled


def _refuse_constant(name: str) -> NoReturn:
    msg = f"{name} is no number of JSON: write a finite one"
    raise ValueError(msg)


def _require_single(content: object, place: str) -> None:
    if isinstance(content, _Doubled):
        msg = f"key {content.key!r} stands twice in {place or 'the outermost object'}: keep one"
        raise ValueError(msg)
    if isinstance(content, dict):
        for key, value in content.items():
            _require_single(value, f"{place}.{key}" if place else key)
    elif isinstance(content, list):
        for index, value in enumerate(content, start=1):
            _require_single(value, f"{place}[{index}]")
