"""One camera's maximum depth image, updated in place by the camera's new view (section 3.3.3)."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F64, I64, U8, U16
from ..base.jit import inlined, inlined_late, parallel, serial
from ..base.tone import (
    CB_FROM_Y,
    CB_GAIN,
    CB_OFFSET,
    CR_FROM_Y,
    CR_GAIN,
    CR_OFFSET,
    Y_GAIN,
    Y_OFFSET,
    mean_luma,
    toned_code,
)
from .flags import FRESH, PROVISIONAL, TRIED, UPDATED, beside_nearer, coloured
from .nontrivial import Margins, Rules, margins_of, perhaps_farther
from .picture import Picture

__all__ = ["PHASES", "TILE", "update_maximum_depth"]

TILE = 64  # columns that are compared together before any is written
# A block is PHASES pairs of rows by TILE columns. Each frame samples one of its pairs of rows, the next frame the next
# pair: to find changes, to renew provisional colours, and to fuse depth.
PHASES = 8


@serial
def _any_set(flags: U8, bits: int) -> bool:
    found = np.uint8(0)
    for x in range(TILE):
        found |= flags[x]
    return found & bits != 0


@inlined_late
def _pair_farther(pair: int, x0: int, new: U16, codes: U16, by_code: U16, margins: Margins) -> bool:
    """Whether any pixel is farther in TILE columns, from x0 on, of a pair of rows."""
    top, bottom, end = 2 * pair, min(2 * pair + 1, codes.shape[0] - 1), x0 + TILE
    new_top, new_bottom = new[top, x0:end], new[bottom, x0:end]
    top_codes, bottom_codes = codes[top, x0:end], codes[bottom, x0:end]
    perhaps = np.uint16(0)
    for x in range(TILE):
        above = perhaps_farther(new_top[x], top_codes[x], margins)
        below = perhaps_farther(new_bottom[x], bottom_codes[x], margins)
        perhaps = np.uint16(perhaps | above | below)
    return perhaps != 0 and _any_farther(new_top, new_bottom, top_codes, bottom_codes, by_code, margins[0])


# Not `inlined`: where the CPU has no gathers, unrolled loads from a table are as much code as all the rest.
@serial
def _any_farther(
    new_top: U16, new_bottom: U16, top_codes: U16, bottom_codes: U16, by_code: U16, lowest: int
) -> bool:
    for x in range(TILE):
        if np.uint16(new_top[x] - lowest) < by_code[top_codes[x]]:
            return True
        if np.uint16(new_bottom[x] - lowest) < by_code[bottom_codes[x]]:
            return True
    return False


@inlined
def _pair_set(pair: int, x: int, flags: U8, bits: int) -> bool:
    found = False
    for row in range(2 * pair, min(2 * pair + 2, flags.shape[0])):
        found |= _any_set(flags[row, x : x + TILE], bits)
    return found


@inlined
def _concerned(pair: int, column: int, new: U16, codes: U16, flags: U8, by_code: U16, lowest: int) -> bool:
    """Whether one of the 2x2 pixels that share a chroma sample is farther, or has a provisional colour."""
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
    new: Picture, known: Picture, flags: U8, fused: U8, rules: Rules, tone: F64, before: I64, counts: I64,
    number: int, turn: int,
) -> None:  # fmt: skip
    """Takes over depth and colour where the new view is farther by a nontrivial amount, or is the first with a depth.

    `tone`, packed (`kernels.base.tone`), is applied to the new view's colours.

    A call compares one pair of rows of each block, the next pair as `number` counts up, because reading all unchanged
    pixels would cost more than everything else. If that pair has changed, or the block or a neighbour of it had changed
    in the call before, the call compares the whole block; if `turn` is 0 or more, it compares all blocks whole. So a
    change that lasts for PHASES calls is never missed, and a change as high as a block is found at once.

    flags, fused [h, w]; before, counts: pixels updated per block in the call before and in this one. Updated pixels get
    UPDATED, which is never cleared here, and their `fused` (unless it is empty) becomes 1. A provisional colour is
    replaced when the same surface is seen away from depth edges. It is looked at once within PHASES calls; after that
    only where something has changed, and in one pair of rows per `turn`, which counts up.
    """
    h, w = known.codes.shape
    lowest, whole, margins = np.uint16(rules.lowest), turn >= 0, margins_of(rules)
    for band in numba.prange(counts.shape[0]):
        first = np.int64(band) * PHASES
        last = min(first + PHASES, (h + 1) // 2)
        look, again = first + number % (last - first), first + turn % (last - first) if whole else -1
        for tile in range(counts.shape[1]):
            start, count = tile * TILE, 0
            x0 = max(min(start, w - TILE), 0)  # the last tile overlaps the one before
            narrow = w < TILE
            stirred = narrow or _stirred(before, band, tile)
            every = stirred or whole or _pair_farther(look, x0, new.codes, known.codes, rules.by_code, margins)
            wanted = PROVISIONAL if stirred else FRESH
            if every or _pair_set(look, x0, flags, wanted):
                for pair in range(first if every else look, last if every else look + 1):
                    if (
                        narrow
                        or _pair_farther(pair, x0, new.codes, known.codes, rules.by_code, margins)
                        or (pair == look and _pair_set(pair, x0, flags, wanted))
                        or (pair == again and _pair_set(pair, x0, flags, PROVISIONAL))
                    ):
                        for column in range(start // 2, (min(start + TILE, w) + 1) // 2):
                            if _concerned(pair, column, new.codes, known.codes, flags, rules.by_code, lowest):
                                count += _update_quad(pair, column, new, known, flags, fused, rules, tone)
            counts[band, tile] = count


@inlined
def _update_quad(
    pair: int, column: int, new: Picture, known: Picture, flags: U8, fused: U8, rules: Rules, tone: F64
) -> int:
    """Updates the 2x2 pixels that share a chroma sample; returns how many of them have a new depth."""
    (new_codes, new_y, new_cb, new_cr), (codes, y, cb, cr) = new, known
    h, w = codes.shape
    lowest, edge, by_code = rules.lowest, rules.edge, rules.by_code
    bottom, right = min(2 * pair + 2, h), min(2 * column + 2, w)
    count, colours, foreground = 0, 0, 0
    for row in range(2 * pair, bottom):
        for x in range(2 * column, right):
            code = int(new_codes[row, x])
            if code < lowest:
                continue
            if code - lowest < by_code[codes[row, x]]:
                codes[row, x] = code
                y[row, x] = toned_code(tone[Y_GAIN], new_y[row, x], tone[Y_OFFSET])
                if fused.size > 0:
                    fused[row, x] = 1
                flags[row, x] = coloured(flags[row, x], FRESH * beside_nearer(new_codes, row, x, edge)) | UPDATED
                count += 1
                colours += 1
            elif flags[row, x] & PROVISIONAL != 0:
                behind = int(codes[row, x]) - lowest < by_code[code]
                if behind or beside_nearer(new_codes, row, x, edge):
                    flags[row, x] = coloured(flags[row, x], TRIED)
                    continue
                y[row, x] = toned_code(tone[Y_GAIN], new_y[row, x], tone[Y_OFFSET])
                flags[row, x] = coloured(flags[row, x], 0)
                colours += 1
    if colours == 0:
        return count
    for row in range(2 * pair, bottom):
        for x in range(2 * column, right):
            code = int(new_codes[row, x])
            foreground += code >= lowest and int(codes[row, x]) - lowest < by_code[code]
    if foreground == 0:
        luma = mean_luma(new_y, 2 * pair, 2 * column)
        cb[pair, column] = toned_code(tone[CB_GAIN], new_cb[pair, column], tone[CB_FROM_Y] * luma + tone[CB_OFFSET])
        cr[pair, column] = toned_code(tone[CR_GAIN], new_cr[pair, column], tone[CR_FROM_Y] * luma + tone[CR_OFFSET])
    else:  # the sample is partly of something nearer: wait until that has moved away
        for row in range(2 * pair, bottom):
            for x in range(2 * column, right):
                flags[row, x] = coloured(flags[row, x], FRESH)
    return count
