"""One reader for all YAML files: what is read is what stands there, or the line that is in doubt is refused.

PyYAML follows YAML 1.1, where the last of two equal keys wins, `010` is 8, `1e1` is a text, `12:30` is 750 and `on` is
true. Here the core schema of YAML 1.2 holds, and what people read in two ways is refused.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, NoReturn

import yaml

from fin_plant import text_file

if TYPE_CHECKING:
    from pathlib import Path

LARGEST = 2_000_000
"""Letters of a YAML text: PyYAML takes some ten seconds for them."""
_TAG = "tag:yaml.org,2002:"
# What a number may look like that one reader takes for another number than the next.
_OTHER_BASES = re.compile(r"[-+]?0[0-9]+|[-+]?0[obOB][0-9]+")


class _Loader(yaml.SafeLoader):
    """Loads text, numbers, true, false, null, lists and mappings; each key once, and nothing by reference."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]  # PyYAML has no types here
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            _refuse("anchors and references (& and *) are not read here: write the value out", event.start_mark)
        if getattr(event, "tag", None) not in {None, "!"}:
            _refuse(f"tags ({event.tag}) are not read here: write the plain value", event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        lines: dict[str, int] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag != f"{_TAG}str" or key.value == "<<":
                shown = getattr(key, "value", key)
                _refuse(f"key {shown!r} must be a plain name", key.start_mark)
            if key.value in lines:
                msg = f"key {key.value} stands twice, first in line {lines[key.value]}: keep one"
                _refuse(msg, key.start_mark)
            lines[key.value] = key.start_mark.line + 1
            for item in value.value if isinstance(value, yaml.SequenceNode) else (value,):
                _refuse_other_bases(key.value, item)
        return super().construct_mapping(node, deep=deep)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Merge nothing."""

    def construct_number(self, node: yaml.ScalarNode) -> int | float:
        text = node.value.lower()
        if node.tag == f"{_TAG}float":
            return float(text.replace(".inf", "inf").replace(".nan", "nan"))
        return int(text, 16 if "x" in text else 10)

    def construct_truth(self, node: yaml.ScalarNode) -> bool:
        return bool(node.value.lower() == "true")


_Loader.yaml_implicit_resolvers = {}  # those of YAML 1.1
for _kind, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", "~nN\0"),
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?(?:0|[1-9][0-9]*)|0x[0-9a-fA-F]+", "-+0123456789"),
    ("float", r"[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?", "-+.0123456789"),
    ("float", r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", "-+."),
):
    _starts = [letter if letter != "\0" else "" for letter in _first]
    _Loader.add_implicit_resolver(f"{_TAG}{_kind}", re.compile(rf"(?:{_pattern})\Z"), _starts)
for _kind in ("int", "float"):
    _Loader.add_constructor(f"{_TAG}{_kind}", _Loader.construct_number)
_Loader.add_constructor(f"{_TAG}bool", _Loader.construct_truth)


def _refuse(problem: str, mark: yaml.Mark | None) -> NoReturn:
    raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


def _refuse_other_bases(key: str, item: yaml.Node) -> None:
    """Refuse `010`: eight to one reader of YAML, ten to the next."""
    if isinstance(item, yaml.ScalarNode) and item.style is None and _OTHER_BASES.fullmatch(item.value):
        msg = f"{key}: {item.value} is read as octal by some and as decimal by others: write it without leading zero"
        _refuse(msg, item.start_mark)


def parse(text: str) -> object:
    """Return what a YAML text says.

    Raises:
        ValueError: It is no YAML, is empty or too large, holds several documents, or something in it can be read in two
            ways; the message names the line, and the key.
    """
    if len(text) > LARGEST:
        msg = f"it holds {len(text) / 1e6:.3g} million letters, more than {LARGEST / 1e6:g}: is it another file?"
        raise ValueError(msg)
    try:
        content = yaml.load(text.removeprefix("\ufeff"), _Loader)  # noqa: S506  (a SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f"line {mark.line + 1}: " if mark is not None else ""
        msg = f"{line}{error.problem or error.context or 'no YAML'}"
        raise ValueError(msg) from None
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from None
    except RecursionError:
        msg = "it is nested too deeply"
        raise ValueError(msg) from None
    if content is None:
        msg = "it is empty"
        raise ValueError(msg)
    return content


def read(path: Path) -> object:
    """Return what a YAML file says; see `parse`.

    Raises:
        ValueError: It is refused, or no text in UTF-8.
        OSError: It cannot be read.
    """
    return parse(text_file.read(path))
