"""Video and poses whose rates are a hundred times apart: nothing is queued, and what is shown is the newest."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from farside.engine.live.core import Source
from farside.engine.live.engine import Live
from farside.engine.live.viewer import HeadPose, LiveViewer
from farside.engine.rig.camera import Pose
from farside.engine.rig.viewer import EncodedPair, StereoView
from support.doubles import CAMERAS, HANG_S, Cores, FakeCore, a_frame

SOURCE = Source("test", 30.0, CAMERAS)
VIEW = StereoView.symmetric(Pose(), 16, 16, 1.5)
TIMES = 100


class Screen:
    """Records the pairs that a viewer was sent, by the number of their pose and the frame."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int]] = []

    def watch(self, viewer: LiveViewer[int]) -> asyncio.Task[None]:
        def deliver(wanted: HeadPose[int]) -> Callable[[EncodedPair], Awaitable[None]]:
            async def send(pair: EncodedPair) -> None:
                self.seen.append((wanted.tag, pair.report.frame_index))

            return send

        async def announce(_source: Source) -> None:
            pass

        return asyncio.create_task(viewer.run("raw", deliver, announce))


def run(scenario: Callable[[Live, FakeCore, LiveViewer[int], Screen], Awaitable[None]]) -> None:
    async def whole() -> None:
        cores, screen = Cores(), Screen()
        async with asyncio.timeout(HANG_S), Live(cores) as live:
            await live.open(SOURCE)
            (core,) = cores.made
            with live.viewer("a", VIEW) as viewer:
                watching = screen.watch(viewer)
                await scenario(live, core, viewer, screen)
                watching.cancel()

    asyncio.run(whole())


def look(viewer: LiveViewer[int], tag: int) -> None:
    viewer.look(HeadPose(Pose((0.01 * tag, 0.0, 0.0)), tag / 1000, tag))


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.001)


def test_a_hundred_frames_a_picture() -> None:
    """While one picture is rendered a hundred frames come; the next picture shows the last of them."""

    async def scenario(live: Live, core: FakeCore, viewer: LiveViewer[int], screen: Screen) -> None:
        await live.offer(a_frame(0))
        core.rendering.close()
        look(viewer, 1)
        await asyncio.to_thread(core.rendering.entered.wait, HANG_S)
        for index in range(1, TIMES + 1):
            assert await live.offer(a_frame(index))
        core.rendering.open()
        await until(lambda: len(screen.seen) == 1)
        look(viewer, 2)
        await until(lambda: len(screen.seen) == 2)
        assert screen.seen[1] == (2, TIMES)
        assert core.updates == list(range(TIMES + 1))
        assert live.frames == {"updated": TIMES + 1, "dropped": 0, "failed": 0}
        assert (viewer.rendered, viewer.dropped) == (2, 0)

    run(scenario)


def test_a_hundred_frames_an_update() -> None:
    """While one update is under way a hundred frames come: the last is taken, the others are counted as dropped."""

    async def scenario(live: Live, core: FakeCore, viewer: LiveViewer[int], screen: Screen) -> None:
        core.updating.close()
        first = live.offer(a_frame(0))
        await asyncio.to_thread(core.updating.entered.wait, HANG_S)
        rest = [live.offer(a_frame(index)) for index in range(1, TIMES + 1)]
        core.updating.open()
        assert await first
        assert [bool(await settled) for settled in rest] == [False] * (TIMES - 1) + [True]
        assert core.updates == [0, TIMES]
        assert live.frames == {"updated": 2, "dropped": TIMES - 1, "failed": 0}
        look(viewer, 1)
        await until(lambda: bool(screen.seen))
        assert screen.seen == [(1, TIMES)]

    run(scenario)


@pytest.mark.parametrize("updating", [False, True])
def test_a_hundred_poses_a_frame(updating: bool) -> None:
    """Every pose that the viewer waits for is rendered from the one frame, whether another is under way or not; of a
    hundred that come while one picture is rendered, the last is."""

    async def scenario(live: Live, core: FakeCore, viewer: LiveViewer[int], screen: Screen) -> None:
        await live.offer(a_frame(7))
        if updating:
            core.updating.close()
            pending = live.offer(a_frame(8))
            await asyncio.to_thread(core.updating.entered.wait, HANG_S)
        for tag in range(TIMES):
            look(viewer, tag)
            await until(lambda tag=tag: len(screen.seen) == tag + 1)  # type: ignore[misc]
        assert screen.seen == [(tag, 7) for tag in range(TIMES)]
        core.rendering.close()
        look(viewer, 100)
        await asyncio.to_thread(core.rendering.entered.wait, HANG_S)
        for tag in range(101, 101 + TIMES):
            look(viewer, tag)
        core.rendering.open()
        await until(lambda: len(screen.seen) == TIMES + 2)
        assert screen.seen[-2:] == [(100, 7), (200, 7)]
        assert viewer.dropped == TIMES - 1
        if updating:
            core.updating.open()
            assert await pending

    run(scenario)
