"""Parts of captures' pictures, copied side by side into one picture (section 4.2: what is left of older captures)."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import I64, U16
from ..base.jit import inlined, parallel, serial
from ..base.memory import load_u16
from .captures import CB, CODES, CR, HEIGHT, WIDTH, WRAPS, Y

__all__ = ["COLUMN", "HIGH", "LEFT", "PART_SIZE", "ROW", "SOURCE", "TOP", "WIDE", "copy_parts"]

# Columns of a table of parts, int64 [n, PART_SIZE]: the source's row in a table of captures; the part's first column
# and row in the source's picture, its width and height, and its first column and row in the new picture. All but
# SOURCE are even, so that a part has whole samples of chroma.
SOURCE, LEFT, TOP, WIDE, HIGH, COLUMN, ROW = range(7)
PART_SIZE = 7


@inlined
def _clamped(x: int, size: int, wraps: bool) -> int:
    """A column or row clamped to the picture, or wrapped round."""
    return x % size if wraps else min(max(x, 0), size - 1)


@serial
def _copy_plane(source: I64, plane: int, part: I64, half: int, out: U16) -> None:
    """Copies a part of one plane; half: 2 where the plane has half the picture's size, else 1."""
    width, height = (source[WIDTH] + half - 1) // half, (source[HEIGHT] + half - 1) // half
    left, top, column, row = part[LEFT] // half, part[TOP] // half, part[COLUMN] // half, part[ROW] // half
    for y in range(part[HIGH] // half):
        line = width * _clamped(top + y, height, False)
        for x in range(part[WIDE] // half):
            out[row + y, column + x] = load_u16(source[plane], line + _clamped(left + x, width, source[WRAPS] != 0))


@parallel
def copy_parts(sources: I64, parts: I64, codes: U16, y: U16, cb: U16, cr: U16) -> None:
    """Copies parts [n, PART_SIZE] of pictures (sources: a table of captures, `captures`) into a picture's planes.

    Beyond a source's border lies the nearest pixel, or, at the sides of a picture that wraps, the other side's.
    """
    for k in numba.prange(parts.shape[0]):
        source = sources[parts[np.int64(k), SOURCE]]
        _copy_plane(source, CODES, parts[np.int64(k)], 1, codes)
        _copy_plane(source, Y, parts[np.int64(k)], 1, y)
        _copy_plane(source, CB, parts[np.int64(k)], 2, cb)
        _copy_plane(source, CR, parts[np.int64(k)], 2, cr)
