"""Mutation testing of the safety module: every small change of its code is noticed by its tests.

A mutant is `safety.py` with one operator, number, comparison or call changed. It is put in the place of the real module
in a process of its own, which runs `test_safety.py`. A mutant that the tests let live is a failure, unless it stands in
`EQUIVALENT` with the reason why it does the same.
"""

from __future__ import annotations

import ast
import copy
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from fin_servo_driver import safety

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.long
SOURCE = Path(safety.__file__)
TESTS = Path(__file__).with_name("test_safety.py")
ROOT = Path(__file__).resolve().parents[2]
EQUIVALENT = {
    "within_rate: elapsed <= 0.0 -> elapsed < 0.0": "no time gives a reach of 0, hence the same angle",
}
"""Mutants that do the same as the original, with the reason."""

_SWAPS: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.Or: (ast.And,),
    ast.And: (ast.Or,),
}
_CALLS = {"min": "max", "max": "min"}


def replacements(node: ast.AST) -> list[ast.AST]:
    """Return what may stand in the place of an expression."""
    return [*_swapped(node), *_shortened(node), *_called_otherwise(node)]


def _swapped(node: ast.AST) -> list[ast.AST]:
    if isinstance(node, ast.BinOp | ast.BoolOp):
        return [_changed(node, "op", swap()) for swap in _SWAPS.get(type(node.op), ())]
    if isinstance(node, ast.Compare):
        return [_changed(node, "ops", [swap()]) for swap in _SWAPS.get(type(node.ops[0]), ())]
    return [ast.Constant(_other(node.value))] if isinstance(node, ast.Constant) else []


def _shortened(node: ast.AST) -> list[ast.AST]:
    if isinstance(node, ast.IfExp):
        return [node.body, node.orelse]
    return [node.operand] if isinstance(node, ast.UnaryOp) else []


def _called_otherwise(node: ast.AST) -> list[ast.AST]:
    if not isinstance(node, ast.Call):
        return []
    if isinstance(node.func, ast.Name) and node.func.id in _CALLS:
        return [_changed(node, "func", ast.Name(_CALLS[node.func.id], ast.Load()))]
    is_check = isinstance(node.func, ast.Attribute) and node.func.attr == "isfinite"
    return [ast.Constant(value=True), ast.Constant(value=False)] if is_check else []


def _other(value: object) -> bool | float:
    """Return another value than a constant's."""
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int | float) else 0.0


def _changed(node: ast.AST, field: str, value: object) -> ast.AST:
    """Return a copy of a node with one field changed."""
    changed = copy.deepcopy(node)
    setattr(changed, field, value)
    return changed


def statements(node: ast.stmt) -> Iterator[ast.stmt]:
    """Yield what may stand in the place of a statement: nothing for an assignment or a call, never taken for an if."""
    if isinstance(node, ast.Assign | ast.AugAssign) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield ast.Pass()
    if isinstance(node, ast.If):
        changed = copy.deepcopy(node)
        changed.test = ast.Constant(value=False)
        yield changed


class _Replace(ast.NodeTransformer):
    """Puts one node in the place of another, told by where it is in the walk."""

    def __init__(self, target: ast.AST, replacement: ast.AST) -> None:
        self._target, self._replacement = target, replacement

    def visit(self, node: ast.AST) -> ast.AST:
        """Replace the target, go on elsewhere."""
        return self._replacement if node is self._target else super().visit(node)


def bodies(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield every function with its name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield node.name, node


def all_mutants() -> list[tuple[str, str]]:
    """Return every mutant; the tree is parsed anew for each, so that none carries another's change."""
    source = SOURCE.read_text(encoding="utf-8")
    found = []
    count = len(list(ast.walk(ast.parse(source))))
    for place in range(count):
        number = 0
        while True:
            tree = ast.parse(source)
            node = list(ast.walk(tree))[place]
            options = [*replacements(node), *(statements(node) if isinstance(node, ast.stmt) else ())]
            if number >= len(options) or not _inside_a_function(tree, node):
                break
            replacement = ast.copy_location(options[number], node)
            before, after = (ast.unparse(part).splitlines()[0] for part in (node, replacement))
            name = _inside_a_function(tree, node)
            text = ast.unparse(ast.fix_missing_locations(_Replace(node, replacement).visit(tree)))
            found.append((f"{name}: {before} -> {after}", text))
            number += 1
    return found


def _inside_a_function(tree: ast.Module, node: ast.AST) -> str:
    for name, function in bodies(tree):
        if any(node is part for line in function.body for part in _walk_code(line)):
            return name
    return ""


def _walk_code(line: ast.stmt) -> Iterator[ast.AST]:
    """Yield the nodes of a statement that are carried out: neither docstrings nor types."""
    if isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant):
        return
    for part in ast.walk(line):
        typed = [other for other in ast.walk(line) if isinstance(other, ast.AnnAssign)]
        if not any(part is inner for other in typed for inner in ast.walk(other.annotation)):
            yield part


def is_killed(source: str, folder: Path) -> bool:
    """Run the safety tests on a mutant; return whether one of them fails."""
    folder.mkdir()
    (folder / "mutant.py").write_text(source, encoding="utf-8")
    (folder / "run.py").write_text(
        "import importlib.util, sys, pytest\n"
        "spec = importlib.util.spec_from_file_location('fin_servo_driver.safety', sys.argv[1])\n"
        "module = importlib.util.module_from_spec(spec)\n"
        "sys.modules['fin_servo_driver.safety'] = module\n"
        "spec.loader.exec_module(module)\n"
        "sys.exit(pytest.main(['-x', '-q', '-p', 'no:cacheprovider', '--hypothesis-seed=1', sys.argv[2]]))\n",
        encoding="utf-8",
    )
    command = [sys.executable, str(folder / "run.py"), str(folder / "mutant.py"), str(TESTS)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120.0)
    assert done.returncode in {0, 1, 2}, done.stdout + done.stderr
    return done.returncode != 0


def test_the_unchanged_module_passes_and_there_are_mutants_of_every_kind(tmp_path: Path) -> None:
    assert not is_killed(SOURCE.read_text(encoding="utf-8"), tmp_path / "original")
    names = {name.partition(":")[0] for name, _ in all_mutants()}
    assert names >= {"within_angle", "within_rate", "limit", "restart", "feed", "forget", "expired"}


@pytest.mark.timeout(1500)
def test_every_mutant_of_the_safety_module_is_killed_or_explained(tmp_path: Path) -> None:
    candidates = [(name, text) for name, text in all_mutants() if name not in EQUIVALENT]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        folders = (tmp_path / str(number) for number in range(len(candidates)))
        killed = list(pool.map(is_killed, (text for _, text in candidates), folders))
    alive = [name for (name, _), dead in zip(candidates, killed, strict=True) if not dead]
    print(f"{sum(killed)} of {len(candidates)} mutants killed, {len(EQUIVALENT)} explained")  # noqa: T201
    assert alive == [], "\n".join(alive)
