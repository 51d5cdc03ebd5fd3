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
from farside.engine.support import kernel_folders
from numba.core import caching

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
    support = tmp_path / "pack" / "support"
    support.mkdir()
    for folder in (base, base.parent, base.parents[1], support):
        (folder / "__init__.py").touch()
    copied = ("jit", "kernel", "kernel_cache", "outline", "private", "share")
    for path in (*(f"kernels/base/{name}" for name in copied), "support/kernel_folders"):
        (tmp_path / "pack" / f"{path}.py").write_text((ENGINE / f"{path}.py").read_text())
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
    assert not list((package / "pack").rglob("*.nbc"))


def test_where_nothing_is_writable_kernels_run_and_it_is_said_once(package: Path) -> None:
    nowhere = "/proc/nowhere"
    out, told = run(package, XDG_CACHE_HOME=nowhere, NUMBA_CACHE_DIR=nowhere)
    assert out == "2.0 0"
    assert told.count("\n") == 1
    assert told.startswith("farside: no place for compiled kernels is writable")
    assert run(package, HOME="", XDG_CACHE_HOME=nowhere, _FARSIDE_TOLD_THAT_NO_KERNELS_ARE_KEPT="1") == ("2.0 0", "")


def test_the_folder_that_numba_is_told_comes_first(package: Path) -> None:
    run(package, NUMBA_CACHE_DIR=str(package / "numba"), XDG_CACHE_HOME=str(package / "cache"))
    assert list((package / "numba").rglob("*.nbc"))
    assert not (package / "cache").exists()


def test_a_folder_that_is_not_used_any_more_is_removed(package: Path) -> None:
    kernels = package / "cache" / "farside" / "kernels"
    old, other, note = kernels / "caller-0123456789abcdef", kernels / "something else", kernels / "all-for-fast-0123"
    for folder in (old, other):
        folder.mkdir(parents=True)
        os.utime(folder, (0, 0))
    note.touch()
    run(package, XDG_CACHE_HOME=str(package / "cache"))
    assert not old.exists()
    assert not note.exists()  # it said that nothing is missing
    assert other.exists()


def test_a_file_depends_on_all_that_it_imports() -> None:
    found = {str(path.relative_to(ENGINE)) for path in kernel_folders._all_imported(Path(fill.__file__))}
    assert "kernels/rendering/fill.py" in found
    assert "kernels/base/jit.py" in found
    assert "support/array_types.py" in found
    assert "kernels/background/pbi.py" not in found
    for path in ENGINE.joinpath("kernels").rglob("*.py"):
        for imported in kernel_folders._all_imported(path):
            assert imported.is_relative_to(ENGINE)


def test_what_others_compile_in_this_process_is_kept_where_it_was() -> None:
    before = numba.config.CACHE_LOCATOR_CLASSES, caching.IndexDataCacheFile
    with kernel_cache.keeping(Path(fill.__file__)) as kept:
        assert (before != (numba.config.CACHE_LOCATOR_CLASSES, caching.IndexDataCacheFile)) == kept
    assert before == (numba.config.CACHE_LOCATOR_CLASSES, caching.IndexDataCacheFile)


def test_kernels_can_be_moved_with_their_installation_and_their_folder(package: Path) -> None:
    assert run(package, XDG_CACHE_HOME=str(package / "cache")) == ("2.0 0", "")
    elsewhere = package / "else where"
    elsewhere.mkdir()
    (package / "pack").rename(elsewhere / "pack")
    (package / "cache").rename(elsewhere / "cache")
    assert run(elsewhere, XDG_CACHE_HOME=str(elsewhere / "cache")) == ("2.0 1", "")


def test_kernels_that_came_with_the_installation_are_loaded_where_nothing_is_writable(package: Path) -> None:
    run(package, XDG_CACHE_HOME=str(package / "cache"))
    (package / "pack" / "kernels" / "compiled").mkdir()
    (package / "cache" / "farside" / "kernels").rename(package / "pack" / "kernels" / "compiled" / "some level")
    assert run(package, XDG_CACHE_HOME="/proc/nowhere", HOME="/proc/nowhere") == ("2.0 1", "")


def test_a_damaged_kernel_is_compiled_again(package: Path) -> None:
    cache = str(package / "cache")
    run(package, XDG_CACHE_HOME=cache)
    (kept,) = (package / "cache").rglob("*.nbc")
    whole = kept.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"\0" + whole, whole[:-40] + b"?" * 40):
        kept.write_bytes(damaged)
        assert run(package, XDG_CACHE_HOME=cache) == ("2.0 0", "")
        assert run(package, XDG_CACHE_HOME=cache) == ("2.0 1", "")


def test_a_private_kernel_is_kept_without_machine_code(package: Path) -> None:
    caller = package / "pack" / "kernels" / "caller.py"
    twice = "@serial\ndef _twice(x):\n    return x * 2.0\n\n"
    text = caller.read_text().replace("return x * factor()", "return _twice(x)")
    caller.write_text(text.replace("@serial\n", f"{twice}@serial\n"))
    cache = str(package / "cache")
    assert run(package, XDG_CACHE_HOME=cache) == ("2.0 0", "")
    kept = {path.name.split("-")[0]: path for path in (package / "cache").rglob("*.nbc")}
    assert sorted(kept) == ["caller._twice", "caller.scaled"]
    holds_code = {name: b"\x7fELF" in path.read_bytes() for name, path in kept.items()}
    assert holds_code == {"caller._twice": False, "caller.scaled": True}
    kept["caller.scaled"].unlink()
    assert run(package, XDG_CACHE_HOME=cache) == ("2.0 0", "")  # compiled again, with the private one that was kept
    assert kept["caller.scaled"].is_file()


def test_processes_that_compile_at_once_forget_nothing(package: Path) -> None:
    """Each compiles the function for types of its own; then all of them are there."""
    kinds = ("1.0", "1", "np.float32(1)", "True", "np.int8(1)", "np.uint16(1)")
    code = "import numpy as np; from pack.kernels.caller import scaled as f; f({}); print(sum(f.stats.{}.values()))"
    options = {
        "cwd": package, "stdout": subprocess.PIPE, "text": True,
        "env": {**os.environ, "XDG_CACHE_HOME": str(package / "cache"), "NUMBA_CACHE_DIR": ""},
    }  # fmt: skip

    def counts(of: str) -> list[str]:
        running = [subprocess.Popen([sys.executable, "-c", code.format(kind, of)], **options) for kind in kinds]
        return [process.communicate()[0].strip() for process in running]

    assert counts("cache_misses") == ["1"] * len(kinds)
    assert counts("cache_hits") == ["1"] * len(kinds)
