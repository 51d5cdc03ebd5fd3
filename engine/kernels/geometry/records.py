"""Records of arrays for the kernels of this room."""

from __future__ import annotations

from typing import NamedTuple

from ...support.array_types import F32, F64, I32, I64, U8, U16

__all__ = ["BlockArrays", "DepthMap", "MeshArrays", "Rays"]


class DepthMap(NamedTuple):
    """A view's depth codes [h, w], their flags [h, w] (`cuts`), and whether its last column is next to the first."""

    codes: U16
    flags: U8
    wraps: bool


class BlockArrays(NamedTuple):
    """The data of a view's blocks [rows, columns]."""

    splits: I64  # [rows, columns, WORDS], see `splits`
    states: U8  # EMPTY, PLAIN or MIXED
    remade: U8  # 0 where a block's triangles are copied from the last mesh
    used: I64  # [rows, columns, SIDE]: words of the grid vertices that the surface's triangles use


class Rays(NamedTuple):
    """Directions at every half pixel, from the first pixel's centre on, in the axes of a packed camera.

    The direction of half pixel (x, y) is (down[y, 0] * across[x, 0], down[y, 0] * across[x, 1], down[y, 1]).
    """

    camera: F64
    across: F64  # [2 w + 1, 2]
    down: F64  # [2 h - 1, 2]


class MeshArrays(NamedTuple):
    """A mesh's points relative to the scene origin, metres, their picture coordinates, and its triangles."""

    points: F32  # [n, 3]
    uv: F32  # [n, 2]
    triangles: I32  # [m, 3]
