"""Squares of 4 x 4 numbers in the lanes of a vector, and windows of pictures from which lanes pick texels.

A gather of sixteen takes the processor longer than sixteen loads. Pixels of a square mostly see texels that lie close
together in a view's picture, whichever way that is turned: where they lie in a window of 8 x 16 texels, eight loads and
some permutations in registers do what takes many gathers. Where the processor has no such permutation
(`fast_windows`), gathers are used instead (`memory`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import config

from .windows_numpy import Window

__all__ = [
    "WINDOW_COLUMNS",
    "WINDOW_ROWS",
    "Window",
    "extent_of",
    "fast_windows",
    "lane_of",
    "load_square",
    "lower_rows",
    "pairs_within",
    "prefetch_window",
    "quads_within",
    "store_square",
    "upper_rows",
    "window_of_bytes",
    "window_of_halves",
]

WINDOW_ROWS, WINDOW_COLUMNS = 8, 16

if TYPE_CHECKING or config.DISABLE_JIT:
    from .windows_numpy import (
        extent_of,
        fast_windows,
        lane_of,
        load_square,
        lower_rows,
        pairs_within,
        prefetch_window,
        quads_within,
        store_square,
        upper_rows,
        window_of_bytes,
        window_of_halves,
    )
else:
    from .windows_llvm import (
        extent_of,
        fast_windows,
        lane_of,
        load_square,
        lower_rows,
        pairs_within,
        prefetch_window,
        quads_within,
        store_square,
        upper_rows,
        window_of_bytes,
        window_of_halves,
    )
