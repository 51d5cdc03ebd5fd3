"""Which cores are being asked for something: a core that another one has replaced is closed after its last call."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from .core import Core

__all__ = ["CoreUses"]


class CoreUses:
    """Calls of cores that are under way. For the event loop only."""

    def __init__(self) -> None:
        self._calls: Counter[int] = Counter()  # under way, by the core's id
        self._retired: dict[int, Core] = {}  # cores that are to be closed when their last call has ended, by their id
        self._closing: set[asyncio.Task[None]] = set()

    @contextmanager
    def using(self, core: Core) -> Iterator[None]:
        """A core is asked for something while the block runs: it is not closed meanwhile."""
        self._calls[id(core)] += 1
        try:
            yield
        finally:
            self._calls[id(core)] -= 1
            if id(core) in self._retired:
                self.retire(core)

    def retire(self, core: Core) -> None:
        """Close a core that another one has replaced, once nothing is asked of it any more. To wait for the collection
        of garbage would keep its process, and hundreds of megabytes, for minutes."""
        if self._calls[id(core)]:
            self._retired[id(core)] = core
        else:
            self._retired.pop(id(core), None)
            del self._calls[id(core)]
            self._closing.add(closing := asyncio.create_task(asyncio.to_thread(core.close)))
            closing.add_done_callback(self._closing.discard)

    async def closed(self) -> None:
        """Wait until the cores that are being closed are."""
        await asyncio.gather(*self._closing)
