"""Laying the backdrop behind the warped views, except where present views contradict it."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ...support.array_types import F32, F64, I64
from ..base.jit import inlined, parallel, serial
from ..base.memory import load
from ..base.project import unproject_point
from ..base.sight import looks_through
from ..base.simd import LANES, any_of
from ..base.tolerance import Delta, delta_at
from ..base.view_table import CODES, Views
from .present import present_depth
from .records import DepthBuffer

__all__ = ["lay_backdrop"]

# The backdrop hides a drawn surface only if that is farther by this share of its depth and by delta: creases of the
# coarser backdrop mesh bulge a little.
_NEARER = 0.03


@inlined
def _present(
    views: Views, order: I64, camera: F64, x: int, y: int, depth: float, limit: float
) -> tuple[float, int]:
    """Depth and view of the first view in `order` with a surface on a pixel's ray, no farther than `limit`.

    It returns the first one, not the nearest surface of all views: that camera is nearest to the eye, and the search
    for the nearest surface would have to ask all views.
    """
    for k in order:
        found = present_depth(views.table[k], views.addresses[k, CODES], camera, x, y, depth)
        if found > 0.0 and found <= limit:
            return found, k
    return 0.0, -1


@inlined
def _may_show(q: Any, live: Any, delta: Any) -> Any:
    """Whether a backdrop's disparity q shows by depth alone: if a pixel was drawn with disparity `live`, 1 / q must not
    be more than (1 - _NEARER) / live minus delta at 1 / q. All are numbers, or vectors (delta: a pair of them)."""
    most = (1.0 - _NEARER) * q * q
    return (q > 0.0) & (live * (q + delta[0] * q * q) <= most) & (live * (q + delta[1]) <= most)


@serial
def _push_away(row: F32, push: Delta) -> None:
    """Moves the disparities of a row farther away by `push`."""
    metres, disparity = np.float32(push[0]), np.float32(push[1])
    for x in range(row.shape[0]):
        q = row[x]
        row[x] = q * q / (q + max(metres * q * q, disparity)) if q > np.float32(0.0) else np.float32(0.0)


@serial
def _first_to_ask(backdrop: F32, disparity: F32, delta: Delta, x: int) -> int:
    """The first pixel, from x on, of the next sixteen pixels of a row of which one may show the backdrop."""
    last, around = disparity.shape[0] - LANES, (np.float32(delta[0]), np.float32(delta[1]))
    while x <= last:
        q, live = load(backdrop.ctypes.data, x), load(disparity.ctypes.data, x)
        if any_of(_may_show(q, live, around)):
            return x
        x += LANES
    return x


@serial
def _lay_pixel(
    backdrop: F32, camera: F64, views: Views, order: I64, delta: Delta, number: int, buffer: DepthBuffer, y: int, x: int
) -> None:
    disparity, winner = buffer
    q, live = backdrop[y, x], disparity[y, x]
    px, py, pz = unproject_point(camera, x + 0.5, y + 0.5, 1.0 / q)
    # To cover a drawn surface, no texel may see past the backdrop's; in a hole, only all four together reject it.
    ghost, texels = False, 4 if live <= 0.0 else 1
    for k in range(views.table.shape[0]):
        if looks_through(views.table[k], views.addresses[k, CODES], px, py, pz, delta, texels):
            ghost = True
            break
    if len(order) > 0:
        around = delta_at(delta, 1.0 / q)
        limit = np.inf if ghost and live <= 0.0 else 1.0 / q + around
        depth, view = _present(views, order, camera, x, y, 1.0 / q, limit)
        if live > 0.0:
            ghost |= view < 0 or depth < 1.0 / q - around
        elif view >= 0:
            disparity[y, x] = 1.0 / depth
            winner[y, x] = number + 1 + view
            return
    if not ghost:
        disparity[y, x] = q
        winner[y, x] = number


@parallel
def lay_backdrop(
    backdrop: F32, camera: F64, views: Views, order: I64, push: Delta, delta: Delta, number: int, buffer: DepthBuffer
) -> None:
    """Move the backdrop away by `push`, and write its disparity, as view `number`, where nothing was drawn or where the
    backdrop is clearly nearer (section 3.4.2).

    A backdrop pixel is a ghost of the past, and is skipped, if any present view sees past it. Where it would cover a
    drawn surface, one of the four texels seeing past it is enough.

    `order` [n]: rows of the views that were not drawn, the most useful first. Only they may know a surface that stands
    before the background now: if one of them has a surface on a hole's ray, not behind the backdrop's (or at any depth,
    if the backdrop is a ghost), the hole shows it, as view `number` + 1 + the view's row. If there are such views, the
    backdrop covers a drawn surface only where one of them confirms it.
    """
    h, w = buffer.disparity.shape
    for row in numba.prange(h):
        y = np.int64(row)
        _push_away(backdrop[y], push)
        x = _first_to_ask(backdrop[y], buffer.disparity[y], delta, 0)
        while x < w:
            for column in range(x, min(x + LANES, w)):
                q, live = np.float64(backdrop[y, column]), np.float64(buffer.disparity[y, column])
                if _may_show(q, live, delta):
                    _lay_pixel(backdrop, camera, views, order, delta, number, buffer, y, column)
            x = _first_to_ask(backdrop[y], buffer.disparity[y], delta, x + LANES)
