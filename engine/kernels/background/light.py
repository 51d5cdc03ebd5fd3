"""Light that changes: the colours of a maximum depth image follow those of its camera's present view.

The picture is divided into cells. In an active one, where the light changes, colours approach those of the view where
that shows the surface of the maximum depth image. This is not in the paper, which leaves changes of lighting to future
work (section 5).
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F64, U8, U16
from ..base.jit import inlined, parallel, serial
from ..base.tone import (
    CB_FROM_Y,
    CB_GAIN,
    CB_OFFSET,
    CR_FROM_Y,
    CR_GAIN,
    CR_OFFSET,
    LARGEST,
    Y_GAIN,
    Y_OFFSET,
    mean_luma,
)
from .flags import PROVISIONAL
from .maximum_depth import PHASES
from .nontrivial import Rules, margins_of, perhaps_farther
from .picture import Picture

__all__ = ["BLUE", "CELL", "COUNT", "LUMA", "RED", "SUMS_SIZE", "Cells", "follow_light"]

CELL = 32  # pixels: side of the cells by which changes of light are compared; a multiple of 2 * PHASES
_BLACK = 64.0
_SPARSE = 4  # one of this number of quads of an active cell is summed
_ROOM = 2048  # more than the difference of any two codes
_BRIGHTEST = 920.0  # luma above which a sensor may be clipped
# Sums over the quads (2x2 pixels, which share a chroma sample) of a cell: their number, and by how much luma and both
# chroma of the view are more than those of the image.
COUNT, LUMA, BLUE, RED = range(4)
SUMS_SIZE = 4


class Cells(NamedTuple):
    """What is known of the light in the cells [rows, columns] of a picture.

    active: not 0 where colours follow. sums [..., SUMS_SIZE].
    """

    active: U8
    sums: F64


@inlined
def _seed(row: int, number: int) -> np.uint32:
    """What `_chance` needs for a row and a call."""
    return np.uint32(np.uint32(row) * np.uint32(0x85EBCA77) + np.uint32(number) * np.uint32(0xC2B2AE3D))


@inlined
def _chance(x: int, seed: np.uint32) -> np.float32:
    """A random number in [0, 1) for a column."""
    n = np.uint32(np.uint32(x) * np.uint32(0x9E3779B1) + seed)
    n = np.uint32(np.uint32(n ^ (n >> np.uint32(15))) * np.uint32(0x2C1B3C6D))
    return np.float32(np.int32(n >> np.uint32(8))) * np.float32(2.0**-24)


@inlined
def _toned(gain: np.float32, code: int, offset: np.float32) -> np.float32:
    """gain * code + offset, rounded to a code."""
    value = min(max(gain * np.float32(np.int32(code)) + offset, np.float32(0.0)), np.float32(LARGEST))
    return np.float32(np.int32(value + np.float32(0.5)))


@inlined
def _step(old: np.int32, new: np.float32, share: np.float32, chance: np.float32) -> np.int32:
    """By how much a code moves when it moves by a share of the way to another. It is rounded at random, so that small
    steps have an effect on average."""
    moved = (new - np.float32(old)) * share + chance + np.float32(_ROOM)  # positive
    return np.int32(np.int32(moved) - np.int32(_ROOM))


@serial
def _find_same(pair: int, new: U16, codes: U16, flags: U8, rules: Rules, highest: U16, same: U8) -> None:
    """same [2, w]: 1 in a pair of rows where the new view shows the image's surface, neither of both is farther by a
    nontrivial amount, and nothing nearer by more than a depth edge is next to it; 0 elsewhere. highest [w + 2]: as
    scratch, 0 at both ends."""
    h, w = codes.shape
    top, bottom = 2 * pair, min(2 * pair + 1, h - 1)
    above, one, two, below = new[max(top - 1, 0)], new[top], new[bottom], new[min(bottom + 1, h - 1)]
    around = highest[1 : w + 1]
    for x in range(w):
        around[x] = max(max(above[x], one[x]), max(two[x], below[x]))
    before, after = highest[:w], highest[2 : w + 2]
    margins, lowest, edge = margins_of(rules), np.uint16(rules.lowest), np.int32(rules.edge)
    for row in range(2):
        at = top if row == 0 else bottom
        seen, known, flag, out = new[at], codes[at], flags[at], same[row]
        for x in range(w):
            code, old = seen[x], known[x]
            apart = np.uint16(perhaps_farther(code, old, margins) | perhaps_farther(old, code, margins))
            nearest = np.int32(max(max(before[x], around[x]), after[x]))
            free = (nearest <= np.int32(code) + edge) & (code >= lowest) & (flag[x] & PROVISIONAL == 0)
            out[x] = np.uint8((apart == 0) & free)


@inlined
def _shows(same: U8, left: int, right: int) -> bool:
    """Whether all pixels of a quad are the same surface."""
    return same[0, left] & same[0, right] & same[1, left] & same[1, right] != 0


@serial
def _sum_cell(
    pair: int, cell: int, step: int, new: Picture, known: Picture, tone: F64, same: U8, sums: F64
) -> None:
    """Adds every `step`-th quad of a cell in a pair of rows to the cell's sums [SUMS_SIZE]."""
    w = known.y.shape[1]
    top = 2 * pair
    for column in range(cell * CELL // 2 + pair % step, min((cell + 1) * CELL, w + 1) // 2, step):
        left, right = 2 * column, min(2 * column + 1, w - 1)
        if not _shows(same, left, right):
            continue
        raw, have = mean_luma(new.y, top, left), mean_luma(known.y, top, left)
        seen = tone[Y_GAIN] * raw + tone[Y_OFFSET]
        if max(seen, have) > _BRIGHTEST:
            continue
        blue = tone[CB_GAIN] * new.cb[pair, column] + tone[CB_FROM_Y] * raw + tone[CB_OFFSET]
        red = tone[CR_GAIN] * new.cr[pair, column] + tone[CR_FROM_Y] * raw + tone[CR_OFFSET]
        sums[COUNT] += 1.0
        sums[LUMA] += seen - have
        sums[BLUE] += blue - known.cb[pair, column]
        sums[RED] += red - known.cr[pair, column]


@serial
def _follow_chroma(
    pair: int, begin: int, end: int, new: Picture, known: Picture, tone: F64, number: int, share: float, same: U8
) -> None:
    """Chroma of a pair of rows, in the columns [begin, end) of luma, approaches the view's."""
    w, part, seed = known.y.shape[1], np.float32(share), _seed(2 * pair, number + 1)
    blue_gain, blue_tint, blue_off = np.float32(tone[CB_GAIN]), np.float32(tone[CB_FROM_Y]), np.float32(tone[CB_OFFSET])
    red_gain, red_tint, red_off = np.float32(tone[CR_GAIN]), np.float32(tone[CR_FROM_Y]), np.float32(tone[CR_OFFSET])
    blue, red, new_blue, new_red = known.cb[pair], known.cr[pair], new.cb[pair], new.cr[pair]
    for column in range(begin // 2, (end + 1) // 2):
        left, right = 2 * column, min(2 * column + 1, w - 1)
        if _shows(same, left, right):
            chance, luma = _chance(column, seed), np.float32(mean_luma(new.y, 2 * pair, left))
            old = np.int32(blue[column])
            wanted = _toned(blue_gain, new_blue[column], blue_tint * luma + blue_off)
            blue[column] = old + _step(old, wanted, part, chance)
            old = np.int32(red[column])
            wanted = _toned(red_gain, new_red[column], red_tint * luma + red_off)
            red[column] = old + _step(old, wanted, part, chance)


@serial
def _follow_luma(row: int, begin: int, new: U16, y: U16, tone: F64, number: int, share: float, same: U8) -> None:
    """Luma of a part of a row, from column `begin` on, approaches the view's."""
    gain, offset, part = np.float32(tone[Y_GAIN]), np.float32(tone[Y_OFFSET]), np.float32(share)
    seed = _seed(row, number)
    for x in range(y.shape[0]):
        old = np.int32(y[x])
        step = _step(old, _toned(gain, new[x], offset), part, _chance(begin + x, seed))
        y[x] = np.uint16(old + (step if same[x] != 0 else np.int32(0)))


@serial
def _follow_cell(
    pair: int, begin: int, new: Picture, known: Picture, tone: F64, number: int, share: float, same: U8
) -> None:
    """Colours of a pair of rows of the cell that begins at column `begin` approach the view's."""
    h, w = known.y.shape
    end = min(begin + CELL, w)
    _follow_chroma(pair, begin, end, new, known, tone, number, share, same)
    for row in range(2 * pair, min(2 * pair + 2, h)):
        own = same[row - 2 * pair]
        _follow_luma(row, begin, new.y[row, begin:end], known.y[row, begin:end], tone, number, share, own[begin:end])


@parallel
def follow_light(
    new: Picture, known: Picture, flags: U8, rules: Rules, tone: F64, number: int, look: int, share: float, light: Cells
) -> None:  # fmt: skip
    """Follows the light of a new view in active cells: where it shows the image's surface, colours move by `share` of
    the way to those of the view.

    A call processes every PHASES-th pair of rows; `number` counts the calls. To the sums of active cells is added what
    both showed before, in a sample of quads; to those of the others only when `number` is `look` modulo PHASES. Other
    arguments: see `update_maximum_depth`.
    """
    active, sums = light
    h, w = known.codes.shape
    cells, looks = sums.shape[1], number % PHASES == look
    for band in numba.prange(sums.shape[0]):
        busy = looks
        for cell in range(cells):
            busy |= active[band, cell] > 0
        if not busy:
            continue
        highest, same = np.zeros(w + 2, np.uint16), np.empty((2, w), np.uint8)
        begin, end = np.int64(band) * CELL // 2, min((np.int64(band) + 1) * CELL, h + 1) // 2
        for pair in range(begin + number % PHASES, end, PHASES):
            _find_same(pair, new.codes, known.codes, flags, rules, highest, same)
            for cell in range(cells):
                if active[band, cell] > 0:
                    _sum_cell(pair, cell, _SPARSE, new, known, tone, same, sums[band, cell])
                    _follow_cell(pair, cell * CELL, new, known, tone, number, share, same)
                elif looks:
                    _sum_cell(pair, cell, 1, new, known, tone, same, sums[band, cell])
