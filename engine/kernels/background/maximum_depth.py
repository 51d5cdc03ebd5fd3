"""One camera's maximum depth image, updated in place by the camera's new view (section 3.3.3).

Where depth flickers, the maximum over many frames strays by some standard deviations, and each of its pixels holds one
frame's error. Instead, pixels where a new view shows the same surface again take a recursive mean (temporal fusion);
what is farther by a nontrivial amount still replaces it, and what is nearer is somebody before it.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8, U16
from ..base.jit import inlined, parallel, serial
from ..base.project import project_point, unproject_point
from ..base.tone import mean_luma, toned_code

__all__ = [
    "KEPT",
    "PHASES",
    "PROVISIONAL",
    "TILE",
    "UPDATED",
    "farther_than",
    "fuse_maximum_depth",
    "mark_provisional",
    "prepare_limits",
    "settle_points",
    "update_maximum_depth",
]

TILE = 64  # columns that are compared at once before any is written
# Every frame looks at one of so many pairs of rows, another one each time: for what has changed, for provisional
# colours, and to fuse depth. So many pairs and TILE columns are a block.
PHASES = 8
# Bits of a pixel's flags; `triangle_filter` has more for itself. UPDATED: changed since the camera's last turn; KEPT:
# it belongs to the P-PBS. Provisional colours are fresh, or were tried and still beside something nearer: these wait
# for a change.
UPDATED, KEPT, _FRESH, _TRIED = 1, 2, 4, 8
PROVISIONAL = _FRESH | _TRIED
# How many frames a mean may hold: with more it would follow nothing any more. Colours change sooner, with light and
# shadow, and a first one that was mixed with someone's who was about to leave is soon forgotten.
DEPTH_FRAMES, COLOUR_FRAMES = 32, 8

Margins = tuple[np.uint16, np.uint16, np.uint16, np.uint16]  # smallest valid code, and what margins are at least


@inlined
def farther_than(
    code: int, offset: float, step: float, has_invalid: bool, margin_m: float, margin_disparity: float
) -> float:
    """The code below which a surface is farther than `code` by a nontrivial amount: both margins are exceeded."""
    if has_invalid and code == 0:
        return math.inf
    disparity = offset + step * code
    limit = min(disparity / (1.0 + margin_m * disparity), disparity - margin_disparity)
    return (limit - offset) / step


@inlined
def _beside_nearer(codes: U16, row: int, x: int, edge: int) -> bool:
    """Whether one of the eight neighbours is nearer by more than a depth edge: colours mix there."""
    limit = int(codes[row, x]) + edge
    for y in range(max(row - 1, 0), min(row + 2, codes.shape[0])):
        for u in range(max(x - 1, 0), min(x + 2, codes.shape[1])):
            if codes[y, u] > limit:
                return True
    return False


@inlined
def _coloured(flags: int, provisional: int) -> int:
    """A pixel's flags with another state of its colour."""
    return (flags & ~PROVISIONAL) | provisional


@inlined
def _limit(code: int, rules: F64) -> int:
    """A code's row in `by_code`: new - lowest < limit, in wrapping 16-bit arithmetic, says "valid and farther"."""
    limit = farther_than(code, rules[0], rules[1], rules[2] > 0.0, rules[3], rules[4]) - rules[2]
    return math.ceil(min(max(limit, 0.0), 65535.0))


@serial
def prepare_limits(rules: F64, by_code: U16) -> None:
    """Fills by_code [65536], every code's limit, and the last three of rules [9].

    rules: offset, step, smallest valid code (0 or 1), margins in metres and 1/m, depth edge in codes; then least, bend,
    shift: what is farther than a code, less the smallest valid one, differs from it by least + (max(code - bend, 0) >>
    shift) codes or more.
    """
    lowest, least = int(rules[2]), 65535
    for code in range(65536):
        by_code[code] = _limit(code, rules)
        if code >= lowest and by_code[code] > 0:
            least = min(least, code - lowest - by_code[code] + 1)
    # The tangent where the margin in metres, a square of the disparity, is four times the least.
    slope = 4.0 * math.sqrt(rules[3] * rules[1] * least)
    shift, bend = round(-math.log2(min(max(slope, 2.0**-15), 1.0))), 0
    for code in range(lowest, 65536):
        if by_code[code] > 0:
            more = code - lowest - by_code[code] + 1 - least
            bend = max(bend, code - lowest - (((more + 1) << shift) - 1))
    rules[6], rules[7], rules[8] = least, bend, shift


@parallel
def mark_provisional(codes: U16, rules: F64, flags: U8) -> None:
    """Sets in flags [h, w] which colours are provisional: those into which something nearer may be mixed."""
    h, w = codes.shape
    for row in numba.prange(h):
        y = int(np.int64(row))
        nearest = np.empty(w, np.uint16)  # of a pixel, the one above and the one below
        above, below = codes[max(y - 1, 0)], codes[min(y + 1, h - 1)]
        for x in range(w):
            nearest[x] = max(max(above[x], below[x]), codes[y, x])
        edge = np.int32(rules[5])
        for x in (0, w - 1):
            flags[y, x] = _coloured(flags[y, x], _FRESH * _beside_nearer(codes, y, x, edge))
        for x in range(1, w - 1):
            around = max(max(nearest[x - 1], nearest[x]), nearest[x + 1])
            nearer = np.int32(around) > np.int32(codes[y, x]) + edge
            flags[y, x] = _coloured(flags[y, x], _FRESH * nearer)


@inlined
def _perhaps_farther(new: np.uint16, code: np.uint16, margins: Margins) -> np.uint16:
    """0 where a new code is not farther than another, by what margins are at least (see `prepare_limits`).

    Without a table and in 16 bits, so that it is vectorised. Invalid codes wrap to the largest: as a new one that is
    never farther; where nothing was seen before anything is.
    """
    lowest, least, bend, shift = margins
    shifted, known = np.uint16(new - lowest), np.uint16(code - lowest)
    beyond = np.uint16(np.uint16(max(known, bend) - bend) >> (shift & 15))  # the mask tells that 16 bits are enough
    margin = np.uint16(beyond + least)
    nearest = np.uint16(min(shifted, np.uint16(~margin)) + margin)  # saturates
    return np.uint16((nearest <= known) & (shifted != np.uint16(65535)))


@inlined
def _any_set(flags: U8, bits: int) -> bool:
    found = np.uint8(0)
    for x in range(TILE):
        found |= flags[x]
    return found & bits != 0


@inlined
def _pair_farther(pair: int, x0: int, new: U16, codes: U16, by_code: U16, margins: Margins) -> bool:
    """Whether anything is farther in TILE columns from x0 on of a pair of rows."""
    top, bottom, end = 2 * pair, min(2 * pair + 1, codes.shape[0] - 1), x0 + TILE
    new_top, new_bottom = new[top, x0:end], new[bottom, x0:end]
    top_codes, bottom_codes = codes[top, x0:end], codes[bottom, x0:end]
    perhaps = np.uint16(0)
    for x in range(TILE):
        above = _perhaps_farther(new_top[x], top_codes[x], margins)
        below = _perhaps_farther(new_bottom[x], bottom_codes[x], margins)
        perhaps = np.uint16(perhaps | above | below)
    if perhaps == 0:
        return False
    lowest, found = margins[0], False
    for x in range(TILE):
        found |= np.uint16(new_top[x] - lowest) < by_code[top_codes[x]]
        found |= np.uint16(new_bottom[x] - lowest) < by_code[bottom_codes[x]]
    return found


@inlined
def _pair_set(pair: int, x: int, flags: U8, bits: int) -> bool:
    found = False
    for row in range(2 * pair, min(2 * pair + 2, flags.shape[0])):
        found |= _any_set(flags[row, x : x + TILE], bits)
    return found


@inlined
def _concerned(pair: int, column: int, new: U16, codes: U16, flags: U8, by_code: U16, lowest: int) -> bool:
    """Whether one of the 2x2 pixels that share one chroma sample is farther, or has a provisional colour."""
    top, bottom = 2 * pair, min(2 * pair + 1, codes.shape[0] - 1)
    left, right = 2 * column, min(2 * column + 1, codes.shape[1] - 1)
    either = flags[top, left] | flags[top, right] | flags[bottom, left] | flags[bottom, right]
    return (
        (either & PROVISIONAL != 0)
        | (np.uint16(new[top, left] - lowest) < by_code[codes[top, left]])
        | (np.uint16(new[top, right] - lowest) < by_code[codes[top, right]])
        | (np.uint16(new[bottom, left] - lowest) < by_code[codes[bottom, left]])
        | (np.uint16(new[bottom, right] - lowest) < by_code[codes[bottom, right]])
    )


@inlined
def _stirred(changed: I64, band: int, tile: int) -> bool:
    """Whether a block or one of its four neighbours has changed."""
    bands, tiles = changed.shape
    beside = changed[band, max(tile - 1, 0)] + changed[band, min(tile + 1, tiles - 1)]
    return changed[band, tile] + beside + changed[max(band - 1, 0), tile] + changed[min(band + 1, bands - 1), tile] > 0


@parallel
def update_maximum_depth(
    new_codes: U16, new_y: U16, new_cb: U16, new_cr: U16, codes: U16, y: U16, cb: U16, cr: U16,
    flags: U8, fused: U8, by_code: U16, before: I64, counts: I64, rules: F64, tone: F64, number: int, turn: int,
) -> None:  # fmt: skip
    """Takes over depth and colour where the new view is farther by a nontrivial amount, or sees something first.

    The colour is kept in another tone, packed (`kernels.base.tone`).

    A call looks at one pair of rows of each block, another one as `number` counts up: reading all that has not changed
    costs more than everything else. Where that pair has changed, or the block or a neighbour of it had in the call
    before, it looks at the whole block; with a `turn` of 0 or more at all of them. So nothing that stays for PHASES
    calls is missed, and what is as high as a block is found at once.

    codes, y, flags, fused [h, w]; cb, cr [(h + 1) // 2, (w + 1) // 2]; before, counts: pixels updated per block in the
    call before and in this one; by_code, rules: as `prepare_limits` leaves them. UPDATED is set there and never
    cleared, `fused` (unless it has no elements) becomes 1. A provisional colour is replaced when the same surface is
    seen away from depth edges: looked at once within PHASES calls; then where something has changed, and in one pair of
    rows a `turn`, which counts up.
    """
    h, w = codes.shape
    lowest, whole = np.uint16(rules[2]), turn >= 0
    margins = lowest, np.uint16(rules[6]), np.uint16(rules[7]), np.uint16(rules[8])
    for band in numba.prange(counts.shape[0]):
        first = np.int64(band) * PHASES
        last = min(first + PHASES, (h + 1) // 2)
        look, again = first + number % (last - first), first + turn % (last - first) if whole else -1
        for tile in range(counts.shape[1]):
            start, count = tile * TILE, 0
            x0 = max(min(start, w - TILE), 0)  # the last tile overlaps the one before
            narrow = w < TILE
            stirred = narrow or _stirred(before, band, tile)
            every = stirred or whole or _pair_farther(look, x0, new_codes, codes, by_code, margins)
            wanted = PROVISIONAL if stirred else _FRESH
            if every or _pair_set(look, x0, flags, wanted):
                for pair in range(first if every else look, last if every else look + 1):
                    if (
                        narrow
                        or _pair_farther(pair, x0, new_codes, codes, by_code, margins)
                        or (pair == look and _pair_set(pair, x0, flags, wanted))
                        or (pair == again and _pair_set(pair, x0, flags, PROVISIONAL))
                    ):
                        for column in range(start // 2, (min(start + TILE, w) + 1) // 2):
                            if _concerned(pair, column, new_codes, codes, flags, by_code, lowest):
                                count += _update_quad(
                                    pair, column, new_codes, new_y, new_cb, new_cr, codes, y, cb, cr, flags, fused,
                                    by_code, rules, tone,
                                )  # fmt: skip
            counts[band, tile] = count


@inlined
def _update_quad(
    pair: int, column: int, new_codes: U16, new_y: U16, new_cb: U16, new_cr: U16, codes: U16, y: U16, cb: U16,
    cr: U16, flags: U8, fused: U8, by_code: U16, rules: F64, tone: F64,
) -> int:  # fmt: skip
    """The 2x2 pixels that share one chroma sample; returns how many of them were updated."""
    h, w = codes.shape
    lowest, edge = int(rules[2]), int(rules[5])
    bottom, right = min(2 * pair + 2, h), min(2 * column + 2, w)
    count, coloured, foreground = 0, 0, 0
    for row in range(2 * pair, bottom):
        for x in range(2 * column, right):
            new = int(new_codes[row, x])
            if new < lowest:
                continue
            if new - lowest < by_code[codes[row, x]]:
                codes[row, x] = new
                y[row, x] = toned_code(tone[0], new_y[row, x], tone[1])
                if fused.size > 0:
                    fused[row, x] = 1
                flags[row, x] = _coloured(flags[row, x], _FRESH * _beside_nearer(new_codes, row, x, edge)) | UPDATED
                count += 1
                coloured += 1
            elif flags[row, x] & PROVISIONAL != 0:
                behind = int(codes[row, x]) - lowest < by_code[new]
                if behind or _beside_nearer(new_codes, row, x, edge):
                    flags[row, x] = _coloured(flags[row, x], _TRIED)
                    continue
                y[row, x] = toned_code(tone[0], new_y[row, x], tone[1])
                flags[row, x] = _coloured(flags[row, x], 0)
                coloured += 1
    if coloured == 0:
        return count
    for row in range(2 * pair, bottom):
        for x in range(2 * column, right):
            new = int(new_codes[row, x])
            foreground += new >= lowest and int(codes[row, x]) - lowest < by_code[new]
    if foreground == 0:
        luma = mean_luma(new_y, 2 * pair, 2 * column)
        cb[pair, column] = toned_code(tone[2], new_cb[pair, column], tone[3] * luma + tone[4])
        cr[pair, column] = toned_code(tone[5], new_cr[pair, column], tone[6] * luma + tone[7])
    else:  # the sample is partly of something nearer: wait until that has moved on
        for row in range(2 * pair, bottom):
            for x in range(2 * column, right):
                flags[row, x] = _coloured(flags[row, x], _FRESH)
    return count


@inlined
def _toward(old: int, new: int, count: int, chance: float) -> int:
    """The mean of `count` codes, the new one among them; rounded by chance, or small differences would never count."""
    return int(old + math.floor((np.int32(new) - np.int32(old)) / count + chance))


@parallel
def fuse_maximum_depth(
    new_codes: U16, new_y: U16, new_cb: U16, new_cr: U16, codes: U16, y: U16, cb: U16, cr: U16,
    flags: U8, fused: U8, by_code: U16, rules: F64, tone: F64, number: int,
) -> None:  # fmt: skip
    """Takes the mean where the new view shows the same surface: neither is farther by a nontrivial amount.

    fused [h, w]: how many views a pixel's mean holds, at most DEPTH_FRAMES. Colours beside something nearer are left
    alone, chroma where not all pixels that share it show the same surface. A call looks at every PHASES-th pair of
    rows; `number` counts up. Otherwise as `update_maximum_depth`.
    """
    h, w = codes.shape
    lowest, edge = np.int32(rules[2]), np.int32(rules[5])
    first = number % PHASES
    for k in numba.prange(((h + 1) // 2 - first + PHASES - 1) // PHASES):
        pair = first + np.int64(k) * PHASES
        last = min(2 * pair + 2, h)
        state = np.uint32(2654435761 * (number + 1) + 40503 * pair)
        for column in range((w + 1) // 2):
            whole, count = True, DEPTH_FRAMES
            for row in range(2 * pair, last):
                for x in range(2 * column, min(2 * column + 2, w)):
                    new, old = np.int32(new_codes[row, x]), np.int32(codes[row, x])
                    if new < lowest or new - lowest < by_code[old] or old - lowest < by_code[new]:
                        whole = False
                        continue
                    state = np.uint32(state * np.uint32(1664525) + np.uint32(1013904223))
                    chance = (state >> np.uint32(8)) * 2.0**-24
                    fused[row, x] = min(fused[row, x] + 1, DEPTH_FRAMES)
                    codes[row, x] = _toward(old, new, fused[row, x], chance)
                    if flags[row, x] & PROVISIONAL != 0 or _beside_nearer(new_codes, row, x, edge):
                        whole = False
                        continue
                    count = min(count, fused[row, x])
                    luma = toned_code(tone[0], new_y[row, x], tone[1])
                    y[row, x] = _toward(y[row, x], luma, min(fused[row, x], COLOUR_FRAMES), chance)
            if whole:
                count = min(count, COLOUR_FRAMES)
                chance = (state >> np.uint32(8)) * 2.0**-24
                mean = mean_luma(new_y, 2 * pair, 2 * column)
                blue = toned_code(tone[2], new_cb[pair, column], tone[3] * mean + tone[4])
                red = toned_code(tone[5], new_cr[pair, column], tone[6] * mean + tone[7])
                cb[pair, column] = _toward(cb[pair, column], blue, count, chance)
                cr[pair, column] = _toward(cr[pair, column], red, count, chance)


@inlined
def _code_at(depth: float, rules: F64) -> int:
    """The code of a depth, within all codes; 0 where that is no number."""
    code = (1.0 / depth - rules[0]) / rules[1] + 0.5
    return int(min(code, 65535.0)) if code > 0.0 else 0  # NaN fails the comparison


@parallel
def settle_points(points: F32, uv: F32, camera: F64, rules: F64, codes: U16, by_code: U16, moved: F32) -> None:
    """Moves points [n, 3] of a mesh of this image, at picture coordinates uv [n, 2], to where its codes are by now.

    A point between pixels takes the mean of those around it; of all pixels only those count that show the surface
    which the point lies on. A point with none stays.
    """
    h, w = codes.shape
    lowest = int(rules[2])
    for i in numba.prange(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        u, v = float(uv[i, 0]), float(uv[i, 1])
        _u, _v, depth = project_point(camera, x, y, z)
        own = _code_at(depth, rules)
        total, count = 0.0, 0
        for row in range(math.ceil(v - 1.0), math.floor(v) + 1):
            for column in range(math.ceil(u - 1.0), math.floor(u) + 1):
                code = int(codes[min(max(row, 0), h - 1), column % w])
                if code >= lowest and code - lowest >= by_code[own] and own - lowest >= by_code[code]:
                    total += code
                    count += 1
        if count > 0:
            x, y, z = unproject_point(camera, u, v, 1.0 / (rules[0] + rules[1] * total / count))
        moved[i, 0], moved[i, 1], moved[i, 2] = x, y, z
