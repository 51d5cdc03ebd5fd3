"""Threads of the compiled kernels and of the ray tracer. Import before the first parallel kernel runs.

Numba's default threading layer aborts the process when two Python threads enter parallel kernels at once. Its TBB
layer does not, but it finds the library of the `tbb` wheel only if that library is already loaded.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numba
from numba.np.ufunc import parallel

from .cores import core_count
from .cpu_level import chosen_cpu

__all__ = ["give_way", "one_thread", "require_tbb", "set_thread_count", "thread_count"]


def _load_tbb() -> None:
    library = Path(sys.prefix) / "lib" / "libtbb.so.12"
    with contextlib.suppress(OSError):  # Numba's own search may still find it; require_tbb checks
        ctypes.CDLL(str(library if library.exists() else "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)


_load_tbb()
numba.config.THREADING_LAYER = "tbb"
if chosen_cpu() and "NUMBA_CPU_NAME" not in os.environ:
    numba.config.CPU_NAME, numba.config.CPU_FEATURES = chosen_cpu(), ""
if "NUMBA_NUM_THREADS" not in os.environ:
    numba.config.NUMBA_NUM_THREADS = core_count()  # Numba does not know of a container's quota


def thread_count() -> int:
    """The number of threads of a kernel that this thread starts, and the most that a ray tracing device uses."""
    return min(core_count(), int(numba.get_num_threads()))


def set_thread_count(count: int) -> None:
    """Sets the number of threads of kernels that the calling thread starts.

    Raises ValueError for a count outside 1 .. NUMBA_NUM_THREADS.
    """
    if not 1 <= count <= numba.config.NUMBA_NUM_THREADS:
        raise ValueError(f"threads: {count!r}: expected 1 to {numba.config.NUMBA_NUM_THREADS}")
    numba.set_num_threads(count)


@contextlib.contextmanager
def one_thread(when: bool = True) -> Iterator[None]:
    """Run kernels that this thread starts on this thread alone, if `when` holds."""
    threads = int(numba.get_num_threads())
    if when:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(threads)


def give_way(niceness: int) -> None:
    """Run the calling thread's kernels on one core fewer than available and at a lower priority.

    `niceness` is added to the niceness of the process (the sum is at most 19). Only Linux has a priority per thread.
    The threads that help with a kernel keep their priority; on two cores there are none, as one core is left free.
    """
    set_thread_count(max(1, min(core_count(), numba.config.NUMBA_NUM_THREADS) - 1))
    if sys.platform == "linux":
        behind = min(os.getpriority(os.PRIO_PROCESS, os.getpid()) + niceness, 19)
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), behind)


def require_tbb() -> None:
    """Starts the threading layer; raises RuntimeError if it is not TBB."""
    parallel._launch_threads()
    layer = numba.threading_layer()
    if layer != "tbb":
        raise RuntimeError(f"Numba's threading layer is {layer}: expected tbb (pip install tbb)")
