"""What ROS 2 would read in another way than people: the parameters on a node's command line, looked at before it does.

Its own reader of YAML takes the last of two equal keys, and 010 for 8.
"""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from fin_plant import text_file, yaml_file

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_NUMBERS = re.compile(r"[-+.0-9a-zA-Z_,\[\] ]*[0-9][-+.0-9a-zA-Z_,\[\] ]*")
"""One number, or a list of them, and whatever else has their letters."""


def refuse_doubtful(words: Sequence[str]) -> None:
    """Refuse parameters in doubt among the words of a command line.

    Args:
        words: All of them; what stands behind ``--ros-args`` is looked at. A file that can be read only once, as a
            pipe, is left to ROS.

    Raises:
        ValueError: A file of parameters or a value is in doubt; the message names file and line, or the parameter.
    """
    for option, word in pairwise(_for_ros(words)):
        if option == "--params-file" and (path := Path(word)).is_file():
            with text_file.named(path, "parameter file"):
                yaml_file.read(path)
        if option in {"-p", "--param"}:
            name, _, value = word.partition(":=")
            if _NUMBERS.fullmatch(value):
                _refuse_value(name, value)


def _refuse_value(name: str, value: str) -> None:
    try:
        yaml_file.parse(f"{name}: {value}")
    except ValueError as error:
        raise ValueError(str(error).removeprefix("line 1: ")) from None


def _for_ros(words: Sequence[str]) -> Iterator[str]:
    """Yield the words between ``--ros-args`` and ``--``."""
    inside = False
    for word in words:
        if word in {"--ros-args", "--"}:
            inside = word == "--ros-args"
        elif inside:
            yield word
