"""Loads and stores by address: all that kernels read and write other than through arrays.

An array handed from function to function is counted up and down each time, which costs more than what is done with it
in kernels of vectors; and pictures of different views are reached through one table of addresses. Whoever takes an
address keeps the array alive. Nothing is checked in compiled code (`memory_llvm`, `memory_scalars_llvm`); where nothing
is compiled, addresses must lie in arrays that are alive (`memory_numpy`).

Only `foreign` loads and stores reach memory that is of no array: what a library hands to a callback. Nothing can check
them, and only callbacks of libraries have a use for them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import config

from .live_arrays import address_of
from .memory_llvm import BEYOND, VECTOR_BYTES

__all__ = [
    "BEYOND",
    "VECTOR_BYTES",
    "add_i64_atomically",
    "address_of",
    "gather_bytes",
    "gather_floats",
    "gather_halves",
    "gather_integers",
    "gather_quads",
    "load",
    "load_eight_u8",
    "load_f32",
    "load_foreign_i64",
    "load_foreign_u32",
    "load_i64",
    "load_u8",
    "load_u16",
    "load_u32",
    "load_u64",
    "load_where",
    "or_u64",
    "prefetch",
    "store",
    "store_byte_where",
    "store_foreign_i32",
    "store_larger",
    "store_packed",
    "store_where",
]

if TYPE_CHECKING or config.DISABLE_JIT:
    from .memory_numpy import (
        add_i64_atomically,
        gather_bytes,
        gather_floats,
        gather_halves,
        gather_integers,
        gather_quads,
        load,
        load_eight_u8,
        load_f32,
        load_foreign_i64,
        load_foreign_u32,
        load_i64,
        load_u8,
        load_u16,
        load_u32,
        load_u64,
        load_where,
        or_u64,
        prefetch,
        store,
        store_byte_where,
        store_foreign_i32,
        store_larger,
        store_packed,
        store_where,
    )
else:
    from .memory_llvm import (
        gather_bytes,
        gather_floats,
        gather_halves,
        gather_integers,
        gather_quads,
        load,
        load_where,
        prefetch,
        store,
        store_byte_where,
        store_larger,
        store_packed,
        store_where,
    )
    from .memory_scalars_llvm import (
        add_i64_atomically,
        load_eight_u8,
        load_f32,
        load_foreign_i64,
        load_foreign_u32,
        load_i64,
        load_u8,
        load_u16,
        load_u32,
        load_u64,
        or_u64,
        store_foreign_i32,
    )
