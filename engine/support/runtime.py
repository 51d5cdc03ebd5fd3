"""Threads of the compiled kernels and of the ray tracer. Import before the first parallel kernel runs.

Numba's default layer aborts the process when two Python threads enter parallel kernels at once; its TBB layer
does not, but finds the library of the `tbb` wheel only where that is loaded already.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import threading
from pathlib import Path

import numba

__all__ = ["give_way", "require_tbb", "set_thread_count", "thread_count"]


def _load_tbb() -> None:
    library = Path(sys.prefix) / "lib" / "libtbb.so.12"
    with contextlib.suppress(OSError):  # elsewhere Numba's own search may find it; require_tbb tells
        ctypes.CDLL(str(library if library.exists() else "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)


_load_tbb()
numba.config.THREADING_LAYER = "tbb"


def thread_count() -> int:
    """How many threads a kernel started from this thread uses, and a ray tracing device at most."""
    return min(_available(), int(numba.get_num_threads()))


def _available() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def set_thread_count(count: int) -> None:
    """Bounds the threads of kernels started from the calling thread; ValueError outside 1 .. what was launched."""
    if not 1 <= count <= numba.config.NUMBA_NUM_THREADS:
        raise ValueError(f"threads: {count!r}: expected 1 to {numba.config.NUMBA_NUM_THREADS}")
    numba.set_num_threads(count)


def give_way(niceness: int) -> None:
    """What the calling thread computes from now on leaves a core to others, and those that others want, too.

    `niceness` is beside that of the process. Only Linux has priorities by thread, and threads that help a kernel keep
    theirs: with one core to be left of two, there are none.
    """
    set_thread_count(max(1, min(_available(), numba.config.NUMBA_NUM_THREADS) - 1))
    if sys.platform == "linux":
        behind = min(os.getpriority(os.PRIO_PROCESS, os.getpid()) + niceness, 19)
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), behind)


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
