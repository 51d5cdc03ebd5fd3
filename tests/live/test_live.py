"""The live engine's scheduling: which work waits, which is dropped, and that the rest continues after a failure."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import threading
from collections.abc import Awaitable, Callable, Sequence
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from farside.engine.live import engine as live_engine
from farside.engine.live import timing
from farside.engine.live.back_buffer import BackBuffer, OrderError
from farside.engine.live.core import CoreLostError, Source
from farside.engine.live.engine import Live
from farside.engine.live.timing import Activity, Longest, Rate, StallMonitor, Timings
from farside.engine.live.update_priority import FIRM, GENTLE, Patience
from farside.engine.live.viewer import HeadPose, LiveViewer
from farside.engine.rig.camera import Camera, Pose
from farside.engine.rig.frame import Fault, Frame
from farside.engine.rig.viewer import EncodedPair, StereoView
from support.clocks import Clock
from support.doubles import CAMERAS, HANG_S, Cores, FakeCore, Gate, a_frame, a_view

SOURCE = Source("test", 30.0, CAMERAS)
VIEW = StereoView.symmetric(Pose(), 16, 16, 1.5)


def run(scenario: Callable[[], Awaitable[None]]) -> None:
    async def guarded() -> None:
        async with asyncio.timeout(HANG_S):
            await scenario()

    asyncio.run(guarded())


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.001)


class Screen:
    """Receives a viewer's pictures: records their tags and frames; sends can be made to wait."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int]] = []
        self.scenes: list[str] = []
        self.ready = asyncio.Event()
        self.ready.set()

    def deliver(self, wanted: HeadPose[int]) -> Callable[[EncodedPair], Awaitable[None]]:
        async def send(pair: EncodedPair) -> None:
            await self.ready.wait()
            self.seen.append((wanted.tag, pair.report.frame_index))

        return send

    async def announce(self, source: Source) -> None:
        self.scenes.append(source.name)

    def watch(self, viewer: LiveViewer[int]) -> asyncio.Task[None]:
        return asyncio.create_task(viewer.run("raw", self.deliver, self.announce))


def look(viewer: LiveViewer[int], tag: int, x: float = 0.0) -> None:
    viewer.look(HeadPose(Pose((x, 0.0, 0.0)), tag / 100, tag))


# The back buffer


def test_a_frame_is_complete_when_every_camera_was_seen_in_any_order() -> None:
    buffer = BackBuffer(["v0", "v1"])
    assert buffer.add(4, a_view(CAMERAS[1])) is None
    frame = buffer.add(4, a_view(CAMERAS[0]))
    assert frame is not None
    assert frame.index == 4
    assert [view.camera.name for view in frame.views] == ["v0", "v1"]
    assert buffer.add(5, a_view(CAMERAS[0])) is None


@pytest.mark.parametrize(
    ("then", "camera", "says"),
    [
        (4, 0, "camera: v0: expected one of v1 in frame 4"),
        (5, 1, "frame: 5: expected 4, which still lacks v1"),
        (3, 1, "frame: 3: expected 4, which still lacks v1"),
    ],
)
def test_views_out_of_order_are_refused_and_change_nothing(then: int, camera: int, says: str) -> None:
    buffer = BackBuffer(["v0", "v1"])
    buffer.add(4, a_view(CAMERAS[0]))
    with pytest.raises(OrderError, match=says):
        buffer.add(then, a_view(CAMERAS[camera]))
    assert buffer.add(4, a_view(CAMERAS[1])) is not None
    with pytest.raises(OrderError, match="frame: 4: expected more than 4"):
        buffer.add(4, a_view(CAMERAS[0]))


def test_a_camera_that_was_not_announced_is_refused() -> None:
    stranger = Camera("v9", CAMERAS[0].projection, Pose(), CAMERAS[0].depth)
    with pytest.raises(OrderError, match="camera: v9: expected one of v0, v1"):
        BackBuffer(["v0", "v1"]).add(0, a_view(stranger))


def test_a_frame_is_closed_without_the_views_that_are_missing_and_these_are_late_then() -> None:
    buffer, missing = BackBuffer(["v0", "v1"]), Fault("missing")
    assert buffer.missing == []
    buffer.add(4, a_view(CAMERAS[1]))
    assert buffer.missing == ["v0"]
    assert [buffer.is_next(frame) for frame in (3, 4, 5)] == [False, False, True]
    assert not buffer.is_late(4, "v0")
    frame = buffer.close(lambda name: dataclasses.replace(a_view(CAMERAS[int(name[1])]), fault=missing))
    assert (frame.index, frame.faults, frame.there) == (4, {"v0": missing}, [1])
    assert [view.camera.name for view in frame.views] == ["v0", "v1"]
    for _ in range(2):  # also while the next frame is incomplete
        late = [buffer.is_late(*view) for view in ((4, "v0"), (4, "v1"), (3, "v0"), (5, "v0"))]
        assert late == [True, False, False, False]
        if not buffer.missing:
            buffer.add(5, a_view(CAMERAS[1]))


# The back end


def test_the_newest_frame_overtakes_the_waiting_one() -> None:
    async def scenario() -> None:
        cores = Cores()
        async with Live(cores) as live:
            await live.open(SOURCE)
            (core,) = cores.made
            core.updating.close()
            first = live.offer(a_frame(0))
            await asyncio.to_thread(core.updating.entered.wait, HANG_S)
            waiting = [live.offer(a_frame(i)) for i in (1, 2, 3)]
            assert [bool(await settled) for settled in waiting[:2]] == [False, False]  # while 0 is still under way
            core.updating.open()
            assert await first
            assert await waiting[2]
            assert core.updates == [0, 3]
            assert live.frames == {"updated": 2, "dropped": 2, "failed": 0}

    run(scenario)


def without(frame: Frame, **faults: Fault) -> Frame:
    views = (dataclasses.replace(view, fault=faults.get(view.camera.name)) for view in frame.views)
    return dataclasses.replace(frame, views=tuple(views))


def test_views_that_are_left_out_are_counted_once_each_and_named_once(caplog: pytest.LogCaptureFixture) -> None:
    """Whoever finds the fault, and whether or not the frame is shown."""
    damaged, dark = Fault("texture", "12 bytes: expected a JPEG"), Fault("black", "no light")

    async def scenario() -> None:
        cores = Cores()
        async with Live(cores) as live:
            await live.open(SOURCE)
            (core,) = cores.made
            core.dark = {1: {"v1": dark}, 2: {"v1": dark}}
            settled = await live.offer(without(a_frame(0), v0=damaged))
            assert (settled.shown, settled.left_out) == (True, {"v0": damaged})
            settled = await live.offer(without(a_frame(1), v0=damaged))
            assert (settled.shown, settled.left_out) == (False, {"v0": damaged, "v1": dark})  # nothing is left
            settled = await live.offer(a_frame(2))
            assert (settled.shown, settled.left_out) == (True, {"v1": dark})
            core.updating.close()
            first = live.offer(a_frame(3))
            await asyncio.to_thread(core.updating.entered.wait, HANG_S)
            overtaken, last = live.offer(without(a_frame(4), v0=Fault("pose"))), live.offer(a_frame(5))
            core.updating.open()
            assert (await overtaken).left_out == {"v0": Fault("pose")}
            assert (await first).shown
            assert (await last).left_out == {}
            assert live.status()["left_out"] == {"v0": {"texture": 2, "pose": 1}, "v1": {"black": 2}}
            assert live.frames == {"updated": 4, "dropped": 2, "failed": 0}
            other = dataclasses.replace(SOURCE, cameras=CAMERAS[:1])
            await live.open(other)
            assert live.status()["left_out"] == {}  # the other rig's
            await live.open(SOURCE)
            await live.offer(without(a_frame(0), v0=damaged, v1=damaged))

    run(scenario)
    said = [record.getMessage() for record in caplog.records if "left out" in record.getMessage()]
    assert said == [
        "camera v0: left out of frame 0: texture: 12 bytes: expected a JPEG (from now on only counted)",
        "camera v1: left out of frame 1: black: no light (from now on only counted)",
        "camera v0: left out of frame 4: pose (from now on only counted)",
        "cameras v0, v1: left out of frame 0: texture: 12 bytes: expected a JPEG (from now on only counted)",
    ]


def test_viewers_wait_for_the_first_frame_that_shows_something(caplog: pytest.LogCaptureFixture) -> None:
    nothing = {"v0": Fault("no depth"), "v1": Fault("no depth")}

    async def scenario() -> None:
        cores = Cores()
        async with Live(cores) as live:
            await live.open(SOURCE)
            cores.made[0].dark = {0: nothing, 1: nothing, 3: nothing}
            for index in range(4):
                settled = await live.offer(a_frame(index))
                assert settled.shown == (index == 2)
                assert (live.shown is None) == (index < 2)

    run(scenario)
    said = [record.getMessage() for record in caplog.records if "waits" in record.getMessage()]
    assert said == ["frame 0: shows nothing; the model waits for the first frame with depth"]


def test_a_frame_that_the_core_refuses_is_reported_and_the_next_one_is_taken() -> None:
    async def scenario() -> None:
        cores = Cores()
        async with Live(cores) as live:
            await live.open(SOURCE)
            (core,) = cores.made
            core.bad_frames = {1}
            assert await live.offer(a_frame(0))
            with pytest.raises(ValueError, match="frame: 1: expected a better one"):
                await live.offer(a_frame(1))
            assert await live.offer(a_frame(2))
            assert core.updates == [0, 2]
            assert live.frames["failed"] == 1

    run(scenario)


def test_the_same_cameras_keep_the_model_others_begin_anew() -> None:
    async def scenario() -> None:
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(7))
            core = live.shown
            assert core is not None
            await live.open(Source("again", 25.0, CAMERAS))
            assert live.shown is core
            await live.open(Source("other", 25.0, CAMERAS[:1]))
            assert live.shown is None  # nothing to show before its first frame
            with pytest.raises(ValueError, match="mesh: there is none before the first frame"):
                await live.model.mesh("ply")
            await live.offer(a_frame(0, CAMERAS[:1]))
            assert live.shown is not core

    run(scenario)


def test_a_core_is_asked_whether_it_goes_on_with_cameras_elsewhere() -> None:
    answers: list[bool | Exception] = [True, ValueError("camera v0: elsewhere: expected it to stand")]
    answers.append(CoreLostError("the engine's process ended by SIGKILL"))
    moved = [(dataclasses.replace(CAMERAS[0], pose=Pose((k, 0.0, 0.0))), CAMERAS[1]) for k in (1.0, 2.0, 3.0)]

    class Keeping(FakeCore):
        def continues(self, cameras: Sequence[Camera]) -> bool:
            answer = answers.pop(0)
            if isinstance(answer, Exception):
                raise answer
            return answer

    async def scenario() -> None:
        cores = Cores(Keeping)
        async with Live(cores) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            await live.open(Source("moved", 25.0, moved[0]))
            assert live.shown is cores.made[0]
            with pytest.raises(ValueError, match="camera v0: elsewhere"):
                await live.open(Source("refused", 25.0, moved[1]))
            assert live.source is not None
            assert live.source.name == "moved"
            await live.open(Source("after", 25.0, moved[2]))
            assert len(cores.made) == 2  # the first one is lost

    run(scenario)


def test_cameras_that_no_core_takes_leave_the_old_one_at_work() -> None:
    def make(source: Source) -> FakeCore:
        if source.name == "bad":
            raise ValueError("cameras: too odd: expected others")
        return FakeCore(source)

    async def scenario() -> None:
        async with Live(make) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            core = live.shown
            with pytest.raises(ValueError, match="too odd"):
                await live.open(Source("bad", 25.0, CAMERAS[:1]))
            assert live.source is SOURCE
            assert await live.offer(a_frame(1))
            assert live.shown is core

    run(scenario)


def test_a_core_whose_process_has_ended_is_told_of_and_the_next_source_gets_another() -> None:
    def lose(*asked: object) -> None:
        raise CoreLostError("the engine's process ended by SIGKILL")

    async def scenario() -> None:
        async with Live(FakeCore) as live:
            for ask in ("update", "picture"):
                await live.open(SOURCE)
                await live.offer(a_frame(0))
                core = live.shown
                setattr(core, ask, lose)
                with live.viewer("a", VIEW) as viewer:
                    look(viewer, 1)
                    asked = live.offer(a_frame(1)) if ask == "update" else Screen().watch(viewer)
                    with pytest.raises(CoreLostError, match="by SIGKILL"):
                        await asked
                assert live.status()["engine"] == {"lost": "the engine's process ended by SIGKILL"}
                with pytest.raises(RuntimeError, match="no source was opened"):
                    live.offer(a_frame(2))
                await live.open(SOURCE)
                assert live.status()["engine"] == {}
                assert await live.offer(a_frame(0))
                assert live.shown is not core
                await live.open(Source("other", 25.0, CAMERAS[:1]))

    run(scenario)


def test_frames_that_wait_are_told_of_when_the_core_is_lost() -> None:
    """They may be another source's, which has come before anybody knew."""

    def lose(core: FakeCore) -> None:
        core.updating.pass_through()
        raise CoreLostError("the engine's process ended by SIGKILL")

    async def scenario() -> None:
        cores = Cores()
        async with Live(cores) as live:
            await live.open(SOURCE)
            (core,) = cores.made
            core.updating.close()
            core.update = lambda *asked: lose(core)
            frames = [live.offer(a_frame(0))]
            await asyncio.to_thread(core.updating.entered.wait, HANG_S)
            await live.open(Source("again", 25.0, CAMERAS))
            frames.append(live.offer(a_frame(0)))
            core.updating.open()
            for settled in frames:
                with pytest.raises(CoreLostError, match="by SIGKILL"):
                    await settled
            assert live.frames == {"updated": 0, "dropped": 0, "failed": 2}

    run(scenario)


def test_a_picture_that_ends_with_a_lost_core_says_nothing_of_the_next_one() -> None:
    def lose(*asked: object) -> None:
        raise CoreLostError("the engine's process ended by SIGKILL")

    async def scenario() -> None:
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            core = live.shown
            assert isinstance(core, FakeCore)
            core.rendering.close()
            core.update = lose
            core.picture = lambda *asked: lose(core.rendering.pass_through())
            with live.viewer("a", VIEW) as viewer:
                look(viewer, 1)
                watching = Screen().watch(viewer)
                await asyncio.to_thread(core.rendering.entered.wait, HANG_S)
                with pytest.raises(CoreLostError):
                    await live.offer(a_frame(1))
                await live.open(SOURCE)
                core.rendering.open()
                with pytest.raises(CoreLostError):
                    await watching
            assert live.status()["engine"] == {}
            assert live.source is SOURCE
            assert await live.offer(a_frame(0))

    run(scenario)


def test_one_source_is_opened_after_the_other() -> None:
    making = Gate()
    made: list[str] = []

    def make(source: Source) -> FakeCore:
        made.append(source.name)
        making.pass_through()
        return FakeCore(source)

    async def scenario() -> None:
        other = Source("other", 25.0, CAMERAS[:1])
        async with Live(make) as live:
            await live.open(SOURCE)
            making.close()
            opening = [asyncio.create_task(live.open(source)) for source in (other, SOURCE, SOURCE)]
            await asyncio.to_thread(making.entered.wait, HANG_S)
            assert made == ["test", "other"]
            assert await live.offer(a_frame(0))  # by the core that is there
            making.open()
            await asyncio.gather(*opening)
            assert made == ["test", "other", "test"]
            assert live.source is SOURCE
            assert await live.offer(a_frame(1))

    run(scenario)


def test_an_export_gives_way() -> None:
    niceness: list[int] = []

    class Nice(FakeCore):
        def mesh(self, *given: Any) -> bytes:
            niceness.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
            return super().mesh(*given)

    async def scenario() -> None:
        async with Live(Nice) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            assert (await live.model.mesh("ply")).startswith(b"ply")

    run(scenario)
    assert niceness == [min(os.getpriority(os.PRIO_PROCESS, os.getpid()) + GENTLE, 19)]


def test_the_back_end_gives_way_until_it_takes_too_long_and_cores_are_closed_in_the_end() -> None:
    niceness: list[int] = []
    patience = Patience()

    class Nice(FakeCore):
        def update(self, *given: Any) -> Any:
            niceness.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
            return super().update(*given)

        def picture(self, *given: Any) -> Any:
            niceness.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
            return super().picture(*given)

    async def scenario() -> None:
        screen = Screen()
        cores = Cores(Nice)
        async with Live(cores, patience=patience) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            patience.longest_s = 0.0
            await live.offer(a_frame(1))
            await live.offer(a_frame(2))
            assert live.status()["update_niceness"] == FIRM
            with live.viewer("a", VIEW) as viewer:
                watching = screen.watch(viewer)
                look(viewer, 1)
                await until(lambda: bool(screen.seen))
                watching.cancel()
            await live.open(Source("other", 25.0, CAMERAS[:1]))
        assert len(cores.made) == 2
        assert cores.made[1].closed

    run(scenario)
    usual = os.getpriority(os.PRIO_PROCESS, os.getpid())
    behind, nearer = min(usual + GENTLE, 19), min(usual + FIRM, 19)
    assert niceness == [behind, behind, nearer, usual]


@pytest.mark.parametrize(
    ("interval", "updates"),
    [
        (1.0, [(0.9, GENTLE), (0.9, GENTLE)]),  # the video keeps up
        (1.0, [(1.1, FIRM), (0.9, FIRM), (0.11, FIRM), (0.09, GENTLE), (0.9, GENTLE)]),  # it does when updates compete
        (0.1, [(1.1, FIRM), (0.4, GENTLE), *[(1.1, GENTLE)] * 15, (1.1, FIRM), (0.4, GENTLE), *[(1.1, GENTLE)] * 31]),
        (0.1, [(5.1, FIRM), (5.1, FIRM), (0.51, FIRM), (0.49, GENTLE)]),  # pictures leave nothing
        (0.1, [(1.1, FIRM), (0.4, GENTLE), (5.1, FIRM)]),
        (20.0, [(4.9, GENTLE), (5.1, FIRM)]),
    ],
)
def test_pictures_go_first_unless_updates_come_too_late_for_the_video(
    interval: float, updates: list[tuple[float, int]]
) -> None:
    patience = Patience(5.0)
    for seconds, then in updates:
        patience.observe(seconds, interval)
        assert patience.niceness == then


# Viewers


def test_poses_wait_for_the_first_frame_and_the_newest_wins() -> None:
    async def scenario() -> None:
        screen = Screen()
        async with Live(FakeCore) as live:
            with live.viewer("a", VIEW) as viewer:
                watching = screen.watch(viewer)
                for tag in (1, 2, 3):
                    look(viewer, tag)
                await live.open(SOURCE)
                await live.offer(a_frame(5))
                await until(lambda: bool(screen.seen))
                assert screen.seen == [(3, 5)]
                assert screen.scenes == ["test"]
                assert viewer.dropped == 2
                watching.cancel()

    run(scenario)


def test_stale_poses_are_dropped_while_a_picture_is_rendered() -> None:
    async def scenario() -> None:
        screen = Screen()
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            core = live.shown
            assert isinstance(core, FakeCore)
            core.rendering.close()
            with live.viewer("a", VIEW) as viewer:
                watching = screen.watch(viewer)
                look(viewer, 1)
                await asyncio.to_thread(core.rendering.entered.wait, HANG_S)
                for tag in (2, 3, 4):
                    look(viewer, tag, x=tag)
                core.rendering.open()
                await until(lambda: len(screen.seen) == 2)
                assert [tag for tag, _ in screen.seen] == [1, 4]
                assert core.rendered[-1].pose.position == (4.0, 0.0, 0.0)
                assert (viewer.dropped, viewer.rendered) == (2, 2)
                watching.cancel()

    run(scenario)


def test_a_slow_client_delays_no_other() -> None:
    async def scenario() -> None:
        slow, fast = Screen(), Screen()
        slow.ready.clear()
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            with live.viewer("slow", VIEW) as one, live.viewer("fast", VIEW) as other:
                tasks = [slow.watch(one), fast.watch(other)]
                for tag in range(1, 20):
                    look(one, tag)
                    look(other, tag)
                    await until(lambda tag=tag: fast.seen[-1:] == [(tag, 0)])
                assert len(fast.seen) == 19
                assert slow.seen == []
                slow.ready.set()
                await until(lambda: slow.seen[-1:] == [(19, 0)])
                assert [tag for tag, _ in slow.seen] == [1, 19]  # what was under way, then the newest
                for task in tasks:
                    task.cancel()

    run(scenario)


def test_a_viewer_that_tells_what_it_has_seen_has_few_pictures_under_way() -> None:
    async def scenario() -> None:
        screen = Screen()
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            with live.viewer("a", VIEW) as viewer:
                watching = screen.watch(viewer)

                async def show(tag: int, seen: int, pictures: int) -> None:
                    viewer.look(HeadPose(Pose(), tag / 100, tag, None, seen))
                    await until(lambda: not viewer.wake.is_set() and len(screen.seen) >= pictures)

                await show(1, 0, 1)
                await show(2, 0, 2)
                await show(3, 0, 2)  # two are under way: a picture of this pose would come before the next one's
                await show(4, 1, 3)  # one has arrived: the newest pose is next
                assert [tag for tag, _ in screen.seen] == [1, 2, 4]
                assert viewer.dropped == 1
                watching.cancel()

    run(scenario)


def test_rendering_goes_on_while_the_back_end_works() -> None:
    """f_ren does not wait for f_vin: with an update held up, pictures of the previous frame come."""

    async def scenario() -> None:
        screen = Screen()
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            core = live.shown
            assert isinstance(core, FakeCore)
            core.updating.close()
            with live.viewer("a", VIEW) as viewer:
                watching = screen.watch(viewer)
                update = live.offer(a_frame(1))
                for tag in range(1, 6):
                    look(viewer, tag)
                    await until(lambda tag=tag: screen.seen[-1:] == [(tag, 0)])
                assert not update.done()
                core.updating.open()
                assert await update
                look(viewer, 6)
                await until(lambda: screen.seen[-1] == (6, 1))
                watching.cancel()

    run(scenario)


def test_a_broken_picture_ends_its_viewer_only() -> None:
    async def scenario() -> None:
        screen = Screen()
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            await live.offer(a_frame(0))
            core = live.shown
            assert isinstance(core, FakeCore)
            with live.viewer("a", VIEW) as viewer, live.viewer("b", VIEW) as other:
                core.fail_render = True
                look(viewer, 1)
                with pytest.raises(RuntimeError, match="the renderer broke"):
                    await screen.watch(viewer)
                core.fail_render = False
                watching = screen.watch(other)
                look(other, 2)
                await until(lambda: screen.seen == [(2, 0)])
                watching.cancel()

    run(scenario)


def test_an_update_knows_every_viewers_pose_and_speed() -> None:
    async def scenario() -> None:
        async with Live(FakeCore) as live:
            await live.open(SOURCE)
            with live.viewer("a", VIEW) as viewer, live.viewer("b", VIEW) as other:
                for tick in range(200):  # 2 m/s at 100 Hz
                    look(viewer, tick, x=tick / 50)
                other.look(HeadPose(Pose(), 0.0, 0, (0.0, 3.0, 4.0)))
                await live.offer(a_frame(0))
                core = live.shown
                assert isinstance(core, FakeCore)
                assert core.look()["a"].pose.position == (199 / 50, 0.0, 0.0)
                assert core.speeds == {"a": pytest.approx(2.0, rel=1e-3), "b": 5.0}
            await live.offer(a_frame(1))
            assert core.look() == {}

    run(scenario)


@pytest.mark.parametrize("times", [(1.0, 1.0), (1.0, 0.5)])
def test_a_clock_that_stands_or_goes_back_does_not_disturb_the_speed(times: tuple[float, float]) -> None:
    async def scenario() -> None:
        viewer: LiveViewer[int] = LiveViewer(Live(FakeCore), "a", VIEW)
        for moment, x in zip(times, (0.0, 100.0), strict=True):
            viewer.look(HeadPose(Pose((x, 0.0, 0.0)), moment, 0))
        assert viewer.speed == 0.0

    run(scenario)


# Shutdown and figures


def test_shutdown_waits_for_the_update_and_leaves_no_thread_and_no_future_behind() -> None:
    async def scenario() -> None:
        cores = Cores()
        async with Live(cores) as live:
            await live.open(SOURCE)
            (core,) = cores.made
            core.updating.close()
            under_way = live.offer(a_frame(0))
            await asyncio.to_thread(core.updating.entered.wait, HANG_S)
            waiting = live.offer(a_frame(1))
            asyncio.get_running_loop().call_later(0.05, core.updating.open)
        assert core.updates == [0]
        assert under_way.done()
        assert waiting.result().shown is False
        assert asyncio.all_tasks() == {asyncio.current_task()}

    run(scenario)


def test_a_blocked_loop_is_noticed_and_charged_to_the_update_that_ran(monkeypatch: pytest.MonkeyPatch) -> None:
    """By clocks of its own: each sleep of the monitor is as late, with so much waiting and work, as the table says."""
    wall, busy, updates, waited_s = Clock(), Clock(), Activity(), 0.0
    sleeps = iter([  # late by, of which its thread waited for a core; its thread's own work; seconds
        (0.0, 0.0, 0.001, False), (0.06, 0.0, 0.02, True), (0.2, 0.05, 0.03, False), (0.1, 0.2, 0.0, False),
    ])  # fmt: skip

    async def sleep(seconds: float) -> None:
        nonlocal waited_s
        late, waiting, work, updating = next(sleeps, (0.0, 0.0, 0.0, None))
        if updating is None:
            raise asyncio.CancelledError
        with updates.running() if updating else nullcontext():
            wall.advance(late)
        wall.advance(seconds)
        busy.advance(work)
        waited_s += waiting

    linux = SimpleNamespace(
        open=lambda path, _flags: len(path), close=lambda _file: None, O_RDONLY=os.O_RDONLY,
        pread=lambda _file, _count, _offset: f"77 {round(1e9 * waited_s)} 5\n".encode(),
    )  # fmt: skip
    monkeypatch.setattr(timing, "time", SimpleNamespace(monotonic=wall.read, thread_time=busy.read))
    monkeypatch.setattr(timing, "asyncio", SimpleNamespace(sleep=sleep))
    monkeypatch.setattr(timing, "os", linux)
    monitor = StallMonitor(updates, 0.005)
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(monitor.run())
    expected = {
        "longest_stall_ms": 200.0, "longest_stall_during_update_ms": 60.0,
        "longest_own_stall_ms": 150.0, "longest_own_stall_during_update_ms": 60.0,
        "longest_busy_ms": 30.0, "longest_busy_during_update_ms": 20.0, "loop_busy_s": 0.051,
    }  # fmt: skip
    assert monitor.summary() == {name: pytest.approx(value) for name, value in expected.items()}


def test_what_linux_counts_can_be_read() -> None:
    async def scenario() -> None:
        monitor = StallMonitor(Activity(), 0.0)
        task = asyncio.create_task(monitor.run())
        while monitor.summary()["loop_busy_s"] == 0.0 and not task.done():
            await asyncio.sleep(0)
        assert not task.done()
        task.cancel()

    run(scenario)


def test_where_the_system_does_not_count_waiting_it_is_none_and_the_rest_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(path: str, flags: int) -> int:
        raise FileNotFoundError(path)

    async def scenario() -> None:
        monitor = StallMonitor(Activity(), 0.0)
        task = asyncio.create_task(monitor.run())
        while not (monitor.summary()["longest_stall_ms"] or task.done()):
            await asyncio.sleep(0)
        assert not task.done()
        task.cancel()
        figures = monitor.summary()
        assert [name for name, value in figures.items() if value is None] == [
            "longest_own_stall_ms", "longest_own_stall_during_update_ms",
        ]  # fmt: skip

    monkeypatch.setattr(timing, "os", SimpleNamespace(open=refuse, O_RDONLY=os.O_RDONLY))
    run(scenario)


def test_the_longest_is_that_of_the_seconds_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(timing, "time", SimpleNamespace(monotonic=lambda: now))
    longest = Longest(keep_s=3)
    assert longest.over() == 0
    for now, milliseconds in ((100.0, 50.0), (101.5, 3.0), (101.9, 2.0), (103.0, 7.0)):  # noqa: B007 (it is the clock)
        longest.add(milliseconds)
    assert [longest.over(seconds) for seconds in (0, 1, 2, 3)] == [7, 7, 7, 50]
    now = 103.9
    assert [longest.over(seconds) for seconds in (0, 0.5, 1.5, 2.5)] == [7, 7, 7, 7]
    now = 104.4
    assert [longest.over(seconds) for seconds in (0.3, 0.5, 1.5, 3.5)] == [0, 7, 7, 50]
    now = 104.0
    longest.add(1.0)
    assert longest.over() == 7  # three seconds are kept


def test_something_runs_until_its_last_part_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, activity = Clock().instead_of(monkeypatch, timing), Activity()
    assert not activity.since(clock.now)
    with activity.running():
        with activity.running():
            clock.advance(1.0)
        clock.advance(1.0)
        assert activity.since(clock.now + 1)
    ended = clock.now
    clock.advance(1.0)
    assert activity.since(ended)
    assert not activity.since(ended + 0.01)


def test_status_tells_rates_stages_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that frames move on by a quarter of a second, and pictures by the eighth that they take."""
    clock = Clock().instead_of(monkeypatch, timing, live_engine)

    class Clocked(FakeCore):
        def picture(self, *given: Any) -> EncodedPair:
            clock.advance(0.125)
            return super().picture(*given)

    async def scenario() -> None:
        screen = Screen()
        async with Live(Clocked) as live:
            assert live.status()["source"] is None
            await live.open(SOURCE)
            for i in range(3):
                clock.advance(0.25)
                await live.offer(a_frame(i))
            with live.viewer("a", VIEW) as viewer:
                watching = screen.watch(viewer)
                for tag in range(3):
                    look(viewer, tag)
                    await until(lambda tag=tag: len(screen.seen) == tag + 1)
                status = live.status()
                watching.cancel()
            assert status["source"] == {"name": "test", "fps": 30.0, "cameras": ["v0", "v1"]}
            assert status["frames"] == {"updated": 3, "dropped": 0, "failed": 0}
            assert status["viewers"]["a"]["rendered"] == 3
            assert status["rates"] == {"f_vin": pytest.approx(4.0), "f_ren": pytest.approx(8.0)}
            assert {"update.background", "update.total", "render.warp", "render.encode"} <= set(
                status["stages_ms"]
            )
            assert status["engine"] == {"frame_index": 2}
            assert status["stages_ms"]["update.total"] == {"p50": 2.0, "p95": 2.0}  # as the core says
            assert status["stages_ms"]["picture"]["p50"] == pytest.approx(125.0)
            assert status["pictures"]["longest_picture_ms"] == pytest.approx(125.0)

    run(scenario)


def test_timings_are_percentiles_of_the_newest() -> None:
    timings = Timings(keep=100)
    for value in [1e9, *range(1, 101)]:
        timings.add({"warp": value}, "render.")
    assert timings.summary() == {
        "render.warp": {"p50": pytest.approx(50.5), "p95": pytest.approx(np.percentile(range(1, 101), 95))}
    }


def test_rate_forgets(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, rate = Clock().instead_of(monkeypatch, timing), Rate(window_s=5.0)
    assert rate.per_second() == 0
    for seconds in (0.0, 0.5, 1.5):
        clock.advance(seconds)
        rate.count()
    assert rate.per_second() == pytest.approx(2 / 2.0)
    clock.advance(3.25)  # the first was longer ago than five seconds
    assert rate.per_second() == pytest.approx(1 / 1.5)
    clock.advance(1.0)
    assert rate.per_second() == 0  # a single one tells no rate
