"""The demo's twin is played while it is made, and is whole or not there."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from farside.clients.demo_twin import FIRST_VIEWS, DemoTwin
from farside.engine.io.recording import open_recording
from farside.engine.io.whole_sequence import hidden_folder
from farside.engine.synth import write_twin
from support.doubles import HANG_S

SCALE, FRAMES = 0.04, 100


def _state(stat: Path) -> str:
    """The state of a process, from Linux's /proc; X: it has ended."""
    with contextlib.suppress(OSError):
        return stat.read_text().rpartition(")")[2].split()[0]
    return "X"


async def _until_whole(twin: DemoTwin) -> list[int]:
    """The numbers of frames that were there, one after the other."""
    seen = [twin.done]
    while twin.done < FRAMES or hidden_folder(twin.folder).is_dir():
        if twin.done != seen[-1]:
            seen.append(twin.done)
        await asyncio.sleep(0.001)
    return seen


def test_frames_can_be_read_while_others_are_made(tmp_path: Path) -> None:
    twin = DemoTwin(tmp_path / "museum", SCALE, FRAMES)

    async def play() -> list[int]:
        twin.start()
        await twin.wait_for_cameras()
        assert len(twin.source_names) == 24
        early = await asyncio.to_thread(twin.frame, 0)  # it waits
        assert len(early.there) >= FIRST_VIEWS
        assert {str(fault) for fault in early.faults.values()} <= {"not made yet"}
        seen = await _until_whole(twin)
        whole = open_recording(twin.folder)
        for view, same in zip(early.views, whole.frame(0).views, strict=True):
            if not view.there:
                continue
            assert (view.texture.y == same.texture.y).all()
            assert (view.codes == same.codes).all()
        last = twin.frame(FRAMES - 1, twin.source_names[:2])  # it reads on from the folder's new place
        assert (last.views[1].codes == whole.frame(FRAMES - 1).views[1].codes).all()
        assert len(list(twin.frames(0, None, twin.source_names[:1]))) == FRAMES
        return seen

    try:
        seen = asyncio.run(play())
    finally:
        twin.stop()
    assert seen == sorted(seen)
    assert len(seen) > 2
    assert not hidden_folder(twin.folder).exists()
    assert (twin.folder / "museum.json").is_file()


def test_views_that_are_not_made_yet_are_left_out_of_the_first_frame(tmp_path: Path) -> None:
    folder = tmp_path / "museum"
    write_twin("museum", folder, 0.02, 1)
    whole = open_recording(folder).frame(0)
    (folder / "v7_depth_40x40_yuv420p16le.yuv").unlink()
    (folder / "v9_texture_40x40_yuv420p10le.yuv").write_bytes(b"half a picture")
    twin = DemoTwin(folder, 0.02, 1)
    cut = twin.frame(0)
    twin.stop()
    assert list(cut.faults) == ["v7", "v9"]
    assert all((cut.views[k].codes == whole.views[k].codes).all() for k in cut.there)


def test_one_that_is_stopped_leaves_nothing(tmp_path: Path) -> None:
    twin = DemoTwin(tmp_path / "museum", SCALE, 10_000)
    twin.start()
    asyncio.run(twin.wait_for_first_views())
    twin.stop()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone ends a process with its parent")
def test_one_that_stands_still_ends_with_its_parent_and_leaves_the_place_free(tmp_path: Path) -> None:
    folder = tmp_path / "museum"
    script = (
        "import asyncio, sys, time; from pathlib import Path; from farside.clients.demo_twin import DemoTwin\n"
        f"twin = DemoTwin(Path({str(folder)!r}), {SCALE}, 10_000)\n"
        "twin.start(); asyncio.run(twin.wait_for_first_views()); twin.pause(); print(twin._process.pid, flush=True)\n"
        "time.sleep(1000)"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        child = Path("/proc") / parent.stdout.readline().strip() / "stat"
        while _state(child) != "T":
            time.sleep(0.01)
        parent.kill()
    while _state(child) not in "ZX":
        time.sleep(0.01)
    twin = DemoTwin(folder, SCALE, 1)
    twin.start()
    try:
        asyncio.run(twin.wait_for_first_views())
    finally:
        twin.stop()


def test_two_demos_share_a_twin_and_the_second_goes_on_alone(tmp_path: Path) -> None:
    first, second = (DemoTwin(tmp_path / "museum", SCALE, 10_000) for _ in range(2))

    async def play() -> None:
        first.start()
        await first.wait_for_first_views()
        second.start()
        await second.wait_for_first_views()
        assert second.frame(0).there
        first.stop()
        assert not list(tmp_path.iterdir())
        reading = asyncio.create_task(asyncio.to_thread(second.frame, 7))  # by a replay, which knows nothing of it
        while not reading.done():
            second.check()
            await asyncio.sleep(0.1)
        frame = await reading
        assert frame.there
        assert frame.index <= 7

    try:
        asyncio.run(asyncio.wait_for(play(), HANG_S))
    finally:
        second.stop()
    assert not list(tmp_path.iterdir())


def test_who_waits_for_a_first_frame_of_one_that_is_stopped_is_told(tmp_path: Path) -> None:
    twin = DemoTwin(tmp_path / "museum", SCALE, 10_000)

    async def play() -> None:
        twin.start()
        await twin.wait_for_cameras()
        twin.pause()
        if twin.first_views >= FIRST_VIEWS:  # it was faster than this test
            twin.go_on()
            return
        waiting = asyncio.create_task(asyncio.to_thread(twin.frame, 0))
        await asyncio.sleep(0.3)
        assert not waiting.done()
        twin.stop()
        with pytest.raises(OSError, match="expected to be made: stopped"):
            await waiting

    try:
        asyncio.run(asyncio.wait_for(play(), HANG_S))
    finally:
        twin.stop()


def test_what_keeps_it_from_being_made_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "museum"
    folder.write_text("a file")
    twin = DemoTwin(folder, SCALE, FRAMES)
    twin.start()
    try:
        with pytest.raises(OSError, match=r"twin: .*museum: expected to be made: .*a file"):
            asyncio.run(twin.wait_for_first_views())
    finally:
        twin.stop()


def test_a_process_that_was_killed_is_told(tmp_path: Path) -> None:
    twin = DemoTwin(tmp_path / "museum", SCALE, 10_000)

    async def play() -> None:
        twin.start()
        await twin.wait_for_cameras()
        assert twin._process is not None
        twin._process.kill()
        twin._process.wait()
        twin.check()

    try:
        with pytest.raises(OSError, match="expected to be made: its process has ended with code -9"):
            asyncio.run(asyncio.wait_for(play(), HANG_S))
    finally:
        twin.stop()


def test_who_reads_a_frame_that_is_gone_is_told_why(tmp_path: Path) -> None:
    twin = DemoTwin(tmp_path / "museum", SCALE, 10_000)

    async def play() -> None:
        twin.start()
        await twin.wait_for_first_views()
        assert twin._process is not None
        twin._process.kill()
        twin._process.wait()
        shutil.rmtree(hidden_folder(twin.folder))
        await asyncio.to_thread(twin.frame, 1)

    try:
        with pytest.raises(OSError, match="expected to be made: its process has ended with code -9"):
            asyncio.run(asyncio.wait_for(play(), HANG_S))
    finally:
        twin.stop()


def test_it_is_read_while_its_folder_moves(tmp_path: Path) -> None:
    twin, hidden = DemoTwin(tmp_path / "museum", 0.02, 3), tmp_path / ".museum.farside-unfinished"
    assert hidden == hidden_folder(twin.folder)
    write_twin("museum", twin.folder, 0.02, 3)
    moving = threading.Event()

    def move() -> None:
        for _ in range(3):
            twin.folder.rename(hidden)
            time.sleep(0.5)
            hidden.rename(twin.folder)
            time.sleep(0.5)
        moving.set()

    assert twin.done == 3
    mover = threading.Thread(target=move)
    mover.start()
    while not moving.is_set():
        assert twin.frame_count == 3
        assert len(twin.frame(2).views) == 24
    mover.join()
    twin.stop()
