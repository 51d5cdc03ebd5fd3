"""Stale foreground: triangles of the model where a present view shows that there is nothing any more.

Foreground culling (section 3.3.2) removes a triangle when every camera knows a surface behind it. Someone who stood
where a camera never knows one, as before the sky, would stay in the model after they have left. Here are two kinds of
evidence that they have: a view sees past a triangle; or there is no depth any more where the triangle stems from, but
another colour.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F64, I64, U8
from ...support.packed import HEIGHT, KIND, PERSPECTIVE, WIDTH
from ..base.jit import inlined, parallel, serial
from ..base.memory import load_u16
from ..base.project import point_in_camera, project_point
from ..base.sight import looks_through, shows
from ..base.tolerance import Delta, delta_at
from ..base.tone import toned
from ..base.view_table import INVALID, OFFSET, STEP
from .culling import SAMPLES, SMALL_PX, extent_px, sample_point
from .picture import Picture
from .surfaces import Triangles

__all__ = ["find_gone", "find_seen_past", "find_shown"]

_RIM_PX = 1.0  # how far round a triangle's image a view must see past it
_LARGEST_PX = 128.0  # sides of a larger image are not searched: such a triangle stays
_THIRD = 1.0 / 3.0
_OTHER = 40.0  # difference of 10-bit codes of luma or chroma that is another colour


@inlined
def _depth(row: F64, x: float, y: float, z: float) -> float:
    """A point's depth in a view, metres."""
    cx, cy, cz = point_in_camera(row, x, y, z)
    return cx if row[KIND] == PERSPECTIVE else math.sqrt(cx * cx + cy * cy + cz * cz)


@inlined
def _is_near(au: float, av: float, bu: float, bv: float, u: float, v: float, turn: float) -> bool:
    """Whether (u, v) is on the inner side of a triangle's side from a to b, or at most _RIM_PX beyond it; turn: see
    `_turn`."""
    du, dv = bu - au, bv - av
    return turn * (du * (v - av) - dv * (u - au)) >= -_RIM_PX * math.sqrt(du * du + dv * dv)


@inlined
def _touches(
    au: float, av: float, bu: float, bv: float, cu: float, cv: float, u: float, v: float, turn: float
) -> bool:
    """Whether (u, v) is at most _RIM_PX beyond each side of a triangle; turn: see `_turn`."""
    return (
        _is_near(au, av, bu, bv, u, v, turn) and _is_near(bu, bv, cu, cv, u, v, turn)
        and _is_near(cu, cv, au, av, u, v, turn)
    )  # fmt: skip


@inlined
def _turn(au: float, av: float, bu: float, bv: float, cu: float, cv: float) -> float:
    """1 or -1: the sense in which a triangle's corners follow each other in a picture."""
    return 1.0 if (bu - au) * (cv - av) - (bv - av) * (cu - au) >= 0.0 else -1.0


@serial
def _is_past(
    row: F64, codes: int, au: float, av: float, bu: float, bv: float, cu: float, cv: float, far: float, delta: Delta
) -> bool:
    """Whether all texels of a view within _RIM_PX of a triangle are farther than `far` metres by more than delta."""
    left, right = min(au, bu, cu) - _RIM_PX, max(au, bu, cu) + _RIM_PX
    top, bottom = min(av, bv, cv) - _RIM_PX, max(av, bv, cv) + _RIM_PX
    if not (
        left >= 0.0 and top >= 0.0 and right <= row[WIDTH] and bottom <= row[HEIGHT]
        and right - left <= _LARGEST_PX and bottom - top <= _LARGEST_PX
    ):  # fmt: skip
        return False
    limit = (1.0 / (far + delta_at(delta, far)) - row[OFFSET]) / row[STEP]
    turn = _turn(au, av, bu, bv, cu, cv)
    for y in range(math.ceil(top - 0.5), math.floor(bottom - 0.5) + 1):
        for x in range(math.ceil(left - 0.5), math.floor(right - 0.5) + 1):
            if _touches(au, av, bu, bv, cu, cv, x + 0.5, y + 0.5, turn):
                code = load_u16(codes, y * int(row[WIDTH]) + x)
                if not code < limit or (code == 0 and row[INVALID] > 0.0):
                    return False
    return True


@serial
def _sees_past(row: F64, codes: int, mesh: Triangles, i: int, delta: Delta) -> bool:
    """Whether all texels of a view within _RIM_PX of a triangle's image are farther than the whole triangle by more
    than delta."""
    points, a, b, c = mesh.points, mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]
    au, av, ad = project_point(row, points[a, 0], points[a, 1], points[a, 2])
    bu, bv, bd = project_point(row, points[b, 0], points[b, 1], points[b, 2])
    cu, cv, cd = project_point(row, points[c, 0], points[c, 1], points[c, 2])
    far = max(ad, bd, cd)
    return min(ad, bd, cd) > delta_at(delta, far) and _is_past(row, codes, au, av, bu, bv, cu, cv, far, delta)


@parallel
def find_seen_past(row: F64, codes: int, mesh: Triangles, invalid: U8, delta: Delta, first: int, past: U8) -> int:
    """Sets past [n] to 1 for those of the n triangles from number `first` on that are valid (invalid [m] 0) and past
    which a view sees, else to 0; returns the number of these triangles.

    row: the view's, of a view table (`kernels.base.view_table`); codes: address of its depth codes. The view must show
    something that is farther than the whole triangle by more than delta, in all texels within _RIM_PX of the triangle's
    image: depth next to the rim of something else is of no use as evidence, and neither is a texel without depth.
    """
    count = 0
    for k in numba.prange(past.shape[0]):
        i = first + np.int64(k)
        found = False
        if invalid[i] == 0:
            x, y, z = sample_point(mesh, i, 0)
            found = looks_through(row, codes, x, y, z, delta) and _sees_past(row, codes, mesh, i, delta)
        past[k] = found
        count += found
    return count


@inlined
def _has_other_colour(new: Picture, known: Picture, y: int, x: int, tone: F64) -> bool:
    """Whether the colours of two pictures differ clearly at a pixel; tone: applied to that of the new one."""
    luma, cb, cr = toned(tone, new.y[y, x], new.cb[y // 2, x // 2], new.cr[y // 2, x // 2])
    return (
        abs(luma - known.y[y, x]) > _OTHER or abs(cb - known.cb[y // 2, x // 2]) > _OTHER
        or abs(cr - known.cr[y // 2, x // 2]) > _OTHER
    )  # fmt: skip


@inlined
def _may_have_gone(row: F64, codes: int, mesh: Triangles, i: int, delta: Delta) -> bool:
    """Whether a view shows no depth, or something that is farther than the middle of a triangle by more than delta, in
    the pixel of its picture from which the triangle's middle stems."""
    uv, a, b, c = mesh.uv, mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]
    u, v = (uv[a, 0] + uv[b, 0] + uv[c, 0]) * _THIRD, (uv[a, 1] + uv[b, 1] + uv[c, 1]) * _THIRD
    if not (u >= 0.0 and v >= 0.0 and u < row[WIDTH] and v < row[HEIGHT]):
        return False
    code = load_u16(codes, int(v) * int(row[WIDTH]) + int(u))
    if code == 0 and row[INVALID] > 0.0:
        return True
    x, y, z = sample_point(mesh, i, 0)
    depth = _depth(row, x, y, z)
    return (row[OFFSET] + row[STEP] * code) * (depth + delta_at(delta, depth)) < 1.0


@serial
def _has_gone(row: F64, new: Picture, known: Picture, tone: F64, mesh: Triangles, i: int, delta: Delta) -> bool:
    """Whether a triangle has gone from the picture that it stems from (`find_gone`)."""
    points, uv, a, b, c = mesh.points, mesh.uv, mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]
    au, av, bu, bv = float(uv[a, 0]), float(uv[a, 1]), float(uv[b, 0]), float(uv[b, 1])
    cu, cv = float(uv[c, 0]), float(uv[c, 1])
    left, right = min(au, bu, cu) - _RIM_PX, max(au, bu, cu) + _RIM_PX
    top, bottom = min(av, bv, cv) - _RIM_PX, max(av, bv, cv) + _RIM_PX
    if not (left >= 0.0 and top >= 0.0 and right <= row[WIDTH] and bottom <= row[HEIGHT]):
        return False
    far = max(
        _depth(row, points[a, 0], points[a, 1], points[a, 2]), _depth(row, points[b, 0], points[b, 1], points[b, 2]),
        _depth(row, points[c, 0], points[c, 1], points[c, 2]),
    )  # fmt: skip
    limit = (1.0 / (far + delta_at(delta, far)) - row[OFFSET]) / row[STEP]
    turn, other, same = _turn(au, av, bu, bv, cu, cv), 0, 0
    for y in range(math.ceil(top - 0.5), math.floor(bottom - 0.5) + 1):
        for x in range(math.ceil(left - 0.5), math.floor(right - 0.5) + 1):
            if _touches(au, av, bu, bv, cu, cv, x + 0.5, y + 0.5, turn):
                code = new.codes[y, x]
                if code != 0 or row[INVALID] == 0.0:
                    if not code < limit:
                        return False
                    other += 1
                elif known.codes[y, x] != 0:
                    differs = _has_other_colour(new, known, y, x, tone)
                    other, same = other + differs, same + (not differs)
    return other > same


@parallel
def find_gone(
    row: F64, codes: int, new: Picture, known: Picture, tone: F64, mesh: Triangles, invalid: U8, delta: Delta,
    first: int, gone: U8,
) -> int:  # fmt: skip
    """Sets gone [n] to 1 for those of the n triangles from number `first` on that are valid (invalid [m] 0) and have
    gone from the picture that they stem from, else to 0; returns the number of these triangles.

    row, codes, new: of the camera's view now, from the same pose (`kernels.base.view_table`); known: its maximum depth
    image; tone: applied to the colours of the new view (`kernels.base.tone`). In all pixels within _RIM_PX of a
    triangle that has gone, the view is farther than the whole triangle by more than delta, or has no depth; and most of
    those are farther, or had a depth and have another colour now. Where something only has lost its depth, as shiny or
    dark things do, it still has its colour.
    """
    count = 0
    for k in numba.prange(gone.shape[0]):
        i = first + np.int64(k)
        found = False
        if invalid[i] == 0 and _may_have_gone(row, codes, mesh, i, delta):  # most have not
            found = _has_gone(row, new, known, tone, mesh, i, delta)
        gone[k] = found
        count += found
    return count


@serial
def _is_shown(table: F64, codes: I64, mesh: Triangles, i: int, delta: Delta) -> bool:
    """Whether a view shows a sample point of a triangle (`kernels.base.sight.shows`)."""
    large = extent_px(mesh, mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]) > SMALL_PX
    x, y, z = sample_point(mesh, i, 0)
    for view in range(table.shape[0]):
        u, v, depth = project_point(table[view], x, y, z)
        beside = max(-u, -v, u - table[view, WIDTH], v - table[view, HEIGHT])
        if not (depth > 0.0 and beside <= _LARGEST_PX):  # most views look elsewhere
            continue
        for k in range(len(SAMPLES) if large else 1):
            px, py, pz = sample_point(mesh, i, k)
            if shows(table[view], codes[view], px, py, pz, delta):
                return True
    return False


@parallel
def find_shown(table: F64, codes: I64, mesh: Triangles, which: I64, delta: Delta, shown: U8) -> int:
    """Sets shown [n] to 1 for those of the triangles `which` [n] of which a view shows a part, else to 0; returns the
    number of these triangles.

    table: float64 [views, TABLE_SIZE] (`kernels.base.view_table`); codes: int64 [views], addresses of depth codes.
    """
    count = 0
    for k in numba.prange(which.shape[0]):
        found = _is_shown(table, codes, mesh, which[k], delta)
        shown[k] = found
        count += found
    return count
