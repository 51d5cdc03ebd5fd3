"""Seeds: the surfaces of an earlier model of the same room, with their colours, for a rig that may be another one."""

from __future__ import annotations

from dataclasses import dataclass

from ..support.array_types import F32, F64, I32
from .atlas import Atlas

__all__ = ["Seed", "SeedPart"]


@dataclass(frozen=True, slots=True, eq=False)
class SeedPart:
    """Triangles whose colours lie in one atlas: vertices float64 [n, 3], metres in the world; triangles int32 [m, 3];
    uv float32 [n, 2], places in the atlas, pixels (pixel centres at +0.5)."""

    vertices: F64
    triangles: I32
    uv: F32
    atlas: Atlas


@dataclass(frozen=True, slots=True, eq=False)
class Seed:
    """An earlier model: a part for each atlas."""

    parts: tuple[SeedPart, ...]
