"""Python set up for a service whose event loop must not wait for other threads."""

from __future__ import annotations

import asyncio
import gc
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from farside.engine.live.interpreter import SETTLES_AFTER, SWITCH_S, set_aside

__all__ = ["responsive"]


@asynccontextmanager
async def responsive(frames: Callable[[], int]) -> AsyncIterator[None]:
    """Short turns at the interpreter, and a garbage collector that does not look through what start-up made.

    At once and after a few `frames`, as kernels may be in this process, what there is is set aside; then a collection
    takes less than a millisecond.
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
