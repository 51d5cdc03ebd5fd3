"""A core in a process of its own: requests arrive there, answers arrive here, and it ends when it should."""

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
from tempfile import TemporaryFile
from typing import Any

import pytest
from farside.engine.live.core import CoreLostError, Look, Source, Updated
from farside.engine.live.core_process import ProcessCore
from farside.engine.live.frame_memory import FrameBuffers
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Fault, Frame, View
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
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

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        self.seen = tuple(view.pose.position[0] for view in (*look().values(), *look().values()))
        self.frame = frame
        return super().update(frame, dict, speeds, f_vin)


def looking() -> dict[str, StereoView]:
    return {"a": VIEW}


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


def niceness(core: FakeCore) -> tuple[int, int]:
    """Of the thread, and of its process."""
    return os.getpriority(os.PRIO_PROCESS, threading.get_native_id()), os.getpriority(os.PRIO_PROCESS, os.getpid())


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))


@pytest.fixture
def core() -> Iterator[ProcessCore]:
    made = ProcessCore(Watcher, SOURCE)
    yield made
    made.close()


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def test_it_is_used_as_the_core_is(core: ProcessCore) -> None:
    updated = core.update(a_frame(7), looking, {"a": 0.5}, 12.0)
    assert updated == Updated({"background": 1.0, "total": 2.0}, {"frame_index": 7, "pid": core.pid})
    assert core.pid != os.getpid()
    here = FakeCore(SOURCE, updates=[7])
    assert core.picture(VIEW, "a", "raw") == here.picture(VIEW, "a", "raw")
    assert core.mesh("ply") == here.mesh("ply")
    assert core.run(known) == ([7], {"a": 0.5}, 12.0, None)
    settings = Settings.preset("fast")
    core.retune(settings)
    until(lambda: core.run(known)[3] == settings)


def test_where_viewers_look_is_asked_for_when_it_is_wanted(core: ProcessCore) -> None:
    asked = [0.0]

    def look() -> dict[str, StereoView]:
        asked[0] += 1.0
        return {"a": VIEW.moved(Pose((asked[0], 0.0, 0.0)))}

    core.update(a_frame(0), look, {}, 30.0)
    first, second = core.run(seen)
    assert first < second <= asked[0]


def test_a_look_that_fails_fails_its_update_only(core: ProcessCore) -> None:
    def look() -> dict[str, StereoView]:
        raise KeyError("a viewer who has left")

    with pytest.raises(KeyError, match="a viewer who has left"):
        core.update(a_frame(0), look, {}, 30.0)
    assert core.update(a_frame(1), looking, {}, 30.0).status["frame_index"] == 1
    assert core.picture(VIEW, "a", "raw").report.frame_index == 1


def test_what_the_core_raises_is_raised_here_and_it_goes_on(core: ProcessCore) -> None:
    with pytest.raises(IndexError):
        core.picture(VIEW, "a", "raw")  # before any frame
    with pytest.raises(RuntimeError, match="OddError: 1 and 2"):
        core.run(odd)
    with pytest.raises((AttributeError, RuntimeError), match="lambda"):
        core.run(unsendable)
    assert core.run(known)[0] == []


def test_a_core_that_cannot_be_made_leaves_no_process() -> None:
    before = set(children())
    with pytest.raises(ValueError, match="too odd"):
        ProcessCore(refuse)
    assert set(children()) == before


def children() -> list[str]:
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()


def test_lent_frames_are_read_where_they_are_and_given_back_when_nobody_reads_them(core: ProcessCore) -> None:
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
        core.update(frame, dict, {}, 30.0)
        del frame
        gc.collect()
        assert core.run(lumas) == {100 + index}
        assert len(freed) == index  # all but the newest
    buffers.close()


@pytest.mark.parametrize("lent", [True, False])
def test_which_views_are_left_out_goes_there_and_comes_back(core: ProcessCore, lent: bool) -> None:
    buffers = FrameBuffers(CAMERAS, 1, "farside-test")
    buffer = buffers.take()
    assert buffer is not None
    fault = Fault("texture", "12 bytes: expected a JPEG")
    views = tuple(View(c, *buffer.planes[c.name], fault if c.name == "v1" else None) for c in CAMERAS)
    updated = core.update(Frame(0, views, buffers.lent(buffer.number) if lent else None), dict, {}, 30.0)
    assert (updated.left_out, updated.shown) == ({"v1": fault}, True)
    views = tuple(dataclasses.replace(view, fault=fault) for view in views)
    updated = core.update(Frame(1, views, buffers.lent(buffer.number) if lent else None), dict, {}, 30.0)
    assert (updated.left_out, updated.shown) == ({"v0": fault, "v1": fault}, False)
    del buffer, views
    buffers.close()


def test_lent_memory_that_is_not_there_is_an_error_and_nothing_is_kept(core: ProcessCore) -> None:
    buffers = FrameBuffers(CAMERAS, 1, "farside-test")
    closed = buffers.lent(0)._replace(name="farside-closed", file=1 << 20)
    with pytest.raises(OSError, match="Bad file descriptor"):
        core.update(dataclasses.replace(a_frame(0), lent=closed), dict, {}, 30.0)
    with TemporaryFile() as other:
        lent = buffers.lent(0)._replace(name="farside-other", file=other.fileno())
        with pytest.raises(OSError, match="a frame's memory: 0 bytes: expected "):
            core.update(dataclasses.replace(a_frame(0), lent=lent), dict, {}, 30.0)
    core.update(a_frame(0), dict, {}, 30.0)
    assert core.held_frames == 0
    buffers.close()


def test_pictures_are_rendered_while_an_update_takes_its_time(core: ProcessCore) -> None:
    core.update(a_frame(0), dict, {}, 30.0)
    core.run(hold)
    with ThreadPoolExecutor(1) as back_end:
        update = back_end.submit(core.update, a_frame(1), dict, {}, 30.0)
        assert core.run(wait_until_held)
        assert core.picture(VIEW, "a", "raw").report.frame_index == 0
        assert not update.done()
        core.run(let_go)
        update.result(HANG_S)
    assert core.picture(VIEW, "a", "raw").report.frame_index == 1


@pytest.mark.skipif(sys.platform != "linux", reason="priorities by thread are Linux'")
def test_a_thread_that_gives_way_does_so_over_there_and_no_other_does(core: ProcessCore) -> None:
    with ThreadPoolExecutor(1) as back_end:
        back_end.submit(core.give_way, 7).result()
        there, process = back_end.submit(core.run, niceness).result()
    assert there == min(process + 7, 19)
    assert core.run(niceness) == (process, process)
    assert os.getpriority(os.PRIO_PROCESS, os.getpid()) == process


@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM])
def test_when_its_process_ends_all_who_ask_are_told(core: ProcessCore, by: int) -> None:
    with pytest.raises(CoreLostError, match=f"the engine's process ended by {signal.Signals(by).name}"):
        core.run(die, by)
    with pytest.raises(CoreLostError), ThreadPoolExecutor(1) as another:
        another.submit(core.picture, VIEW, "a", "raw").result()
    with pytest.raises(CoreLostError):
        core.retune(Settings.preset("fast"))


def test_the_process_ends_with_the_core_and_keyboard_interrupts_are_not_for_it() -> None:
    core = ProcessCore(Watcher, SOURCE)
    assert os.getpgid(core.pid) != os.getpgid(0)
    core.close()
    core.close()
    assert str(core.pid) not in children()
    with pytest.raises(CoreLostError):
        core.mesh("glb")
    dropped = ProcessCore(Watcher, SOURCE)
    pid = str(dropped.pid)
    del dropped
    until(lambda: pid not in children())
    until(lambda: not any(thread.name == "farside-end" for thread in threading.enumerate()))
