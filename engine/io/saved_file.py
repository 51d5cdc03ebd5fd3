"""Saved background models as programs see them that load no compiler: what a file holds, and whether it fits.

A saved model is a `sealed_file` whose content is `about` (the record `About`) and `state` (the record
`background.saved_model.SavedModel`). `farside info FILE` prints what `about` says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from ..settings import MODELLING, Settings
from .records import from_plain, to_plain
from .sealed_file import MAGIC, read_sealed, write_sealed

__all__ = [
    "VERSION", "About", "Scalar", "check_settings", "is_saved", "means_saved", "read_about", "read_saved",
    "write_saved",
]  # fmt: skip

VERSION = 5  # of the records

Scalar = int | float | str | bool | tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class About:
    """What a saved model is of: when it was saved (UTC, ISO 8601), the newest frame's index, the reference cameras with
    their sizes, triangles (all of the S-PBS, those of it that are valid, and valid ones of the P-PBS), how many
    triangles stem from an earlier model, pictures with colours, and the settings by name."""

    saved: str
    frame: int
    cameras: tuple[tuple[str, int, int], ...]
    s_pbs: int
    s_pbs_valid: int
    p_pbs: int
    seeded: int
    pictures: int
    settings: tuple[tuple[str, Scalar], ...]


def is_saved(path: Path) -> bool:
    """Whether a file begins like a saved model; raises OSError if it cannot be read."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def means_saved(path: Path) -> bool:
    """Whether a path is a file that is a saved model, or is called like one and should be."""
    return path.is_file() and (path.name.endswith(".farside") or is_saved(path))


def write_saved(path: Path, about: About, record: Any) -> int:
    """Writes a saved model as a whole (`sealed_file.write_sealed`, with its errors); returns the number of bytes."""
    arrays: list[tuple[str, npt.NDArray[Any]]] = []
    content = {"about": to_plain(about, arrays, "about"), "state": to_plain(record, arrays, "state")}
    return write_sealed(path, VERSION, content, arrays)


def read_about(path: Path) -> About:
    """What a saved model is of; the whole file is checked. Raises OSError, and ValueError as `sealed_file.read_sealed`
    or for other records."""
    return _about(path, read_sealed(path, VERSION, arrays=False).content)


def read_saved(path: Path) -> tuple[About, Any, Sequence[npt.NDArray[Any]]]:
    """What a saved model is of, its state as `records.from_plain` takes it, and the arrays; errors as `read_about`."""
    content, arrays = read_sealed(path, VERSION)
    return _about(path, content), content.get("state"), arrays


def check_settings(about: About, settings: Settings) -> None:
    """Raises ValueError if a model was built with other settings (`settings.MODELLING`) than these."""
    for name, saved in about.settings:
        now = getattr(settings, name, None)
        if name in MODELLING and saved != now:
            raise ValueError(f"setting {name}: {saved!r}: expected {now!r}, as it is set now")


def _about(path: Path, content: Any) -> About:
    try:
        return from_plain(About, content["about"], (), "about")
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: description: {type(error).__name__} {error}: expected about and state") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
