"""Settings of Python for threads that must not wait long for one another: the switch interval, garbage collection."""

from __future__ import annotations

import asyncio
import gc
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

__all__ = ["SETTLES_AFTER", "SWITCH_S", "responsive", "set_aside"]

SWITCH_S = 0.0003  # how long a thread may keep the interpreter while another wants it; Python's default is 5 ms
SETTLES_AFTER = (1, 2, 4, 8, 16)  # objects are set aside after these frames: by the last, all kernels are loaded


def set_aside() -> None:
    """Exclude all present objects from garbage collection. A full collection would visit every object from start-up,
    including those of the compiler and the kernels, and stop all threads for tens of milliseconds."""
    gc.collect()
    gc.freeze()


@asynccontextmanager
async def responsive(frames: Callable[[], int]) -> AsyncIterator[None]:
    """A short switch interval, and a garbage collector that skips the objects from start-up, while the block runs.

    Objects are set aside at once, and again after a few frames, because kernels may be loaded in this process; `frames`
    returns the number of frames so far. Then a collection takes less than a millisecond. This is for an event loop that
    must not wait for other threads.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    set_aside()
    freezing = asyncio.create_task(_set_aside(frames))
    try:
        yield
    finally:
        freezing.cancel()
        await asyncio.gather(freezing, return_exceptions=True)
        sys.setswitchinterval(before)
        gc.unfreeze()


async def _set_aside(frames: Callable[[], int]) -> None:
    for number in SETTLES_AFTER:
        while frames() < number:
            await asyncio.sleep(0.5)
        set_aside()
