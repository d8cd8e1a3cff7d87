"""Mutation testing: every small change of a module's code, and which of them its tests notice.

A mutant is a module with one operator, number, comparison, call or statement changed. Its tests run in a process of
their own, in which the mutant has the place of the module. That process is forked off one that has the libraries
loaded, so a mutant costs its tests' time and not a start of Python.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import importlib.abc
import importlib.util
import json
import os
import random
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
LONGEST = 60.0
"""s after which the tests of a mutant count as failed: it goes round in a circle."""
_LIBRARIES = (
    "numpy",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.stats",
    "hypothesis",
    "cmaes",
    "optuna",
    "mcap.reader",
    "yaml",
    "matplotlib",
)
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
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.Or: (ast.And,),
    ast.And: (ast.Or,),
}
_CALLS = {"min": "max", "max": "min", "any": "all", "all": "any"}
_PASSED, _FAILED = (0,), (1, 2, 4)
"""What pytest returns: 2 where a mutant cannot even be imported, 4 where a test is asked for by name then."""


def mutants(source: str, tables: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Return every mutant of a module: ``function: before -> after``, and its whole text.

    Docstrings, types, messages of errors and what stands outside functions stay.

    Args:
        source: Of the module.
        tables: Names of tables outside functions, of rows ``Kind("name of the row", field=value)``; what the
            fields are is changed too.
    """
    tree = ast.parse(source)
    found: list[tuple[str, str]] = []
    for owner, part, field in _carried_out(tree, tables):
        for place in _places(part, field):
            node = place.node
            for option in (*_replacements(node), *(_statements(node) if isinstance(node, ast.stmt) else ())):
                changed = ast.fix_missing_locations(ast.copy_location(option, node))
                before, after = (ast.unparse(part).splitlines()[0] for part in (node, changed))
                with place.holding(changed):
                    text = ast.unparse(tree)
                if _compiles(text):
                    found.append((f"{owner}: {before} -> {after}", text))
    return found


def _compiles(text: str) -> bool:
    """Whether Python takes a text without a warning: what it warns of, as ``is`` beside a number, is no mutant."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            compile(text, "mutant", "exec")
        except SyntaxError:  # so the compiler tells its warnings too, where they are errors
            return False
    return True


def _carried_out(tree: ast.AST, tables: Sequence[str]) -> list[tuple[str, ast.AST, str]]:
    """Return what is changed: functions' bodies and tables' rows, each as its name, its node and the field."""
    nodes = list(ast.walk(tree))
    bodies = [(node.name, node, "body") for node in nodes if isinstance(node, ast.FunctionDef)]
    values = {ast.unparse(node.target): node.value for node in nodes if isinstance(node, ast.AnnAssign)}
    rows: list[ast.Call] = [row for name in tables for row in values[name].elts]  # type: ignore[union-attr]
    return [*bodies, *((ast.literal_eval(row.args[0]), row, "keywords") for row in rows)]


class _Place:
    """Where a node stands in the tree."""

    def __init__(self, parent: ast.AST, field: str, index: int | None) -> None:
        self._parent, self._field, self._index = parent, field, index
        here = getattr(parent, field)
        self.node: ast.AST = here if index is None else here[index]

    @contextlib.contextmanager
    def holding(self, other: ast.AST) -> Iterator[None]:
        """Let another node stand there meanwhile."""
        self._put(other)
        yield
        self._put(self.node)

    def _put(self, node: ast.AST) -> None:
        if self._index is None:
            setattr(self._parent, self._field, node)
        else:
            getattr(self._parent, self._field)[self._index] = node


def _places(parent: ast.AST, *fields: str) -> Iterator[_Place]:
    """Yield the places of what is carried out, also in what it consists of, functions inside functions aside."""
    for field in fields or parent._fields:
        value = getattr(parent, field, None)
        indices = range(len(value)) if isinstance(value, list) else (None,)
        for index in indices:
            part = value if index is None else value[index]  # type: ignore[index]
            if isinstance(part, ast.AST) and field not in {"annotation", "ctx", "func"} and not _is_words(part):
                yield _Place(parent, field, index)
            if isinstance(part, ast.AST) and not _is_words(part) and field != "annotation":
                yield from _places(part)


def _is_words(node: ast.AST) -> bool:
    """Whether a node is a docstring, a message or a text with values in it, or a function of its own."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant)
    if isinstance(node, ast.Assign):
        return isinstance(node.targets[0], ast.Name) and node.targets[0].id == "msg"
    return isinstance(node, ast.JoinedStr | ast.FunctionDef)


def _replacements(node: ast.AST) -> list[ast.AST]:
    """Return what may stand in the place of an expression."""
    return [*_swapped(node), *_shortened(node), *_called_otherwise(node)]


def _swapped(node: ast.AST) -> list[ast.AST]:
    if isinstance(node, ast.BinOp | ast.BoolOp):
        return [_changed(node, "op", swap()) for swap in _SWAPS.get(type(node.op), ())]
    if isinstance(node, ast.Compare):
        return [
            _changed(node, "ops", [*node.ops[:index], swap(), *node.ops[index + 1 :]])
            for index, op in enumerate(node.ops)
            for swap in _SWAPS.get(type(op), ())
        ]
    return [ast.Constant(_other(node.value))] if isinstance(node, ast.Constant) else []


def _shortened(node: ast.AST) -> list[ast.AST]:
    if isinstance(node, ast.IfExp):
        return [node.body, node.orelse]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):  # of a longer chain the left part has the rest
        return [node.left] if isinstance(node.left, ast.BinOp) else [node.left, node.right]
    return [node.operand] if isinstance(node, ast.UnaryOp) else []


def _called_otherwise(node: ast.AST) -> list[ast.AST]:
    if not isinstance(node, ast.Call):
        return []
    if isinstance(node.func, ast.Name) and node.func.id in _CALLS:
        return [_changed(node, "func", ast.Name(_CALLS[node.func.id], ast.Load()))]
    is_check = isinstance(node.func, ast.Attribute) and node.func.attr in {"isfinite", "isnan"}
    return [ast.Constant(value=True), ast.Constant(value=False)] if is_check else []


def _other(value: object) -> bool | float | str:
    """Return another value than a constant's; in the place of None one that counts as true, for it is easily missed."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return "another" if isinstance(value, str) else 1.0


def _changed(node: ast.AST, field: str, value: object) -> ast.AST:
    """Return a copy of a node with one field changed."""
    changed = copy.deepcopy(node)
    setattr(changed, field, value)
    return changed


def _statements(node: ast.stmt) -> Iterator[ast.stmt]:
    """Yield what may stand in the place of a statement: nothing for an assignment or a call, never taken for an if."""
    if isinstance(node, ast.Assign | ast.AugAssign) or (
        isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    ):
        yield ast.Pass()
    if isinstance(node, ast.If):
        changed = copy.deepcopy(node)
        changed.test = ast.Constant(value=False)
        yield changed


def survivors(module: ModuleType, tests: Sequence[Path | str], texts: Sequence[str], folder: Path) -> list[int]:
    """Run tests on texts in the place of a module; return the places of those that no test notices.

    Args:
        module: What is replaced.
        tests: Files of tests or single ones (``file::name``), the quickest first.
        texts: Source of each mutant.
        folder: Empty, for files.

    Raises:
        AssertionError: The tests could not be run.
    """
    for number, text in enumerate(texts):
        (folder / f"{number}.py").write_text(text, encoding="utf-8")
    command = [sys.executable, __file__, module.__name__, str(folder), str(len(texts)), *map(str, tests)]
    paths = os.pathsep.join(path for path in sys.path if path)
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": paths}
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    codes = json.loads((folder / "codes.json").read_text(encoding="utf-8"))
    odd = {number: code for number, code in enumerate(codes) if code not in {*_PASSED, *_FAILED, -signal.SIGKILL}}
    assert odd == {}, (folder / f"{next(iter(odd))}.log").read_text(encoding="utf-8")[-2000:]
    return [number for number, code in enumerate(codes) if code in _PASSED]


def check_every_mutant(
    module: ModuleType,
    tests: Sequence[Path | str],
    equivalent: dict[str, str],
    folder: Path,
    *,
    tables: Sequence[str] = (),
    largest: int = 400,
) -> None:
    """Check that the module passes its tests and that each of its mutants is killed or explained.

    Args:
        module: What is changed.
        tests: Files of tests or single ones (``file::name``), the quickest first.
        equivalent: Mutants that do the same as the original, with the reason.
        folder: Empty, for files.
        tables: As `mutants` takes them.
        largest: Mutants that are tried at most; of more, a drawn but fixed choice.
    """
    source = Path(str(module.__file__)).read_text(encoding="utf-8")
    every = mutants(source, tables)
    total = len(every)
    gone = equivalent.keys() - {name for name, _ in every}
    assert gone == set(), f"explained and not there any more: {gone}"
    if len(every) > largest:  # drawn from all, so that an explanation more leaves the choice as it is
        every = random.Random(11).sample(every, len(every))[:largest]  # noqa: S311  (no secret)
    tried = [(name, text) for name, text in every if name not in equivalent]
    began = time.monotonic()
    alive = survivors(module, tests, [source, *(text for _, text in tried)], folder)
    print(  # noqa: T201
        f"{module.__name__}: {len(tried) + 1 - len(alive)} of {len(tried)} mutants killed, of {total} in all, "
        f"{len(equivalent)} explained; {time.monotonic() - began:.0f} s"
    )
    assert alive[:1] == [0], (folder / "0.log").read_text(encoding="utf-8")[-2000:]
    survived = [tried[number - 1][0] for number in alive[1:]]
    assert survived == [], f"nothing notices: {survived}"


class _InItsPlace(importlib.abc.MetaPathFinder):
    """Finds a mutant where its module is asked for."""

    def __init__(self, name: str, path: Path) -> None:
        self._name, self._path = name, path

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Return where the module comes from, None for any other one."""
        del path, target
        return importlib.util.spec_from_file_location(name, self._path) if name == self._name else None


def _run_one(name: str, folder: Path, number: int, tests: Sequence[str]) -> None:
    """Run the tests on one mutant in a forked process and end it."""
    from hypothesis import Phase, settings  # noqa: PLC0415

    log = os.open(folder / f"{number}.log", os.O_WRONLY | os.O_CREAT)
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.setsid()
    sys.meta_path.insert(0, _InItsPlace(name, folder / f"{number}.py"))
    # A failure need not be made small, and not be remembered for the next mutant.
    settings.register_profile("mutants", database=None, phases=(Phase.explicit, Phase.generate))
    settings.load_profile("mutants")
    base = f"--basetemp={folder / f'{number}.tmp'}"
    arguments = ["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=1", "-m", "not long", base, *tests]
    code = 1
    with contextlib.suppress(BaseException):
        code = int(pytest.main(arguments))
    os._exit(code)


def _run_all(name: str, folder: Path, count: int, tests: Sequence[str]) -> list[int]:
    """Return pytest's code for each mutant, as many at a time as there are cores."""
    for library in _LIBRARIES:
        importlib.import_module(library)
    codes = [0] * count
    running: dict[int, tuple[int, float]] = {}
    waiting = list(range(count))
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            number = waiting.pop(0)
            child = os.fork()
            if not child:
                _run_one(name, folder, number, tests)
            running[child] = number, time.monotonic()
        ended, status = os.waitpid(-1, os.WNOHANG)
        if ended:
            codes[running.pop(ended)[0]] = os.waitstatus_to_exitcode(status)
            continue
        for child, (_, began) in running.items():
            if time.monotonic() > began + LONGEST:
                os.killpg(child, signal.SIGKILL)
        time.sleep(0.01)
    return codes


if __name__ == "__main__":
    _name, _folder, _count, *_tests = sys.argv[1:]
    _codes = _run_all(_name, Path(_folder), int(_count), _tests)
    (Path(_folder) / "codes.json").write_text(json.dumps(_codes), encoding="utf-8")
