"""What the service asks of Python, and that it gives it back."""

from __future__ import annotations

import asyncio
import gc
import sys

from farside.server import interpreter
from farside.server.interpreter import responsive


def test_turns_are_short_and_objects_of_the_start_are_set_aside_when_frames_have_come(monkeypatch) -> None:
    monkeypatch.setattr(interpreter, "_FREEZE_AFTER", (1, 3))
    frames, counts = [0], []
    before = sys.getswitchinterval()

    async def scenario() -> None:
        async with responsive(lambda: frames[0]):
            assert sys.getswitchinterval() < 0.001 < before
            await asyncio.sleep(0)
            counts.append(gc.get_freeze_count())
            for now in (2, 3):
                frames[0] = now
                async with asyncio.timeout(20):
                    while gc.get_freeze_count() <= counts[-1]:
                        await asyncio.sleep(0.01)
                        made.append([])
                counts.append(gc.get_freeze_count())

    made: list[list[object]] = []
    asyncio.run(scenario())
    assert 0 == counts[0] < counts[1] < counts[2]
    assert sys.getswitchinterval() == before
    assert gc.get_freeze_count() == 0
