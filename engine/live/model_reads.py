"""What is read from the background model while it grows: files of it, and answers to questions."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ..rig.questions import NoModelError
from .core import Core
from .core_uses import CoreUses
from .update_priority import GENTLE

__all__ = ["ModelReads"]


class ModelReads:
    """Reads the model of the core that is shown, in threads that give way to pictures. `core`: returns it; None: none
    has a frame to show yet."""

    def __init__(self, core: Callable[[], Core | None], uses: CoreUses) -> None:
        self._core, self._uses = core, uses
        self._exports = ThreadPoolExecutor(1, "farside-export")
        self._queries = ThreadPoolExecutor(1, "farside-query")  # they do not wait for an export

    async def mesh(self, file_format: str, colours: str | None = None) -> bytes:
        """The background model as a file (`Core.mesh`); raises ValueError if there is none."""
        return bytes(await self._read(self._exports, "mesh", file_format, colours))

    async def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a question about the model (`Core.query`)."""
        return dict(await self._read(self._queries, "query", question, arguments))

    async def close(self) -> None:
        """Wait for what is being read, and end the threads."""
        for pool in (self._exports, self._queries):
            await asyncio.to_thread(pool.shutdown, wait=True, cancel_futures=True)

    async def _read(self, pool: ThreadPoolExecutor, method: str, *arguments: Any) -> Any:
        """What a method of the core returns."""
        core = self._core()
        if core is None:
            what = "mesh" if method == "mesh" else "model"
            raise NoModelError(f"{what}: there is none before the first frame: expected a source to be playing")
        loop = asyncio.get_running_loop()
        with self._uses.using(core):
            await loop.run_in_executor(pool, core.give_way, GENTLE)
            return await loop.run_in_executor(pool, getattr(core, method), *arguments)
