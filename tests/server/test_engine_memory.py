"""What viewers of many sizes leave behind in the engine is bounded."""

from __future__ import annotations

import asyncio
import json
import urllib.request
from typing import Any

from farside.clients.connection import connect
from farside.engine.live.core import LocalCore, Source
from farside.engine.live.core_process import ProcessCore
from farside.engine.pipeline.engine import Engine
from farside.engine.rendering.cpu_renderer import CpuRenderer
from farside.engine.rig.viewer import home_pose
from farside.engine.settings import Settings
from farside.server.pictures import encode_view
from farside.server.protocol import BufferFree, FrameDone, PoseUpdate, Scene, SourceHello, Stereo, ViewerHello
from support.doubles import CAMERAS, a_view
from support.serving import running

LIMIT = 16 << 20  # bytes
SIZES = [(96 + 64 * k, 480 - 16 * k) for k in range(12)]


def make(cameras: Any) -> LocalCore:
    """In the engine's process: an engine whose canvases are to stay small."""
    return LocalCore(Engine(cameras, Settings.preset("fast"), renderer=CpuRenderer(LIMIT)))


def make_core(source: Source) -> ProcessCore:
    return ProcessCore(make, source.cameras)


def memory(url: str) -> dict[str, int]:
    with urllib.request.urlopen(f"{url}/status", timeout=60) as answer:
        found: dict[str, int] = json.load(answer)["engine"]["memory_bytes"]
        return found


async def send_frame(source: Any, frame: int) -> None:
    for camera in CAMERAS:
        await source.send(encode_view(a_view(camera), frame))
    while not isinstance(await source.receive(FrameDone, BufferFree), FrameDone):
        pass


async def watch(url: str, size: tuple[int, int]) -> None:
    """A viewer that comes, sees a pair and leaves."""
    pose = home_pose(CAMERAS)
    async with connect(url, ViewerHello.symmetric(*size, 1.5)) as (viewer, _):
        await viewer.send(PoseUpdate(0, 0.0, pose.position, pose.orientation))
        while not isinstance(message := await viewer.receive(Stereo, Scene), Stereo):
            pass
        assert (message.width, message.height) == size


def test_warpinges_of_viewers_that_have_left_are_bounded_by_bytes(monkeypatch: Any) -> None:
    import os
    import sys

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    seen: list[int] = []

    async def scenario(url: str) -> None:
        async with connect(url, SourceHello("walls", 30.0, CAMERAS)) as (source, _):
            await send_frame(source, 0)
            for number, size in enumerate(SIZES):
                await watch(url, size)
                await send_frame(source, number + 1)  # its end brings the figures
                seen.append((await asyncio.to_thread(memory, url))["canvases"])

    with running(make_core) as url:
        asyncio.run(scenario(url))
    assert 0 < seen[0] < seen[1]
    assert max(seen) > LIMIT // 2
    assert max(seen) <= LIMIT
