"""Middle layers: triangles in front of other background that no reference camera has ever seen past."""

from __future__ import annotations

import numba

from ...support.array_types import F32, F64, I64, U8
from ..base.jit import parallel, serial
from ..base.sight import looks_through
from ..base.tolerance import Delta
from .culling import SAMPLES, SMALL_PX, extent_px, sample_point
from .surfaces import Triangles

__all__ = ["find_never_seen_past", "measure_pixels"]


@serial
def _is_seen_past(table: F64, codes: I64, mesh: Triangles, i: int, delta: Delta) -> bool:
    """Whether a picture is farther, by more than delta, than a sample point of a triangle."""
    a, b, c = mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]
    for k in range(len(SAMPLES) if extent_px(mesh, a, b, c) > SMALL_PX else 1):
        x, y, z = sample_point(mesh, i, k)
        for view in range(table.shape[0]):
            if looks_through(table[view], codes[view], x, y, z, delta):
                return True
    return False


@parallel
def find_never_seen_past(table: F64, codes: I64, mesh: Triangles, which: I64, delta: Delta, never: U8) -> None:
    """Sets never [n] to 1 for those of the triangles `which` [n] past none of whose sample points (`culling.SAMPLES`)
    a picture sees, else to 0.

    table: float64 [views, TABLE_SIZE] (`kernels.base.view_table`); codes: int64 [views], addresses of the farthest
    codes that each camera has ever seen.
    """
    for k in numba.prange(which.shape[0]):
        never[k] = not _is_seen_past(table, codes, mesh, which[k], delta)


@parallel
def measure_pixels(mesh: Triangles, which: I64, pixels: F32) -> None:
    """Writes the areas, in pixels of the picture that they stem from, of the triangles `which` [n] to pixels [n]."""
    for k in numba.prange(which.shape[0]):
        uv, triangles = mesh.uv, mesh.triangles
        a, b, c = triangles[which[k], 0], triangles[which[k], 1], triangles[which[k], 2]
        across = (uv[b, 0] - uv[a, 0]) * (uv[c, 1] - uv[a, 1]) - (uv[b, 1] - uv[a, 1]) * (uv[c, 0] - uv[a, 0])
        pixels[k] = 0.5 * abs(across)
