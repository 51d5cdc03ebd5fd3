"""A view's evidence on a point of the world: it sees past the point, or it shows a surface there, or neither."""

from __future__ import annotations

from ...support.array_types import F64
from ...support.packed import HEIGHT, WIDTH
from .jit import inlined, inlined_late
from .memory import load_u16
from .project import project_point
from .tolerance import Delta, delta_at
from .view_table import EDGE, INVALID, OFFSET, STEP

__all__ = ["looks_through", "shows"]


@inlined
def _image(row: F64, x: float, y: float, z: float, delta: Delta) -> tuple[int, float, float]:
    """Index of the first of the four texels round a point's image in a view, the point's depth, and delta at that depth
    in metres; index -1 if there are no such texels, or if the view is nearer than delta."""
    u, v, depth = project_point(row, x, y, z)
    margin = delta_at(delta, depth)
    if not (depth > margin and u >= 0.5 and v >= 0.5 and u <= row[WIDTH] - 0.5 and v <= row[HEIGHT] - 0.5):
        return -1, depth, margin
    ix, iy = min(int(u - 0.5), int(row[WIDTH]) - 2), min(int(v - 0.5), int(row[HEIGHT]) - 2)
    return (iy * int(row[WIDTH]) + ix if ix >= 0 and iy >= 0 else -1), depth, margin


@inlined_late
def looks_through(row: F64, codes: int, x: float, y: float, z: float, delta: Delta, texels: int = 4) -> bool:
    """Whether a view sees past a point: at least `texels` of the four texels round its image are farther by more than
    delta.

    row: of a view table (`kernels.base.view_table`); codes: address of depth codes of the view's size.
    """
    texel, depth, margin = _image(row, x, y, z, delta)
    if texel < 0:
        return False
    limit = (1.0 / (depth + margin) - row[OFFSET]) / row[STEP]
    farther = 0
    for k in range(4):
        code = load_u16(codes, texel + (k & 1) + (k >> 1) * int(row[WIDTH]))
        farther += code < limit and not (code == 0 and row[INVALID] > 0.0)
    return farther >= texels


@inlined_late
def shows(row: F64, codes: int, x: float, y: float, z: float, delta: Delta) -> bool:
    """Whether the four texels round a point's image are one surface that passes within delta of the point.

    row and codes as in `looks_through`.
    """
    texel, depth, margin = _image(row, x, y, z, delta)
    if texel < 0:
        return False
    lowest, highest = 65535, 0
    for k in range(4):
        code = load_u16(codes, texel + (k & 1) + (k >> 1) * int(row[WIDTH]))
        lowest, highest = min(lowest, code), max(highest, code)
    if highest - lowest > row[EDGE] or (lowest == 0 and row[INVALID] > 0.0):
        return False
    farthest = (1.0 / (depth + margin) - row[OFFSET]) / row[STEP]
    nearest = (1.0 / (depth - margin) - row[OFFSET]) / row[STEP]
    return highest >= farthest and lowest <= nearest
