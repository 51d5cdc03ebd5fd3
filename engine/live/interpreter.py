"""Python where threads must not wait long for one another: turns at the interpreter, and collections of garbage."""

from __future__ import annotations

import asyncio
import gc
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

__all__ = ["SETTLES_AFTER", "SWITCH_S", "responsive", "set_aside"]

SWITCH_S = 0.0003  # how long a thread may keep the interpreter while another wants it; Python's default is 5 ms
SETTLES_AFTER = (1, 2, 4, 8, 16)  # frames, after which objects are set aside: by then every kernel has been loaded


def set_aside() -> None:
    """Let no collection look at the objects that there are: a full one would look through all that start-up made, the
    compiler's and its kernels' too, tens of milliseconds with everything else at a stop."""
    gc.collect()
    gc.freeze()


@asynccontextmanager
async def responsive(frames: Callable[[], int]) -> AsyncIterator[None]:
    """Short turns at the interpreter, and a garbage collector that does not look through what start-up made.

    Set aside are the objects that exist at once, and those that exist after a few `frames`, as kernels may be in this
    process; then a collection takes less than a millisecond. For an event loop that must not wait for other threads.
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
