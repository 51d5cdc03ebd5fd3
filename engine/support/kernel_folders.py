"""The folders of compiled kernels, without the compiler: where they are, and what each is named after."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

__all__ = ["SHIPPED", "base_folder", "bases", "digest", "folder_of", "tell_once", "user_cache"]

_KEPT_S = 30 * 24 * 3600.0  # a folder that no run has used for this long is removed
_TOLD = "_FARSIDE_TOLD_THAT_NO_KERNELS_ARE_KEPT"
_ENGINE = Path(__file__).resolve().parents[1]
SHIPPED = _ENGINE / "kernels" / "compiled"
"""Kernels that came with the installation: a folder for each CPU level."""
_VERSIONS = f"{version('numba')} {version('llvmlite')} {'.'.join(map(str, sys.version_info[:2]))}"
_IMPORT = re.compile(r"^from (\.+)([\w.]*) import", re.MULTILINE)


def digest(source: Path) -> str:
    """What the kernels of a file depend on, in 16 characters: it, all files that it imports, how they are compiled
    (`kernels.base.jit`), and the compiler."""
    found = hashlib.sha256(_VERSIONS.encode())
    for path in sorted(_all_imported(source.resolve()) | _all_imported(_ENGINE / "kernels" / "base" / "jit.py")):
        found.update(f"{os.path.relpath(path, _ENGINE)}\0".encode() + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]


def folder_of(source: Path) -> str:
    """The name of the folder of a file's kernels, in each folder of `bases`."""
    return f"{source.stem}-{digest(source)}"


def _all_imported(source: Path) -> set[Path]:
    """A file and the files that it imports, directly or not."""
    found, left = {source}, [source]
    while left:
        new = _imported(left.pop()) - found
        found |= new
        left += new
    return found


@functools.cache
def _imported(source: Path) -> frozenset[Path]:
    """Files that a file imports from our packages; of a package, all files."""
    found: set[Path] = set()
    for dots, name in _IMPORT.findall(source.read_text("utf-8")):
        place = source.parents[len(dots) - 1].joinpath(*name.split("."))
        found |= set(place.glob("*.py")) if place.is_dir() else {place.with_suffix(".py")}
    return frozenset(path for path in found if path.is_file())


@functools.cache
def base_folder() -> Path | None:
    """The folder below which kernels are kept; None if none is writable, which is said on the error output.

    $NUMBA_CACHE_DIR, if that is set and writable, otherwise `kernels` in `user_cache`.
    """
    for base in bases():
        with contextlib.suppress(OSError):
            base.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=base).close()
            _remove_old(base)
            return base
    if not SHIPPED.is_dir():
        said = "no place for compiled kernels is writable, so every run compiles them"
        tell_once(f"{said}: set XDG_CACHE_HOME to a folder that is")
    return None


def bases() -> Iterator[Path]:
    """Folders below which kernels may be, the preferred one first; one that is not writable may still be read."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(chosen)
    with contextlib.suppress(RuntimeError):  # there is no home
        yield user_cache() / "kernels"


def user_cache() -> Path:
    """The program's folder in the user's cache: in $XDG_CACHE_HOME, if that is an absolute path (XDG Base Directory
    Specification), or in .cache in the home folder. Raises RuntimeError where there is no home."""
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (chosen if chosen.is_absolute() else Path("~/.cache").expanduser()) / "farside"


def tell_once(what: str) -> None:
    """Say something once, in this process and its children."""
    if _TOLD not in os.environ:
        os.environ[_TOLD] = "1"
        print(f"farside: {what}", file=sys.stderr)


def _remove_old(base: Path) -> None:
    for folder in base.glob("*-" + "[0-9a-f]" * 16):
        with contextlib.suppress(OSError):
            if time.time() - folder.stat().st_mtime > _KEPT_S:
                for note in base.glob("all-for-*"):  # that all kernels for a use are there (`compiling.pool`)
                    note.unlink()
                shutil.rmtree(folder, ignore_errors=True)
