"""Late layers: where something has come to stand before background that a reference camera knows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F64, U8, U16
from ..base.jit import inlined, parallel, serial
from ..base.project import project_point
from ..base.tolerance import Delta, delta_at
from ..base.view_table import OFFSET, STEP
from .nontrivial import Rules
from .surfaces import Triangles

__all__ = ["PATIENCE", "Before", "Stood", "clear_covered", "note_standing", "select_standing"]

# Something that has stood may be hidden for this number of turns; else it would be selected again whenever someone
# has walked past.
PATIENCE = 8
_BESIDE = 1e-3  # of a triangle's height: pixels that are so much beyond a side are covered as well


class Stood(NamedTuple):
    """What a camera sees before known background, in the first pixel of each 2x2: the depth code with which it was seen
    first, uint16 [(h + 1) // 2, (w + 1) // 2], and in how many successive turns it was seen there (see
    `note_standing`), uint8 of the same shape; 0: nothing is there."""

    codes: U16
    turns: U8


class Before(NamedTuple):
    """The rules by which a surface is before known background. rules: those of the camera's maximum depth image, by
    which surfaces are the same; beyond uint16 [65536]: the limit of every code, as `Rules.by_code`, for surfaces that
    are farther by more than delta."""

    rules: Rules
    beyond: U16


@inlined
def _is_before(code: int, known: int, lowest: int, beyond: U16) -> bool:
    """Whether a known code is farther than a code by more than delta."""
    return known >= lowest and known - lowest < int(beyond[code])


@inlined
def _is_same(code: int, other: int, rules: Rules) -> bool:
    """Whether neither of two codes is farther than the other by a nontrivial amount."""
    lowest, limits = rules.lowest, rules.by_code
    return not (code - lowest < int(limits[other]) or other - lowest < int(limits[code]))


@parallel
def note_standing(new: U16, known: U16, before: Before, need: int, stood: Stood) -> int:
    """A camera's turn: counts where its view shows the same surface as in its last turn, before known background.
    Returns the number of pixels in which that is so in this turn for the `need`-th time.

    new, known [h, w]: codes of the view, and of the camera's maximum depth image. A pixel without depth says nothing.
    Turns are counted up to need + PATIENCE (at most 255), and down again, as long as `need` is left, while something
    nearer hides what has stood.
    """
    rules, beyond = before
    lowest, count = int(rules.lowest), 0
    for y in numba.prange(stood.codes.shape[0]):
        row = 2 * np.int64(y)
        for x in range(stood.codes.shape[1]):
            code, turns = int(new[row, 2 * x]), int(stood.turns[y, x])
            if code < lowest:
                continue
            if not _is_before(code, int(known[row, 2 * x]), lowest, beyond):
                stood.turns[y, x] = 0
            elif turns > 0 and _is_same(code, int(stood.codes[y, x]), rules):
                stood.turns[y, x] = min(turns + 1, need + PATIENCE)
                count += turns + 1 == need
            elif turns > need and code > stood.codes[y, x]:  # not the same, so it is nearer
                stood.turns[y, x] = turns - 1
            else:
                stood.codes[y, x], stood.turns[y, x] = code, 1
                count += need == 1
    return count


@inlined
def _is_clear(code: int, known: U16, y: int, x: int, lowest: int, beyond: U16) -> bool:
    """Whether what is known at a pixel and at the eight round it is farther than a code by more than delta."""
    clear = True
    for v in range(max(y - 1, 0), min(y + 2, known.shape[0])):
        for u in range(max(x - 1, 0), min(x + 2, known.shape[1])):
            clear &= _is_before(code, int(known[v, u]), lowest, beyond)
    return clear


@inlined
def _stands(new: U16, rules: Rules, need: int, codes: U16, turns: U8, y: int, x: int) -> bool:
    """Whether what the first pixel of a 2x2 shows has stood."""
    return (
        turns[y, x] >= need and int(new[2 * y, 2 * x]) >= rules.lowest
        and _is_same(int(new[2 * y, 2 * x]), int(codes[y, x]), rules)
    )  # fmt: skip


@inlined
def _stands_round(new: U16, rules: Rules, need: int, codes: U16, turns: U8, y: int, x: int) -> bool:
    """Whether what the first pixels of the next 2x2 to the right, below and between show has stood, too."""
    return (
        y + 1 < turns.shape[0] and x + 1 < turns.shape[1]
        and _stands(new, rules, need, codes, turns, y, x + 1) and _stands(new, rules, need, codes, turns, y + 1, x)
        and _stands(new, rules, need, codes, turns, y + 1, x + 1)
    )  # fmt: skip


@parallel
def select_standing(
    new: U16, known: U16, before: Before, edge: int, need: int, stood: Stood, keep: U8
) -> int:
    """Sets keep [h, w], which is 0, to 1 for pixels of what has stood for at least `need` turns and is seen now.
    Returns their number.

    The first pixel of their 2x2 has stood, and either so have those of the next 2x2 to the right, below and between, or
    there is no depth edge (a step of more than `edge` codes) from it to the pixel. All that is known round a pixel is
    farther by more than delta: then the camera sees past its triangles when this has gone.
    """
    (rules, beyond), (codes, turns) = before, stood
    lowest, count = int(rules.lowest), 0
    for y in numba.prange(turns.shape[0]):
        half, top = np.int64(y), 2 * np.int64(y)
        for x in range(turns.shape[1]):
            if not _stands(new, rules, need, codes, turns, half, x):
                continue
            inside = _stands_round(new, rules, need, codes, turns, half, x)
            for v in range(top, min(top + 2, new.shape[0])):
                for u in range(2 * x, min(2 * x + 2, new.shape[1])):
                    code, step = int(new[v, u]), abs(np.int64(new[v, u]) - np.int64(new[top, 2 * x]))
                    if code >= lowest and (inside or step <= edge) and _is_clear(code, known, v, u, lowest, beyond):
                        keep[v, u] = 1
                        count += 1
    return count


@inlined
def _unwrapped(u: float, beside: float, width: int, wraps: bool) -> float:
    """A column, or the same one a turn farther, so that it is within half a turn of another one if pictures wrap."""
    return u - width * math.floor((u - beside) / width + 0.5) if wraps else u


@inlined
def _is_at(code: int, row: F64, disparity: float, delta: Delta) -> bool:
    """Whether a view's code is within delta of a disparity, 1/m."""
    depth, found = 1.0 / disparity, row[OFFSET] + row[STEP] * code
    margin = delta_at(delta, depth)
    return found * (depth + margin) >= 1.0 and found * (depth - margin) <= 1.0


@serial
def _clear_triangle(row: F64, codes: U16, mesh: Triangles, i: int, delta: Delta, wraps: bool, keep: U8) -> None:
    """`clear_covered` for a triangle."""
    points, (h, w) = mesh.points, keep.shape
    a, b, c = mesh.triangles[i, 0], mesh.triangles[i, 1], mesh.triangles[i, 2]
    au, av, ad = project_point(row, points[a, 0], points[a, 1], points[a, 2])
    bu, bv, bd = project_point(row, points[b, 0], points[b, 1], points[b, 2])
    cu, cv, cd = project_point(row, points[c, 0], points[c, 1], points[c, 2])
    bu, cu = _unwrapped(bu, au, w, wraps), _unwrapped(cu, au, w, wraps)
    area = (bu - au) * (cv - av) - (bv - av) * (cu - au)
    if not (min(ad, bd, cd) > 0.0 and abs(area) > 0.0 and abs(area) < math.inf):
        return
    left, right = max(min(au, bu, cu), -1.0 * w), min(max(au, bu, cu), 2.0 * w)
    top, bottom = max(min(av, bv, cv), 0.0), min(max(av, bv, cv), 1.0 * h)
    for y in range(math.ceil(top - 0.5), min(math.floor(bottom - 0.5) + 1, h)):
        for x in range(math.ceil(left - 0.5), math.floor(right - 0.5) + 1):
            column = x % w
            if not (wraps or (x >= 0 and x < w)) or keep[y, column] == 0:
                continue
            px, py = x + 0.5, y + 0.5
            p = ((bu - px) * (cv - py) - (bv - py) * (cu - px)) / area
            q = ((cu - px) * (av - py) - (cv - py) * (au - px)) / area
            r = 1.0 - p - q
            if min(p, q, r) >= -_BESIDE and _is_at(codes[y, column], row, p / ad + q / bd + r / cd, delta):
                keep[y, column] = 0


@parallel
def clear_covered(
    row: F64, codes: U16, mesh: Triangles, invalid: U8, delta: Delta, wraps: bool, keep: U8
) -> None:
    """Sets keep [h, w] to 0 in pixels in which a view's surface is within delta of a valid triangle (invalid [m] 0).

    row: the view's, of a view table (`kernels.base.view_table`); codes [h, w]: its depth codes, with a depth where keep
    is 1; wraps: whether its left and right sides meet.
    """
    for i in numba.prange(invalid.shape[0]):
        if invalid[i] == 0:
            _clear_triangle(row, codes, mesh, i, delta, wraps, keep)
