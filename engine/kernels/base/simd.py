"""Vectors in kernels: sixteen floats, integers or truths that compiled code computes with as with scalars.

Loops that gather from pictures do not become vector code by themselves. These types have the operators of NumPy arrays
(arithmetic, comparisons, & | ^ >> <<), Python numbers are spread over all lanes, and the functions below do the rest.
LLVM turns them into what the processor has, one AVX-512 register or several smaller (`simd_llvm`). Where nothing is
compiled (NUMBA_DISABLE_JIT=1), in a debugger or to count which lines run, NumPy stands in (`simd_numpy`); type checkers
read that, too. How vectors come from memory and go there, `memory` tells.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import config

from .simd_numpy import Floats, Integers, Mask
from .vectors_llvm import LANES

__all__ = [
    "LANES",
    "Floats",
    "Integers",
    "Mask",
    "any_of",
    "evens",
    "lane_numbers",
    "maximum",
    "minimum",
    "odds",
    "round_down",
    "round_up",
    "select",
    "spread",
    "square_root",
    "sum_pairs",
    "to_floats",
    "to_integers",
    "zipped",
    "zipped_rest",
]

if TYPE_CHECKING or config.DISABLE_JIT:
    from .simd_numpy import (
        any_of,
        evens,
        lane_numbers,
        maximum,
        minimum,
        odds,
        round_down,
        round_up,
        select,
        spread,
        square_root,
        sum_pairs,
        to_floats,
        to_integers,
        zipped,
        zipped_rest,
    )
else:
    from .simd_llvm import (
        any_of,
        evens,
        lane_numbers,
        maximum,
        minimum,
        odds,
        round_down,
        round_up,
        select,
        spread,
        square_root,
        sum_pairs,
        to_floats,
        to_integers,
        zipped,
        zipped_rest,
    )
