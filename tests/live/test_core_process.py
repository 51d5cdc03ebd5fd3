"""A core in a process of its own: what is asked of it arrives there, what it says arrives here, and when it ends."""

from __future__ import annotations

import dataclasses
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from farside.engine.live.core_process import Apart, CoreLostError
from farside.engine.live.engine import Source
from farside.engine.live.frame_memory import FrameBuffers
from farside.engine.live.newest import Newest
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame, View
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from farside.engine.support.runtime import give_way
from support.doubles import CAMERAS, HANG_S, FakeCore, a_frame

SOURCE = Source("test", 30.0, CAMERAS)
VIEW = StereoView.symmetric(Pose(), 16, 16, 1.5)


class OddError(Exception):
    """One that cannot be made again from what it says."""

    def __init__(self, one: int, two: int) -> None:
        super().__init__(f"{one} and {two}")


class Watcher(FakeCore):
    """Keeps the newest frame, and asks twice where viewers look."""

    frame: Frame | None = None
    seen: tuple[float, ...] = ()

    def update(self, frame: Frame, viewers: Mapping[str, StereoView], speeds: Mapping[str, float]) -> Any:
        views = *viewers.values(), *dict(viewers.items()).values()
        self.seen = tuple(view.pose.position[0] for view in views)
        self.frame = frame
        return super().update(frame, dict(viewers), speeds)


def lumas(core: Watcher) -> set[int]:
    assert core.frame is not None
    return {int(code) for view in core.frame.views for code in view.texture.y.flat}


def seen(core: Watcher) -> tuple[float, ...]:
    return core.seen


def known(core: FakeCore) -> tuple[Any, ...]:
    return core.updates, core.speeds, core.f_vin, core.settings


def odd(core: FakeCore) -> None:
    raise OddError(1, 2)


def unsendable(core: FakeCore) -> Any:
    return lambda: None


def refuse() -> FakeCore:
    raise ValueError("cameras: too odd: expected others")


def die(core: FakeCore, by: int) -> None:
    os.kill(os.getpid(), by)
    time.sleep(HANG_S)


def hold(core: FakeCore) -> None:
    core.updating.close()


def wait_until_held(core: FakeCore) -> bool:
    return core.updating.entered.wait(HANG_S)


def let_go(core: FakeCore) -> None:
    core.updating.open()


def yield_cores(core: FakeCore) -> None:
    give_way(7)


def niceness(core: FakeCore) -> tuple[int, int]:
    """Of the thread, and of its process."""
    return os.getpriority(os.PRIO_PROCESS, threading.get_native_id()), os.getpriority(os.PRIO_PROCESS, os.getpid())


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))


@pytest.fixture
def core() -> Iterator[Apart]:
    apart = Apart(Watcher, SOURCE)
    yield apart
    apart.close()


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def test_it_is_used_as_the_core_is(core: Apart) -> None:
    core.f_vin = 12.0
    report = core.update(a_frame(7), {"a": VIEW}, {"a": 0.5})
    assert report.stages == {"background": 1.0}
    assert core.render(VIEW, "a").frame_index == 7
    assert core.status() == {"frame_index": 7, "pid": core.pid}
    assert core.pid != os.getpid()
    np.testing.assert_array_equal(core.mesh().triangles, [[0, 1, 2]])
    assert core.run(known) == ([7], {"a": 0.5}, 12.0, None)
    settings = Settings.preset("fast")
    core.retune(settings)
    until(lambda: core.run(known)[3] == settings)


def test_where_viewers_look_is_asked_for_when_it_is_wanted(core: Apart) -> None:
    asked = [0.0]

    def look() -> dict[str, StereoView]:
        asked[0] += 1.0
        return {"a": VIEW.moved(Pose((asked[0], 0.0, 0.0)))}

    core.update(a_frame(0), Newest(look), {})
    first, second = core.run(seen)
    assert first < second <= asked[0]


def test_what_the_core_raises_is_raised_here_and_it_goes_on(core: Apart) -> None:
    with pytest.raises(IndexError):
        core.render(VIEW)  # before any frame
    with pytest.raises(RuntimeError, match="OddError: 1 and 2"):
        core.run(odd)
    with pytest.raises((AttributeError, RuntimeError), match="lambda"):
        core.run(unsendable)
    assert core.run(known)[0] == []


def test_a_core_that_cannot_be_made_leaves_no_process() -> None:
    before = set(children())
    with pytest.raises(ValueError, match="too odd"):
        Apart(refuse)
    assert set(children()) == before


def children() -> list[str]:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()


def test_lent_frames_are_read_where_they_are_and_given_back_when_nobody_reads_them(core: Apart) -> None:
    freed: list[int] = []
    buffers = FrameBuffers(CAMERAS, 2, "farside-test", lambda: freed.append(1))
    for index in range(4):
        buffer = buffers.take()
        assert buffer is not None
        for planes in buffer.planes.values():
            planes.texture.y[:] = 100 + index
            planes.codes[:] = 20000
        views = tuple(View(camera, *buffer.planes[camera.name]) for camera in CAMERAS)
        frame = Frame(index, views, buffers.lent(buffer.number))
        del buffer, views, planes
        core.update(frame, {}, {})
        del frame
        gc.collect()
        assert core.run(lumas) == {100 + index}
        assert len(freed) == index  # all but the newest
    buffers.close()


def test_lent_memory_that_is_not_there_is_an_error_and_nothing_is_kept(core: Apart) -> None:
    buffers = FrameBuffers(CAMERAS, 1, "farside-test")
    lent = buffers.lent(0)._replace(name="farside-other")
    with pytest.raises(OSError, match="expected farside-other"):
        core.update(dataclasses.replace(a_frame(0), lent=lent), {}, {})
    assert not core._frames
    buffers.close()


def test_pictures_are_rendered_while_an_update_takes_its_time(core: Apart) -> None:
    core.update(a_frame(0), {}, {})
    core.run(hold)
    with ThreadPoolExecutor(1) as back_end:
        update = back_end.submit(core.update, a_frame(1), {}, {})
        assert core.run(wait_until_held)
        assert core.render(VIEW).frame_index == 0
        assert not update.done()
        core.run(let_go)
        update.result(HANG_S)
    assert core.render(VIEW).frame_index == 1


@pytest.mark.skipif(sys.platform != "linux", reason="priorities by thread are Linux'")
def test_a_thread_that_gives_way_does_so_over_there_and_no_other_does(core: Apart) -> None:
    with ThreadPoolExecutor(1) as back_end:
        back_end.submit(core.run, yield_cores).result()
        there, process = back_end.submit(core.run, niceness).result()
    assert there == min(process + 7, 19)
    assert core.run(niceness) == (process, process)
    assert os.getpriority(os.PRIO_PROCESS, os.getpid()) == process


@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM])
def test_when_its_process_ends_all_who_ask_are_told(core: Apart, by: int) -> None:
    with pytest.raises(CoreLostError, match=f"the engine's process ended by {signal.Signals(by).name}"):
        core.run(die, by)
    with pytest.raises(CoreLostError), ThreadPoolExecutor(1) as another:
        another.submit(core.render, VIEW).result()
    with pytest.raises(CoreLostError):
        core.retune(Settings.preset("fast"))


def test_the_process_ends_with_the_core_and_keyboard_interrupts_are_not_for_it() -> None:
    core = Apart(Watcher, SOURCE)
    assert os.getpgid(core.pid) != os.getpgid(0)
    core.close()
    core.close()
    assert str(core.pid) not in children()
    with pytest.raises(CoreLostError):
        core.status()
    dropped = Apart(Watcher, SOURCE)
    pid = str(dropped.pid)
    del dropped
    until(lambda: pid not in children())
    until(lambda: not any(thread.name == "farside-end" for thread in threading.enumerate()))
