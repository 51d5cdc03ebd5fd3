"""A replay delivers the pixels of the files, frame by frame, through shared memory and without it."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest
from farside.clients import replay as module
from farside.clients.replay import Playback, Replay
from farside.engine.io.tmiv import Sequence, open_sequence
from farside.engine.rig.frame import Frame
from farside.engine.synth import write_twin
from support.doubles import FakeCore
from support.serving import running

HANG_S = 60.0


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("twin") / "hijack"
    write_twin("hijack", folder, 0.02, 3)
    return open_sequence(folder)


@pytest.fixture
def frames(monkeypatch: pytest.MonkeyPatch) -> list[list[np.ndarray]]:
    """Copies of the planes of every frame that a core gets."""
    seen: list[list[np.ndarray]] = []
    original = FakeCore.update

    def update(self: FakeCore, frame: Frame, *others: Any) -> Any:
        views = frame.views
        seen.append([np.copy(p) for v in views for p in (v.texture.y, v.texture.cb, v.texture.cr, v.codes)])
        return original(self, frame, *others)

    monkeypatch.setattr(FakeCore, "update", update)
    return seen


def play(sequence: Sequence, **how: Any) -> Replay:
    replay = Replay(Playback(sequence, sequence.source_names[:3], 100.0, frames=9, loop=True, every_frame=True, **how))

    async def scenario(url: str) -> None:
        async with asyncio.timeout(HANG_S):
            await replay.run(url)

    with running(FakeCore) as url:
        asyncio.run(scenario(url))
    return replay


@pytest.mark.parametrize("way", ["shared", "sent", "cannot be opened"])
def test_the_core_gets_what_is_in_the_files(
    sequence: Sequence, frames: list[list[np.ndarray]], monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    """Nine frames of a recording of three, to and fro: more frames than buffers, so that buffers are used again."""
    if way == "cannot be opened":  # a server in another container, behind the same address

        def fail(*given: object) -> None:
            raise FileNotFoundError("no such process")

        monkeypatch.setattr(module, "open_buffer", fail)
    replay = play(sequence, **({"depth": "zlib"} if way == "sent" else {}))
    assert replay.shared is (way == "shared")
    assert replay.outcomes == {"updated": 9}
    for number, planes in enumerate(frames):
        index = (0, 1, 2, 2, 1, 0)[number % 6]
        views = [sequence.view(name, index) for name in sequence.source_names[:3]]
        expected = [p for v in views for p in (v.texture.y, v.texture.cb, v.texture.cr, v.codes)]
        for got, want in zip(planes, expected, strict=True):
            np.testing.assert_array_equal(got, want)
    assert len(frames) == 9
