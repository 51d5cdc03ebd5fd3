"""Files that are found by their names although other systems write these differently, and files that nobody means."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from pathlib import Path

__all__ = ["entries", "find_entry", "find_path", "is_companion", "only_one", "same_name"]

_OF_DESKTOPS = {"__macosx", "thumbs.db", "desktop.ini", "$recycle.bin"}


def is_companion(name: str) -> bool:
    """Whether a file or a folder is only a companion of others.

    Such are hidden ones (.DS_Store; ._NAME, where macOS keeps the rest of NAME) and those of desktops (__MACOSX,
    Thumbs.db, desktop.ini).
    """
    return name.startswith(".") or name.casefold() in _OF_DESKTOPS


def entries(folder: Path) -> list[Path]:
    """What a folder holds, sorted, without companions; nothing if there is no such folder."""
    return sorted(path for path in folder.iterdir() if not is_companion(path.name)) if folder.is_dir() else []


def same_name(name: str) -> str:
    """A key that two names share if only their letter case or their composition (NFC, NFD) differs."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def find_entry(folder: Path, name: str) -> Path | None:
    """What a folder holds under a name: exactly this one, or the only one with its `same_name`; None without any.

    Raises ValueError, which names all, if there are several.
    """
    if (folder / name).exists():
        return folder / name
    key = same_name(name)
    return only_one(name, (path for path in entries(folder) if same_name(path.name) == key))


def find_path(folder: Path, relative: str) -> Path:
    """The file at a path below a folder, part by part as `find_entry` finds it; parts are separated by slashes.

    Raises FileNotFoundError if it is not there, and ValueError as `find_entry` does.
    """
    place = folder
    for part in relative.split("/"):
        found = find_entry(place, part)
        if found is None:
            raise FileNotFoundError(f"{relative}: missing: expected {place / part}")
        place = found
    return place


def only_one(name: str, paths: Iterable[Path]) -> Path | None:
    """The only path of those that may be meant by a name; None without any, ValueError that names all of several."""
    found = sorted(paths)
    if len(found) > 1:
        names = " and ".join(repr(path.name) for path in found)
        raise ValueError(f"{found[0].parent}: {name!r}: found {names}: expected one, or exactly this name")
    return found[0] if found else None
