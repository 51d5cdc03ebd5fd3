"""Marks of cameras that move (section 4.2): a mark from a place that its camera has left cannot be renewed by a ray
from there. It holds until a view sees past the triangle."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F64, U8, U64
from ..base.jit import inlined, parallel
from ..base.sight import looks_through
from ..base.tolerance import Delta
from .surfaces import Triangles

__all__ = ["forget_seen_past"]


@inlined
def _has_any(marks: U64, i: int, bits: U64) -> bool:
    """Whether a triangle has one of the marks `bits`."""
    held = np.uint64(0)
    for word in range(marks.shape[1]):
        held |= marks[i, word] & bits[word]
    return held != np.uint64(0)


@inlined
def _forget(marks: U64, i: int, bits: U64) -> None:
    for word in range(marks.shape[1]):
        marks[i, word] &= ~bits[word]


@inlined
def _middle(mesh: Triangles, i: int) -> tuple[float, float, float]:
    points, a, b, c = mesh.points, mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]
    return (
        (points[a, 0] + points[b, 0] + points[c, 0]) / 3.0,
        (points[a, 1] + points[b, 1] + points[c, 1]) / 3.0,
        (points[a, 2] + points[b, 2] + points[c, 2]) / 3.0,
    )


@parallel
def forget_seen_past(
    row: F64, codes: int, mesh: Triangles, invalid: U8, delta: Delta, bits: U64, first: int, step: int, marks: U64
) -> int:
    """Clears `bits` [words] in marks [m, words] of valid triangles that have one of them and past whose middle a view
    sees; returns the number of these triangles. Only every `step`-th triangle from `first` on is looked at.

    row: the view's, of a view table (`kernels.base.view_table`); codes: address of its depth codes. A view sees past a
    point if all four texels round the point's image are farther by more than delta (`kernels.base.sight`).
    """
    count = 0
    for k in numba.prange((marks.shape[0] - first + step - 1) // step):
        i = first + np.int64(k) * step
        if invalid[i] == 0 and _has_any(marks, i, bits):
            x, y, z = _middle(mesh, i)
            if looks_through(row, codes, x, y, z, delta):
                _forget(marks, i, bits)
                count += 1
    return count
