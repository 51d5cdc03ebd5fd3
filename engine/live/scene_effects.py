"""The 3D effects of the scene on show: kept here, as the engine is another one when the cameras are others."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from operator import methodcaller
from typing import Any

from ..rig.effects import Effect
from .core import Core, CoreLostError
from .core_uses import CoreUses

__all__ = ["MOST_EFFECTS", "SceneEffects"]

_log = logging.getLogger(__name__)
MOST_EFFECTS = 16


@dataclass(frozen=True, slots=True)
class _Held:
    effect: Effect
    content: Any


class SceneEffects:
    """The effects by name. For the event loop only; `core`: returns the present core, None: there is none yet.

    Changes are made one after the other. A new core gets all of them (`put_all`).
    """

    def __init__(self, core: Callable[[], Core | None], uses: CoreUses) -> None:
        self._core, self._uses = core, uses
        self._held: dict[str, _Held] = {}
        self._one = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1, "farside-effects")

    def get(self, name: str) -> Effect | None:
        """The effect of a name; None: there is none."""
        return self._held[name].effect if name in self._held else None

    def has_content(self, name: str) -> bool:
        """Whether an effect's picture or mesh has been put."""
        return name in self._held and self._held[name].content is not None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all effects, in the order in which they were added."""
        return tuple(self._held)

    async def put(self, name: str, effect: Effect, content: Any = None) -> None:
        """Add or change an effect (`Engine.put_effect`). When this returns, the next picture shows it.

        Raises ValueError, and changes nothing, for one that the engine does not take, and for more than MOST_EFFECTS.
        """
        async with self._one:
            held = self._held.get(name)
            if held is None and len(self._held) >= MOST_EFFECTS:
                raise ValueError(f"effects: {len(self._held)}: expected less than {MOST_EFFECTS} before another one")
            await self._ask(methodcaller("put_effect", name, effect, content))
            if content is None and held is not None and type(held.effect) is type(effect):
                content = held.content
            self._held[name] = _Held(effect, content)

    async def remove(self, name: str) -> None:
        """Remove an effect, if it is there."""
        async with self._one:
            await self._ask(methodcaller("remove_effect", name))
            self._held.pop(name, None)

    async def put_all(self) -> None:
        """Give the present core, a new one, all effects; one that it does not take is logged, and not seen."""
        async with self._one:
            for name, held in self._held.items():
                try:
                    await self._ask(methodcaller("put_effect", name, held.effect, held.content))
                except ValueError as error:
                    _log.warning("effect %s is not shown: %s", name, error)

    async def close(self) -> None:
        """End the thread."""
        await asyncio.to_thread(self._thread.shutdown, wait=True, cancel_futures=True)

    async def _ask(self, work: Callable[[Core], None]) -> None:
        """Ask the present core, if there is one that lives."""
        core = self._core()
        if core is None:
            return
        with self._uses.using(core):
            try:
                await asyncio.get_running_loop().run_in_executor(self._thread, work, core)
            except CoreLostError:
                _log.warning("the engine was lost; the effects wait for the next one")
