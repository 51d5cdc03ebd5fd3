"""Flags of a maximum depth image's pixels: bits of a uint8 per pixel."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import U8, U16
from ..base.jit import inlined, parallel
from .nontrivial import Rules

__all__ = ["ALL", "FRESH", "KEPT", "PROVISIONAL", "TRIED", "UPDATED", "beside_nearer", "coloured", "mark_provisional"]

# UPDATED: changed since the camera's last turn; KEPT: belongs to the P-PBS. A provisional colour is FRESH, or TRIED: it
# was looked at again and was still next to something nearer, and now waits for a change. (`triangle_filter` has more
# bits of its own.)
UPDATED, KEPT, FRESH, TRIED = 1, 2, 4, 8
PROVISIONAL = FRESH | TRIED
ALL = 255


@inlined
def beside_nearer(codes: U16, row: int, x: int, edge: int) -> bool:
    """Whether one of the eight neighbours is nearer by more than a depth edge, so that colours are mixed."""
    limit = int(codes[row, x]) + edge
    for y in range(max(row - 1, 0), min(row + 2, codes.shape[0])):
        for u in range(max(x - 1, 0), min(x + 2, codes.shape[1])):
            if codes[y, u] > limit:
                return True
    return False


@inlined
def coloured(flags: int, provisional: int) -> int:
    """A pixel's flags with the state of its colour set to `provisional` (0, FRESH or TRIED)."""
    return (flags & (ALL ^ PROVISIONAL)) | provisional


@parallel
def mark_provisional(codes: U16, rules: Rules, flags: U8) -> None:
    """Sets in flags [h, w] which colours are provisional: something nearer may be mixed into them."""
    h, w = codes.shape
    for row in numba.prange(h):
        y = int(np.int64(row))
        nearest = np.empty(w, np.uint16)  # the nearest of a pixel, the one above and the one below
        above, below = codes[max(y - 1, 0)], codes[min(y + 1, h - 1)]
        for x in range(w):
            nearest[x] = max(max(above[x], below[x]), codes[y, x])
        edge = np.int32(rules.edge)
        for x in (0, w - 1):
            flags[y, x] = coloured(flags[y, x], FRESH * beside_nearer(codes, y, x, edge))
        for x in range(1, w - 1):
            highest = max(max(nearest[x - 1], nearest[x]), nearest[x + 1])
            nearer = np.int32(highest) > np.int32(codes[y, x]) + edge
            flags[y, x] = coloured(flags[y, x], FRESH * nearer)
