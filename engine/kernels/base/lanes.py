"""Vector operations on rows of 64 pixels, and bits of words.

Bit x of a word (int64) stands for column x of a row. Addresses are in bytes. Like `simd`, this is compiled
(`lanes_llvm`), or done by NumPy if nothing is compiled (`lanes_numpy`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import config

from .lanes_llvm import LANES

__all__ = [
    "LANES",
    "bits_of",
    "bytes_from",
    "codes_there",
    "cuts",
    "differ",
    "lowest",
    "mark",
    "move",
    "ones",
    "side_errors",
    "square_errors",
]

if TYPE_CHECKING or config.DISABLE_JIT:
    from .lanes_numpy import (
        bits_of,
        bytes_from,
        codes_there,
        cuts,
        differ,
        lowest,
        mark,
        move,
        ones,
        side_errors,
        square_errors,
    )
else:
    from .lanes_llvm import (
        bits_of,
        bytes_from,
        codes_there,
        cuts,
        differ,
        lowest,
        mark,
        move,
        ones,
        side_errors,
        square_errors,
    )
