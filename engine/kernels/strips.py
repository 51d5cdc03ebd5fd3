"""Triangles drawn in strips sixteen pixels wide, a row at a time in vector registers.

A pixel is inside a triangle where three functions of its place, the sides, are not negative; they and the disparity
are sums of multiples of a pixel's column and row. No branch depends on the triangle's shape: a small one costs little
more than its rows. Sums in float32 are wrong by 1e-4 pixels where a triangle is as large as the picture, and less in
smaller ones.
"""

from __future__ import annotations

import numba
import numpy as np

from .simd import lane_numbers, load_where, maximum, minimum, select, store_byte_where, store_where

__all__ = ["draw_strip"]

Numbers = tuple[float, ...]


@numba.njit(forceinline=True, cache=True, error_model="numpy")
def draw_strip(
    disparity: int, winner: int, width: int, count: int, rows: int, sides: Numbers, plane: Numbers,
    margin: float, push: float, view: int,
) -> None:  # fmt: skip
    """Draw into the first `count` of 16 columns and `rows` rows of a picture that is `width` columns wide.

    disparity, winner: addresses of the strip's first pixel in C-contiguous arrays: of disparity (float32, 0 where
    nothing was drawn) and of the number of the view that won (uint8). sides: three times (at the first pixel, change a
    column, change a row); plane: the same of disparity, its least and its largest. What was drawn must be beaten by
    `margin`; `push` metres move what is drawn away.
    """
    column = lane_numbers()
    among = column < np.float32(count)
    first_a, first_b = sides[1] * column + sides[0], sides[4] * column + sides[3]
    first_c, first_q = sides[7] * column + sides[6], plane[1] * column + plane[0]
    for row in range(rows):
        y, at = np.float32(row), row * width
        q = minimum(maximum(plane[2] * y + first_q, plane[3]), plane[4])
        if push > 0.0:
            q = q / (push * q + 1.0)
        inside = among & (sides[2] * y + first_a >= 0.0)
        inside &= (sides[5] * y + first_b >= 0.0) & (sides[8] * y + first_c >= 0.0)
        before = load_where(disparity, at, inside)
        wins = inside & (q > select(before > 0.0, before + margin, 0.0))
        store_where(disparity, at, q, wins)
        store_byte_where(winner, at, view, wins)
