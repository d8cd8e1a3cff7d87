"""What is loaded as code lies where nobody else can have put it."""

from __future__ import annotations

import importlib.util
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from fin_plant.private_folder import is_private, private_folder


@pytest.fixture
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path / "cache" / f"code-{os.getuid()}"


def test_it_lies_in_the_users_cache_and_is_open_to_nobody_else(cache: Path) -> None:
    before = os.umask(0)
    try:
        assert private_folder("code") == cache
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert private_folder("code") == cache


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o1777])
def test_a_folder_that_others_could_have_filled_is_not_used(cache: Path, mode: int) -> None:
    cache.mkdir(parents=True)
    cache.chmod(mode)
    other = private_folder("code")
    assert other != cache
    assert is_private(other)


def test_a_link_in_its_place_is_not_followed(cache: Path, tmp_path: Path) -> None:
    prepared = tmp_path / "prepared"
    prepared.mkdir(mode=0o700)
    cache.parent.mkdir()
    cache.symlink_to(prepared)
    assert private_folder("code") != cache
    assert not list(prepared.iterdir())


def test_a_folder_whose_place_others_can_take_is_not_used(cache: Path, tmp_path: Path) -> None:
    cache.mkdir(parents=True, mode=0o700)
    cache.parent.chmod(0o777)
    assert not is_private(cache)
    cache.parent.chmod(0o1777)
    assert is_private(cache)
    assert tmp_path in private_folder("code").parents


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_is_not_used(cache: Path) -> None:
    cache.mkdir(parents=True, mode=0o700)
    os.chown(cache, 12345, 12345)
    assert private_folder("code") != cache


@pytest.mark.parametrize("environment", [{"HOME": "/proc/no"}, {"XDG_CACHE_HOME": "relative", "HOME": "/proc/no"}])
def test_without_a_home_it_is_a_fresh_one_that_goes_with_the_process(
    environment: dict[str, str], tmp_path: Path
) -> None:
    code = (
        "import os, fin_sim.compiled, fin_plant.private_folder as p; f = os.environ['NUMBA_CACHE_DIR']; "
        "print(f, p.is_private(p.Path(f)))"
    )
    unset = {name: value for name, value in os.environ.items() if name not in {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME"}}
    result = subprocess.run(
        [sys.executable, "-c", code],
        env=unset | environment | {"PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    folder, private = result.stdout.split()
    assert (Path(folder).parent, private) == (tmp_path, "True")
    assert not Path(folder).exists()


def test_a_kernel_is_compiled_once_for_all_paths_to_its_source(tmp_path: Path) -> None:
    source = tmp_path / "source" / "twice.py"
    source.parent.mkdir()
    source.write_text("from fin_sim.compiled import kernel\n\n\n@kernel\ndef twice(x):\n    return 2.0 * x\n")
    (tmp_path / "link").symlink_to(source.parent)
    specification = importlib.util.spec_from_file_location("twice", tmp_path / "link" / source.name)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    assert module.twice.py_func.__code__.co_filename == str(source)  # by which numba keeps machine code
