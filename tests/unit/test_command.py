"""How commands end: one form of error line, argparse's own, and the same exit codes."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from fin_plant.command import command, error_line
from support.processes import ROOT

if TYPE_CHECKING:
    from collections.abc import Sequence

SOURCES = sorted((ROOT / "ros2_ws/src").glob("*/*/**/*.py"))
EXIT_CODES = [
    (ValueError("a must be 1"), 2, "swim: error: a must be 1\n"),
    (
        FileNotFoundError(2, "No such file or directory", "a.yaml"),
        2,
        "swim: error: a.yaml: No such file or directory\n",
    ),
    (OSError("the disk is gone"), 2, "swim: error: the disk is gone\n"),
    (ArithmeticError("it diverged"), 1, "swim: error: it diverged\n"),
    (KeyboardInterrupt(), 130, ""),
]


@pytest.mark.parametrize(("error", "code", "line"), EXIT_CODES)
def test_a_command_ends_with_one_line_and_a_code(
    error: BaseException, code: int, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    @command("swim", failures=(ArithmeticError,))
    def main(arguments: Sequence[str] | None = None) -> int:
        raise error

    assert main([]) == code
    assert tuple(capsys.readouterr()) == ("", line)


def test_a_defect_is_not_passed_off_as_bad_input() -> None:
    @command("swim")
    def main(arguments: Sequence[str] | None = None) -> int:
        raise KeyError(arguments)

    with pytest.raises(KeyError):
        main([])


def test_the_line_is_the_one_that_argparse_writes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        argparse.ArgumentParser(prog="swim", usage="").error("a must be 1")
    assert capsys.readouterr().err.splitlines()[-1] == error_line("swim", "a must be 1")


def test_a_full_disk_behind_the_output_is_one_line_after_which_nothing_is_said() -> None:
    script = (
        "from fin_plant.command import command\n"
        "main = command('swim')(lambda arguments=None: print('much') or 0)\n"
        "raise SystemExit(main())"
    )
    with open("/dev/full", "w", encoding="utf-8") as full:  # noqa: PTH123  (a device)
        ended = subprocess.run(
            [sys.executable, "-c", script], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (ended.returncode, ended.stderr) == (2, "swim: error: [Errno 28] No space left on device\n")


def test_no_source_has_an_error_line_of_its_own() -> None:
    own = [path for path in SOURCES if re.search(r"""["'](\w+: )?error: """, path.read_text(encoding="utf-8"))]
    assert own == []
