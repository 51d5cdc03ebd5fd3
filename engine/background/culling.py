"""Foreground culling: what no camera's rays from outside the scene find is not background (section 3.3.2).

Each camera owns one bit of every triangle's marks. In its turn the bit is taken away everywhere, and leaves those of
the others: with a group of cameras a frame, a triangle stays until every camera has had its turn without finding it.
Bits are set by rays through a grid of the camera's pixels, as in the paper, or only by rays through points of the
triangles that have no other mark: the same question, asked from the triangle's side, with far fewer rays. A triangle
of the S-PBS that was flagged stays flagged, as in the paper: rays no longer see it, so that none can mark it again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry.embree import MarkQuery
from ..kernels.background.culling import list_unmarked, mark_by_pixel, mark_by_triangle
from ..kernels.base.tolerance import Delta
from ..support.array_types import F64
from .pbs import ProbableBackgroundSurface, Surface

__all__ = ["Unmarked", "clear_marks", "cull_unmarked", "mark_background", "mark_missed"]


_RUN = 64  # neighbouring triangles that begin with the same camera


class Unmarked(NamedTuple):
    """Valid triangles (numbers [n]) of a surface that have no mark."""

    surface: Surface
    triangles: npt.NDArray[np.int64]


def mark_background(
    pbs: ProbableBackgroundSurface, camera: int, packed: F64, stride: int, delta: Delta
) -> int:
    """Casts a camera's culling rays and renews its marks; returns the number of rays.

    Two rays for every stride-th pixel both ways; each that hits is followed by a complementary one. `packed` is
    the camera as kernels take it.
    """
    word, bit = camera // 64, np.uint64(1 << (camera % 64))
    clear_marks(pbs, camera)
    query = MarkQuery(pbs.marks_table, word, int(bit))
    marks = pbs.marks_table
    return int(mark_by_pixel(pbs.tracer, query.address, packed, stride, delta, marks, word, bit.astype(np.int64)))


def clear_marks(pbs: ProbableBackgroundSurface, camera: int) -> None:
    """Takes a camera's marks from all triangles."""
    word, bit = camera // 64, np.uint64(1 << (camera % 64))
    for surface in pbs.surfaces():
        surface.marks[:, word] &= ~bit


def mark_missed(
    pbs: ProbableBackgroundSurface, cameras: Sequence[int], packed: F64, delta: Delta, *, share: bool = False
) -> tuple[int, list[Unmarked]]:
    """Looks again at triangles without a mark: the first of the cameras that finds one marks it; returns the rays, and
    what is left without a mark.

    Rays go through points of the triangles, and only as far as there could be something behind them: an error-bounded
    mesh has triangles smaller than any stride, and far fewer triangles than pictures have pixels. With one mark each,
    triangles are looked at again in that camera's next turn, not in every one. `packed`: [all cameras, CAMERA_SIZE];
    with `share` the cameras start on other triangles each, which evens out their turns.
    """
    order, rays, left = np.array(cameras, np.int64), 0, []
    for surface, missed in _list_unmarked(pbs):
        if len(missed) and len(order):
            run = _RUN if share else 0
            rays += mark_by_triangle(
                pbs.tracer, packed, order, run, surface.packed, missed, delta, surface.marks
            )
            missed = missed[(surface.marks[missed] == 0).all(axis=1)]
        left.append(Unmarked(surface, missed))
    return int(rays), left


def cull_unmarked(pbs: ProbableBackgroundSurface, unmarked: Sequence[Unmarked] | None = None) -> int:
    """Flags as invalid what no camera has marked; returns how many triangles were valid before. `unmarked`: which, if
    known."""
    known = _list_unmarked(pbs) if unmarked is None else unmarked
    for surface, triangles in known:
        surface.invalid[triangles] = 1
    return sum(len(triangles) for _surface, triangles in known)


def _list_unmarked(pbs: ProbableBackgroundSurface) -> list[Unmarked]:
    unmarked = []
    for surface in pbs.surfaces():
        numbers = np.empty(len(surface.invalid), np.int64)
        count = list_unmarked(surface.marks, surface.invalid, numbers)
        unmarked.append(Unmarked(surface, numbers[:count]))
    return unmarked
