"""Vectors in kernels: sixteen floats, integers or truths that compiled code computes with as with scalars.

Compilers do not vectorise loops that gather from pictures. These types have the operators of NumPy arrays (arithmetic,
comparisons, & | ^ >> <<); Python numbers are spread over all lanes; the functions below do the rest. LLVM maps them to
the registers of the processor, one of AVX-512 or several smaller ones (`simd_llvm`). If nothing is compiled
(NUMBA_DISABLE_JIT=1), for a debugger or for line coverage, NumPy takes their place (`simd_numpy`); type checkers read
that, too. `memory` has the loads and stores of vectors.
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
