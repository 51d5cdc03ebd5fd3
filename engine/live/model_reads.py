"""What is read from the background model while it grows: files of it, and answers to questions."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ..rig.questions import NoModelError
from .core import Core
from .core_uses import CoreUses
from .update_priority import GENTLE

__all__ = ["ModelReads"]

# Rays, points or spheres of a part, which takes some tenths of a second at most.
_SHORT, _LONGEST = 1 << 10, {"rays": 1 << 16, "free": 1 << 16}


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
        """The answer to a question about the model (`Core.query`). Long ones are asked in parts, and between them
        others have their turn."""
        parts = _parts(arguments, _LONGEST.get(question, _SHORT))
        return _joined([dict(await self._read(self._queries, "query", question, part)) for part in parts])

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


def _parts(arguments: Mapping[str, Any], most: int) -> Iterator[dict[str, Any]]:
    """Arguments of which arrays with an item for each ray, point or sphere have `most` items at most; at least once."""
    arrays = {name: value for name, value in arguments.items() if isinstance(value, np.ndarray) and value.ndim > 0}
    count = max(map(len, arrays.values()), default=0)
    for start in range(0, max(count, 1), most):
        yield {**arguments, **{name: value[start : start + most] for name, value in arrays.items()}}


def _joined(answers: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The answers to parts as one; numbers, as that of the frame, are the last part's."""
    if len(answers) == 1:
        return answers[0]
    return {
        name: np.concatenate([answer[name] for answer in answers]) if isinstance(value, np.ndarray) else value
        for name, value in answers[-1].items()
    }
