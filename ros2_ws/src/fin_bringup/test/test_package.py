"""What `colcon test` runs: the unit tests of this package, which stand with those of the others in the folder tests.

Graph tests, which start the real nodes, are run by `make test`.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1].name
REPOSITORY = Path(__file__).resolve().parents[4]
LIST = REPOSITORY / "tests" / "support" / "source_tree.py"


@pytest.mark.timeout(1800)
def test_the_unit_tests_of_the_package() -> None:
    if not LIST.is_file():
        pytest.skip(f"the tests of {PACKAGE} are in the folder tests of its repository, and only the package is here")
    files = subprocess.run(
        [sys.executable, LIST, PACKAGE], stdout=subprocess.PIPE, text=True, check=True
    ).stdout.split()
    assert files
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", *files], cwd=REPOSITORY, check=False)
    assert done.returncode == 0
