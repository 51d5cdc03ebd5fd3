"""Rims: the parts of the squares of pixels at depth edges that the surface does not cover.

In quads that a depth edge crosses, every valid corner keeps its quarter, so a pixel keeps its square.
"""

from __future__ import annotations

from ...support.array_types import I64, U16
from ...support.packed import Coding
from ..base import lanes
from ..base.jit import inlined, serial
from ..base.project import direction_in_world, position
from .records import MeshArrays, Rays
from .triangle_words import DOWN_WORD, KEPT_WORD, RIGHT_WORD, VALID_WORD

Extent = tuple[int, int, int, int]  # a block's first column and row, and its columns and rows of pixels

__all__ = ["Extent", "count_rims", "write_rims"]


@inlined
def _cut_quads(bits: I64, y: int, columns: int) -> int:
    """The quads of row y that a depth edge crosses."""
    crossed = bits[RIGHT_WORD, y] | bits[RIGHT_WORD, y + 1] | bits[DOWN_WORD, y] | (bits[DOWN_WORD, y] >> 1)
    return crossed & ((1 << (columns - 1)) - 1)


@inlined
def _corner(bits: I64, x: int, y: int) -> int:
    """The quads of row y whose corner (x, y) is kept and valid."""
    return (bits[KEPT_WORD, y] & bits[VALID_WORD, y]) >> x


@serial
def count_rims(bits: I64, columns: int, rows: int) -> int:
    """The number of quarters of quads in a block's rims."""
    quarters = 0
    for y in range(rows - 1):
        crossed = _cut_quads(bits, y, columns)
        if crossed != 0:
            for k in range(4):
                quarters += lanes.ones(crossed & _corner(bits, k & 1, y + (k >> 1)))
    return quarters


@inlined
def _write_point(rays: Rays, twice_u: int, twice_v: int, depth: float, mesh: MeshArrays, index: int) -> None:
    """Write a vertex at a place of the picture, in half pixels from the first pixel's centre."""
    across, down, points, uv = rays.across, rays.down, mesh.points, mesh.uv
    planar = down[twice_v, 0] * depth
    x, y, z = direction_in_world(
        rays.camera, planar * across[twice_u, 0], planar * across[twice_u, 1], down[twice_v, 1] * depth
    )
    ox, oy, oz = position(rays.camera)
    points[index, 0], points[index, 1], points[index, 2] = x + ox, y + oy, z + oz
    if uv.shape[0] > 0:
        uv[index, 0], uv[index, 1] = 0.5 * twice_u + 0.5, 0.5 * twice_v + 0.5


@serial
def write_rims(
    codes: U16, extent: Extent, bits: I64, coding: Coding, rays: Rays, second: int, mesh: MeshArrays, v: int, t: int
) -> None:
    """Write a block's rims from vertex v and triangle t on; second: 1, or 2 to wind triangles the other way.

    Depth is extrapolated half way towards a neighbour on the same surface.
    """
    x0, y0, columns, rows = extent
    w, triangles = codes.shape[1], mesh.triangles
    least = coding.min_code
    for y in range(rows - 1):
        crossed = _cut_quads(bits, y, columns)
        for k in range(4 if crossed != 0 else 0):
            dx, dy = k & 1, k >> 1
            sx, sy = 1 - 2 * dx, 1 - 2 * dy  # towards the quad's middle
            beside, along = ~bits[RIGHT_WORD, y + dy], ~(bits[DOWN_WORD, y] >> dx)
            word = crossed & _corner(bits, dx, y + dy)
            while word != 0:
                x = lanes.lowest(word)
                word &= word - 1
                px, py = x0 + x + dx, y0 + y + dy
                side, under = (beside >> x) & 1, (along >> x) & 1
                centre = max(int(codes[py, px % w]), least)
                other_x = max(int(codes[py, (px + sx * side) % w]), least)
                other_y = max(int(codes[py + sy * under, px % w]), least)
                for corner in range(4):
                    right, lower = corner & 1, corner >> 1
                    other = other_x if right and (side or not lower) else (other_y if lower else centre)
                    depth = 1.0 / (coding.offset + coding.step * 0.5 * (centre + other))
                    _write_point(rays, 2 * px + sx * right, 2 * py + sy * lower, depth, mesh, v + corner)
                k, m = (second, 3 - second) if sx * sy < 0 else (3 - second, second)
                triangles[t, 0], triangles[t, k], triangles[t, m] = v, v + 1, v + 3
                triangles[t + 1, 0], triangles[t + 1, k], triangles[t + 1, m] = v, v + 3, v + 2
                v += 4
                t += 2
