"""The settings of Python that the service changes, and that it restores them."""

from __future__ import annotations

import asyncio
import gc
import sys

from farside.engine.live import interpreter
from farside.engine.live.interpreter import responsive


def test_turns_are_short_and_objects_of_the_start_are_set_aside_when_frames_have_come(monkeypatch) -> None:
    monkeypatch.setattr(interpreter, "SETTLES_AFTER", (1, 3))
    frames, freezes, freeze = [0], [0], gc.freeze
    before = sys.getswitchinterval()

    def counted() -> None:
        freezes[0] += 1
        freeze()

    monkeypatch.setattr(gc, "freeze", counted)

    async def scenario() -> None:
        async with responsive(lambda: frames[0]):
            assert sys.getswitchinterval() < 0.001 < before
            await asyncio.sleep(0)
            assert freezes[0] == 1
            for turn, now in enumerate((2, 3), start=2):
                frames[0] = now
                async with asyncio.timeout(20):
                    while freezes[0] < turn:
                        await asyncio.sleep(0.01)
                assert freezes[0] == turn
                assert gc.get_freeze_count() > 0

    asyncio.run(scenario())
    assert sys.getswitchinterval() == before
    assert gc.get_freeze_count() == 0
