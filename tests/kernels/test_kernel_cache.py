"""Compiled kernels are kept by what they are made of, where a place for them is writable, and only ours are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from farside.engine.kernels.base import kernel_cache
from farside.engine.kernels.rendering import fill

# A kernel in a package of its own that inlines a function from another file.
CALLEE = "from .jit import inlined\n\n@inlined\ndef factor():\n    return {factor}\n"
CALLER = """
from .base.callee import factor
from .base.jit import serial

@serial
def scaled(x):
    return x * factor()

if __name__ == "__main__":
    print(scaled(1.0), sum(scaled.stats.cache_hits.values()))
"""
ENGINE = Path(kernel_cache.__file__).parents[2]


@pytest.fixture
def package(tmp_path: Path) -> Path:
    base = tmp_path / "pack" / "kernels" / "base"
    base.mkdir(parents=True)
    for folder in (base, base.parent, base.parents[1]):
        (folder / "__init__.py").touch()
    for name in ("jit", "kernel_cache"):
        (base / f"{name}.py").write_text((ENGINE / "kernels" / "base" / f"{name}.py").read_text())
    (base / "callee.py").write_text(CALLEE.format(factor=2))
    (base.parent / "caller.py").write_text(CALLER)
    return tmp_path


def run(package: Path, **environment: str) -> tuple[str, str]:
    """What a process of its own prints: the result, whether the kernel was loaded; and on the error output."""
    ours = ("NUMBA_", "XDG_CACHE", "_FARSIDE")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    told = subprocess.run(
        [sys.executable, "-m", "pack.kernels.caller"], cwd=package, env={**kept, **environment}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    return told.stdout.strip(), told.stderr


def test_a_kernel_is_compiled_again_when_only_a_function_that_it_inlines_has_changed(package: Path) -> None:
    cache = str(package / "cache")
    assert run(package, XDG_CACHE_HOME=cache) == ("2.0 0", "")
    assert run(package, XDG_CACHE_HOME=cache) == ("2.0 1", "")
    (package / "pack" / "kernels" / "base" / "callee.py").write_text(CALLEE.format(factor=3))
    assert run(package, XDG_CACHE_HOME=cache) == ("3.0 0", "")
    assert run(package, XDG_CACHE_HOME=cache) == ("3.0 1", "")
    (package / "pack" / "kernels" / "base" / "callee.py").write_text(CALLEE.format(factor=2))
    assert run(package, XDG_CACHE_HOME=cache) == ("2.0 1", "")  # the first one is still there
    assert not list((package / "pack").rglob("*.nbi"))


def test_where_nothing_is_writable_kernels_run_and_it_is_said_once(package: Path) -> None:
    nowhere = "/proc/nowhere"
    out, told = run(package, XDG_CACHE_HOME=nowhere, NUMBA_CACHE_DIR=nowhere)
    assert out == "2.0 0"
    assert told.count("\n") == 1
    assert told.startswith("farside: no place for compiled kernels is writable")
    assert run(package, HOME="", XDG_CACHE_HOME=nowhere, _FARSIDE_TOLD_THAT_NO_KERNELS_ARE_KEPT="1") == ("2.0 0", "")


def test_the_folder_that_numba_is_told_comes_first(package: Path) -> None:
    run(package, NUMBA_CACHE_DIR=str(package / "numba"), XDG_CACHE_HOME=str(package / "cache"))
    assert list((package / "numba").rglob("*.nbi"))
    assert not (package / "cache").exists()


def test_a_folder_that_is_not_used_any_more_is_removed(package: Path) -> None:
    kernels = package / "cache" / "farside" / "kernels"
    old, other = kernels / "caller-0123456789abcdef", kernels / "something else"
    for folder in (old, other):
        folder.mkdir(parents=True)
        os.utime(folder, (0, 0))
    run(package, XDG_CACHE_HOME=str(package / "cache"))
    assert not old.exists()
    assert other.exists()


def test_a_file_depends_on_all_that_it_imports() -> None:
    found = {str(path.relative_to(ENGINE)) for path in kernel_cache._all_imported(Path(fill.__file__))}
    assert "kernels/rendering/fill.py" in found
    assert "kernels/base/jit.py" in found
    assert "support/array_types.py" in found
    assert "kernels/background/pbi.py" not in found
    for path in ENGINE.joinpath("kernels").rglob("*.py"):
        for imported in kernel_cache._all_imported(path):
            assert imported.is_relative_to(ENGINE)


def test_what_others_compile_in_this_process_is_kept_where_it_was() -> None:
    before = numba.config.CACHE_DIR
    with kernel_cache.keeping(Path(fill.__file__)) as kept:
        assert (before != numba.config.CACHE_DIR) == kept
    assert before == numba.config.CACHE_DIR
