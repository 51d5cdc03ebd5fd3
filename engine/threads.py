"""Threads of the compiled kernels and of the ray tracer. Import before the first parallel kernel runs.

Numba's default layer aborts the process when two Python threads enter parallel kernels at once; its TBB layer
does not, but finds the library of the `tbb` wheel only where that is loaded already.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from pathlib import Path

import numba

__all__ = ["require_tbb", "set_thread_count", "thread_count"]


def _load_tbb() -> None:
    library = Path(sys.prefix) / "lib" / "libtbb.so.12"
    with contextlib.suppress(OSError):  # elsewhere Numba's own search may find it; require_tbb tells
        ctypes.CDLL(str(library if library.exists() else "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)


_load_tbb()
numba.config.THREADING_LAYER = "tbb"


def thread_count() -> int:
    """How many threads a kernel started from this thread uses, and a ray tracing device at most."""
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(available, int(numba.get_num_threads()))


def set_thread_count(count: int) -> None:
    """Bounds the threads of kernels started from the calling thread; ValueError outside 1 .. what was launched."""
    if not 1 <= count <= numba.config.NUMBA_NUM_THREADS:
        raise ValueError(f"threads: {count!r}: expected 1 to {numba.config.NUMBA_NUM_THREADS}")
    numba.set_num_threads(count)


@numba.njit(parallel=True)  # type: ignore[untyped-decorator]
def _touch(count: int) -> int:
    total = 0
    for i in numba.prange(count):
        total += i
    return total


def require_tbb() -> None:
    """Starts the threading layer and raises RuntimeError where it is not TBB."""
    try:
        layer = numba.threading_layer()
    except ValueError:  # no parallel kernel has run yet
        _touch(2)
        layer = numba.threading_layer()
    if layer != "tbb":
        raise RuntimeError(f"Numba's threading layer is {layer}: expected tbb (pip install tbb)")
