"""The folder of a new sequence, which appears as a whole or not at all."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
from pathlib import Path

from .file_names import entries
from .tmiv_json import read_json
from .yuv import PIXEL_FORMATS

__all__ = ["NewSequence", "hidden_folder", "is_being_written"]

_MARK = ".farside-unfinished"
_VIDEO = re.compile(rf".+_(?:texture|depth)_\d+x\d+_{PIXEL_FORMATS}\.yuv")


def hidden_folder(path: Path | str) -> Path:
    """Where a sequence is while it is being written, if its folder did not exist before or does so now."""
    whole = Path(path).resolve()
    home = whole if whole.exists() else whole.parent
    return home / f".{whole.name}{_MARK}"


def is_being_written(path: Path | str) -> bool:
    """Whether another process, or another `NewSequence` of this one, is writing a sequence now."""
    try:
        hidden = os.open(hidden_folder(path), os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return False
    try:
        fcntl.flock(hidden, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        pass  # a file system without locks
    finally:
        os.close(hidden)
    return False


class NewSequence:
    """A sequence that is being written to `folder`, which is hidden and empty at first. `finish` makes it `path`.

    If `path` is a folder already, the hidden one lies in it (it may be a mount point), otherwise beside it. Without
    `finish` it is removed at the end of the `with` block; one that a killed process left is removed at the start.
    Raises FileExistsError, which names what is there, if `path` is a file or holds anything: with `overwrite`, anything
    but a sequence, which `finish` then replaces. Raises BlockingIOError if another process is writing this sequence.
    """

    def __init__(self, path: Path | str, *, overwrite: bool = False) -> None:
        self.path = Path(path).resolve()
        home = self.path if self.path.exists() else self.path.parent
        self.folder = hidden_folder(self.path)
        self._old = _replaceable(self.path, self.folder, overwrite)
        self._made = [folder for folder in (home, *home.parents) if not folder.exists()]
        home.mkdir(parents=True, exist_ok=True)
        self._lock, self._finished = _make_locked(self.folder), False

    def __enter__(self) -> NewSequence:
        return self

    def __exit__(self, *_: object) -> None:
        if not self._finished:
            shutil.rmtree(self.folder, ignore_errors=True)
            for folder in self._made:
                with contextlib.suppress(OSError):
                    folder.rmdir()
        os.close(self._lock)

    def finish(self) -> None:
        """Put what was written in its place, and remove what it replaces; after an error nothing has changed."""
        if self.folder.parent != self.path:
            self.folder.rename(self.path)
            self._finished = True
            return
        new = sorted(self.folder.iterdir(), key=lambda entry: entry.suffix == ".json")  # the description last
        old = self.folder / "old"
        old.mkdir()
        moves = [(entry, old / entry.name) for entry in self._old] + [(entry, self.path / entry.name) for entry in new]
        done = []
        try:
            for source, target in moves:
                source.rename(target)
                done.append((source, target))
        except BaseException:
            for source, target in reversed(done):
                target.rename(source)
            raise
        self._finished = True
        shutil.rmtree(self.folder)


def _replaceable(path: Path, hidden: Path, overwrite: bool) -> list[Path]:
    """What a folder holds and may be removed, the description first. Raises FileExistsError for anything else."""
    if path.exists() and not path.is_dir():
        raise FileExistsError(f"{path}: a file: expected a new or an empty folder")
    held = entries(path)
    descriptions = [entry for entry in held if _is_description(entry)]
    # A process that was killed while it moved its files here had not moved the description yet.
    if held and not overwrite and (descriptions or not hidden.is_dir()):
        names = ", ".join(repr(entry.name) for entry in held[:3]) + (", ..." if len(held) > 3 else "")
        raise FileExistsError(f"{path}: holds {names}: expected a new or an empty folder")
    for entry in held:
        if entry not in descriptions and not _is_part(entry):
            expected = "expected nothing but a sequence in a folder that is to be overwritten"
            raise FileExistsError(f"{path}: holds {entry.name!r}: {expected}")
    return descriptions + [entry for entry in held if entry not in descriptions]


def _is_description(path: Path) -> bool:
    try:
        return path.suffix == ".json" and bool(read_json(path)[0].cameras)
    except OSError:
        return False


def _is_part(path: Path) -> bool:
    """Whether a file or folder is one that a writer of sequences makes, other than the description."""
    if path.is_dir():
        return path.name == "truth" and not path.is_symlink() and all(map(_is_part, entries(path)))
    return path.name.endswith("_poses.csv") or _VIDEO.fullmatch(path.name) is not None


def _make_locked(hidden: Path) -> int:
    """Make a folder that is empty and keep other processes out of it; returns the descriptor that holds the lock."""
    hidden.mkdir(exist_ok=True)
    lock = os.open(hidden, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        raise BlockingIOError(f"{hidden}: another process is writing this sequence") from None
    except OSError:
        pass  # a file system without locks
    if not hidden.exists() or not os.path.samestat(os.stat(hidden), os.fstat(lock)):
        os.close(lock)
        raise BlockingIOError(f"{hidden}: another process has just finished this sequence")
    for entry in hidden.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()
    return lock
