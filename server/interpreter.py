"""Python set up for a service whose event loop must not wait for other threads."""

from __future__ import annotations

import asyncio
import gc
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from farside.engine.threads import SWITCH_S

__all__ = ["responsive"]

_FREEZE_AFTER = (1, 2, 4, 8, 16)  # frames: by then every kernel has been loaded


@asynccontextmanager
async def responsive(frames: Callable[[], int]) -> AsyncIterator[None]:
    """Short turns at the interpreter, and a garbage collector that does not look through what start-up made.

    A full collection looks at every object of the modules, and of kernels where they are in this process, tens of
    milliseconds with everything else at a stop. At once and after a few `frames` these objects are set aside; then a
    collection takes less than one.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    gc.collect()
    gc.freeze()
    freezing = asyncio.create_task(_set_aside(frames))
    try:
        yield
    finally:
        freezing.cancel()
        await asyncio.gather(freezing, return_exceptions=True)
        sys.setswitchinterval(before)
        gc.unfreeze()


async def _set_aside(frames: Callable[[], int]) -> None:
    for number in _FREEZE_AFTER:
        while frames() < number:
            await asyncio.sleep(0.5)
        gc.collect()
        gc.freeze()
