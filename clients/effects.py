"""3D effects from a file: JSON that names effects, as PUT /effects has them, with the files of their contents."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from farside.engine.io.effect_files import MOST_BYTES, EffectContent, read_mesh, read_picture
from farside.engine.rig.effects import AddedMesh, Effect, Projector
from farside.server.effect_messages import EffectUpdate
from farside.server.effects import effect_of
from farside.server.fields import ProtocolError, Reader
from farside.server.protocol import AXES

__all__ = ["NamedEffect", "read_effects"]

NamedEffect = tuple[str, Effect, EffectContent | None]


def read_effects(path: Path) -> tuple[NamedEffect, ...]:
    """The effects in a JSON file: names, and for each the fields of PUT /effects/NAME, and `picture` or `mesh`, a file.

    Files are relative to the JSON's folder. Raises OSError, and ValueError, which names the file, the effect, the
    field, its value and what was expected.
    """
    try:
        whole = json.loads(path.read_bytes())
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{path}: {error}: expected JSON") from error
    if not isinstance(whole, dict):
        raise ValueError(f"{path}: {type(whole).__name__}: expected an object with a field for each effect")
    found = []
    for name, fields in whole.items():
        try:
            found.append(_effect(path.parent, name, fields))
        except ProtocolError as error:
            raise ValueError(f"{path}: {name}: {error}") from error
    return tuple(found)


def _effect(folder: Path, name: str, fields: object) -> NamedEffect:
    reader = Reader({**fields, "name": name} if isinstance(fields, dict) else fields)
    axes = reader.choice("axes", AXES) if reader.has("axes") else "omaf"
    effect = effect_of(EffectUpdate._read(reader), axes)
    if isinstance(effect, AddedMesh):
        return name, effect, _content(folder / reader.text("mesh", 4096), read_mesh)
    live = isinstance(effect, Projector) and bool(effect.camera)
    return name, effect, None if live else _content(folder / reader.text("picture", 4096), read_picture)


def _content(path: Path, read: Callable[[bytes], EffectContent]) -> EffectContent:
    """The content in a file, of which no more is read than may be there."""
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    try:
        return read(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
