"""Where a view's surface is cut: depth edges between neighbouring pixels, and pixels without depth."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import I64, U8, U16
from ..base import lanes
from ..base.jit import inlined, parallel, serial
from ..base.lanes import LANES

__all__ = ["BROKEN", "CUT_DOWN", "CUT_RIGHT", "KEPT", "VALID", "mark_broken"]


# Bits of a pixel's flags, in the order of `_write_flags`.
CUT_RIGHT = 1  # no surface between this pixel and its right neighbour
CUT_DOWN = 2
BROKEN = 4  # a cut or a change of the mask touches this pixel: never inside a merged triangle
KEPT = 8
VALID = 16

_BAND = LANES  # rows
_RIGHT, _DOWN, _VALID, _KEPT = 0, 1, 2, 3  # words of a row


class CutRules(NamedTuple):
    """The rules for cuts of a view's picture."""

    edge: int  # codes; `odd` is added where the slope next to a step is odd: see `lanes.cuts`
    odd: int
    has_invalid: bool  # code 0 means "no depth"
    has_keep: bool  # there is a mask
    wraps: bool  # the last column is the first one's neighbour


@serial
def _pad_row(row: U16, wraps: bool, padded: U16) -> None:
    """padded: a row of codes with one more pixel before it and two more behind."""
    w = row.shape[0]
    source, target = row.ctypes.data, padded.ctypes.data + 2
    for j in range(w // LANES):
        lanes.move(source + 2 * LANES * j, target + 2 * LANES * j)
    for x in range(w // LANES * LANES, w):
        padded[x + 1] = row[x]
    padded[0] = row[w - 1] if wraps else row[0]
    padded[w + 1] = row[0] if wraps else row[w - 1]
    padded[w + 2] = row[1 % w] if wraps else row[w - 1]


@serial
def _mark_row(rows: U16, y: int, h: int, w: int, keep: U8, rules: CutRules, near: U8, words: I64) -> None:
    """Cuts, validity and mask of row y as words [4, n] of 64 pixels, where near [n] != 0; rows: ring of padded rows."""
    edge, odd, has_invalid, has_keep, wraps = rules
    ring, pitch = rows.ctypes.data + 2, 2 * rows.shape[1]
    above, here = ring + (max(y - 1, 0) & 3) * pitch, ring + (y & 3) * pitch
    below, below2 = ring + (min(y + 1, h - 1) & 3) * pitch, ring + (min(y + 2, h - 1) & 3) * pitch
    n = words.shape[1]
    for j in range(n):
        if near[j] == 0:
            continue
        start = 2 * LANES * j
        words[_RIGHT, j] = lanes.cuts(
            here + start - 2, here + start, here + start + 2, here + start + 4, edge, odd, has_invalid
        )
        words[_DOWN, j] = lanes.cuts(
            above + start, here + start, below + start, below2 + start, edge, odd, has_invalid
        )
        words[_VALID, j] = lanes.codes_there(here + start) if has_invalid else -1
        words[_KEPT, j] = lanes.bits_of(keep.ctypes.data + LANES * j, 255) if has_keep else -1
    if y == h - 1:
        for j in range(n):
            words[_DOWN, j] = 0
    last = w - 1 - LANES * (n - 1)
    inside = -1 if last == LANES - 1 else (1 << (last + 1)) - 1
    for k in range(4):
        words[k, n - 1] &= inside
    if not wraps:
        words[_RIGHT, n - 1] &= ~(1 << last)


@inlined
def _before(words: I64, j: int, first: int) -> int:
    """Word j with, for each pixel, the bit of its left neighbour; `first`: that of the row's first pixel."""
    return (words[j] << 1) | ((words[j - 1] >> 63) & 1 if j > 0 else first)


@inlined
def _behind(words: I64, j: int, last: int, beyond: int) -> int:
    """Word j with, for each pixel, the bit of its right neighbour; `beyond`: that of the row's last pixel, which is bit
    `last` of the last word."""
    if j + 1 < words.shape[0]:
        return ((words[j] >> 1) & 0x7FFFFFFFFFFFFFFF) | (words[j + 1] << 63)
    return ((words[j] >> 1) & 0x7FFFFFFFFFFFFFFF & ~(1 << last)) | (beyond << last)


@serial
def _write_flags(
    above: I64, here: I64, below: I64, has_keep: bool, wraps: bool, wanted: U8, tail: U8, flags: U8
) -> None:
    """flags [w] of a row from the words of three rows, where wanted != 0; tail: 64 bytes of scratch memory."""
    w = flags.shape[0]
    n = here.shape[1]
    right, kept, last = here[_RIGHT], here[_KEPT], w - 1 - LANES * (n - 1)
    for j in range(n):
        if wanted[j] == 0:
            continue
        seam = (right[n - 1] >> last) & 1 if wraps else 0
        broken = right[j] | _before(right, j, seam) | here[_DOWN, j] | above[_DOWN, j] | ~here[_VALID, j]
        if has_keep:
            before = (kept[n - 1] >> last) & 1 if wraps else kept[0] & 1
            beyond = kept[0] & 1 if wraps else (kept[n - 1] >> last) & 1
            broken |= (kept[j] ^ above[_KEPT, j]) | (kept[j] ^ below[_KEPT, j])
            broken |= (kept[j] ^ _before(kept, j, before)) | (kept[j] ^ _behind(kept, j, last, beyond))
        whole = LANES * (j + 1) <= w
        target = flags.ctypes.data + LANES * j if whole else tail.ctypes.data
        lanes.bytes_from(right[j], here[_DOWN, j], broken, kept[j], here[_VALID, j], target)
        if not whole:
            for x in range(LANES * j, w):
                flags[x] = tail[x - LANES * j]


@parallel
def mark_broken(
    codes: U16, keep: U8, has_keep: bool, has_invalid: bool, edge: float, wraps: bool, wanted: U8, flags: U8
) -> None:
    """Fill flags [h, w]: cuts to the right and downwards, validity, mask, and pixels that merged triangles must not
    contain; only where wanted [ceil(h / 64), ceil(w / 64)] is not 0.

    A depth edge is a step of more than `edge` codes that is not explained by the slope on either side.
    """
    h, w = codes.shape
    n = (w + LANES - 1) // LANES
    edge = min(edge, 65536.0)  # no step is larger
    whole = min(math.floor(edge), 65535)
    rules = CutRules(whole, math.floor(edge + 0.5) - math.floor(edge), has_invalid, has_keep, wraps)
    for band in numba.prange((h + _BAND - 1) // _BAND):
        near = np.empty(n, np.uint8)  # words on which the wanted flags depend: also the neighbouring ones
        some = np.uint8(0)
        for j in range(n):
            near[j] = wanted[band, j - 1] | wanted[band, j] | wanted[band, (j + 1) % n]
            some |= wanted[band, j]
        if some == 0:
            continue
        first, end = int(np.int64(band)) * _BAND, min((int(np.int64(band)) + 1) * _BAND, h)
        rows = np.empty((4, n * LANES + 4), np.uint16)  # a ring: the rows that one row's cuts depend on
        words = np.zeros((4, 4, n), np.int64)  # a ring of three: the words on which a row's flags depend
        top = words[3]  # those of the row above the picture
        mask, tail = np.empty(n * LANES, np.uint8), np.empty(LANES, np.uint8)
        padded = max(first - 2, 0)  # the next row to be padded
        for y in range(max(first - 1, 0), min(end, h - 1) + 1):
            while padded <= min(y + 2, h - 1):
                _pad_row(codes[padded], wraps, rows[padded & 3])
                padded += 1
            if has_keep:
                for x in range(w):
                    mask[x] = keep[y, x]
            _mark_row(rows, y, h, w, mask, rules, near, words[y % 3])
            if y == 0:  # beyond the picture there are no cuts, and the mask continues
                for j in range(n):
                    top[_KEPT, j] = words[0, _KEPT, j]
            if y > first:
                above = words[(y - 2) % 3] if y > 1 else top
                _write_flags(above, words[(y - 1) % 3], words[y % 3], has_keep, wraps, wanted[band], tail, flags[y - 1])
        if end == h:
            above = words[(h - 2) % 3] if h > 1 else top
            here = words[(h - 1) % 3]
            _write_flags(above, here, here, has_keep, wraps, wanted[band], tail, flags[h - 1])
