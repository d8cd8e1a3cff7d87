"""What the packages of the workspace consist of, read from their sources without importing them.

    python tests/support/source_tree.py PACKAGE

prints the unit tests of a package, for `colcon test`.
"""

from __future__ import annotations

import ast
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

SOURCE = Path(__file__).resolve().parents[2] / "ros2_ws" / "src"
UNIT_TESTS = SOURCE.parents[1] / "tests" / "unit"
PACKAGES = ("fin_plant", "fin_sim", "fin_servo_driver", "fin_optimizer", "fin_bringup")
"""Each after those that it may import."""


def modules(package: str) -> dict[str, Path]:
    """Return a package's modules by their dotted names."""
    root = SOURCE / package
    found = {}
    for path in sorted((root / package).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


# Sources are read once: half of the layering's tests would be parsing them again.
@cache
def imported(path: Path) -> frozenset[str]:
    """Return the dotted names that a source file imports, wherever in the file; those for type checking too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return frozenset(names)


@cache
def imported_at_start(path: Path) -> frozenset[str]:
    """Return the dotted names of modules that are imported while a source file is; not those for type checking."""
    names: set[str] = set()
    statements = list(ast.parse(path.read_text()).body)
    for node in statements:
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.With | ast.Try):
            statements.extend(node.body)
    return frozenset(names)


def loaded_at_start(name: str, of: Mapping[str, Path]) -> set[str]:
    """Return the dotted names of everything that is imported while a module is, as far as these modules say."""
    loaded: set[str] = set()
    waiting = [name]
    while waiting:
        parts = waiting.pop().split(".")
        for new in {".".join(parts[:count]) for count in range(1, len(parts) + 1)} - loaded:
            loaded.add(new)
            if new in of:
                waiting.extend(imported_at_start(of[new]))
    return loaded


def imported_packages(path: Path) -> set[str]:
    """Return the top-level names that a source file imports."""
    return {name.partition(".")[0] for name in imported(path)}


def long_functions(source: str, lines: int) -> list[str]:
    """Return the functions of a source that have more lines than these, but for those that `fin_sim.compiled` compiles.

    A kernel is compiled as a whole and slower in pieces; it is known by its decorator.
    """
    tree = ast.parse(source)
    compilers = {
        alias.asname or alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and node.module == "fin_sim.compiled"
        for alias in node.names
    }
    return [
        f"{node.name}, {length} lines"
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (length := (node.end_lineno or node.lineno) - node.lineno + 1) > lines
        and not compilers & {ast.unparse(decorator) for decorator in node.decorator_list}
    ]


def unit_tests(package: str) -> list[Path]:
    """Return the unit tests of a package: those that import it, and none that comes after it.

    The last package also has those that import none: they are about the workspace as a whole.
    """
    found = []
    for path in sorted(UNIT_TESTS.glob("test_*.py")):
        names = imported_packages(path)
        if package == next((name for name in reversed(PACKAGES) if name in names), PACKAGES[-1]):
            found.append(path)
    return found


if __name__ == "__main__":
    sys.stdout.write("".join(f"{path}\n" for path in unit_tests(sys.argv[1])))
