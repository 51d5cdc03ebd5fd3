"""A container may have no /proc: the service takes frames and makes pictures there, too."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from farside.clients.connection import connect
from farside.clients.fetching import fetch
from farside.server.pictures import encode_view
from farside.server.protocol import BufferFree, FrameDone, PoseUpdate, Scene, SourceHello, Stereo, ViewerHello
from support.rooms import camera_row, frame

CAMERAS = tuple(camera_row())
COMPILES_S = 900  # when no kernel is kept
WITHOUT = ["unshare", "-m", "sh", "-c", 'umount -l /proc && ! [ -e /proc/self ] && exec "$0" "$@"']
able = subprocess.run([*WITHOUT, "true"], capture_output=True).returncode == 0
pytestmark = pytest.mark.skipif(not able, reason="this user may not take /proc away (unshare -m, umount)")


@contextmanager
def serving(*given: str) -> Iterator[str]:
    """The address of a server, with an engine, that has no /proc."""
    command = [*WITHOUT, sys.executable, "-m", "farside.clients.cli", "serve", "--port", "0", *given]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        said = re.match(r"serving at (\S+) ", line)
        assert said, line or process.communicate()
        yield said[1]
    finally:
        process.terminate()
        _, told = process.communicate()
    assert "Traceback" not in told


@pytest.mark.parametrize("shares", [True, False])
def test_frames_are_taken_and_pictures_made(shares: bool) -> None:
    async def scenario(url: str) -> None:
        viewing = ViewerHello.symmetric(64, 48, 1.2)
        hello = SourceHello("room", 30.0, CAMERAS, shares=shares)
        async with (
            asyncio.timeout(COMPILES_S),
            connect(url, hello) as (source, _),
            connect(url, viewing) as (viewer, _),
        ):
            for index in range(3):
                for view in frame(index, CAMERAS).views:
                    await source.send(encode_view(view, index))
                while isinstance(done := await source.receive(FrameDone, BufferFree), BufferFree):
                    pass
                assert done == FrameDone(index, "updated")
            await viewer.send(PoseUpdate(0, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
            while not isinstance(picture := await viewer.receive(Stereo, Scene), Stereo):
                pass
            assert (picture.frame, picture.width) == (2, 64)
            status = json.loads(await asyncio.to_thread(fetch, url, "status", timeout_s=60))
            assert status["frames"]["updated"] == 3
            assert status["engine"]["pid"] > 0
            loop = status["event_loop"]
            assert {name for name, value in loop.items() if value is None} == {
                "longest_own_stall_ms", "longest_own_stall_during_update_ms",
            }  # fmt: skip
            metrics = (await asyncio.to_thread(fetch, url, "metrics", timeout_s=60)).decode()
            assert "farside_longest_stall_ms" in metrics
            assert "own_stall" not in metrics

    with serving("--quality", "fast") as url:
        asyncio.run(scenario(url))


def test_a_source_without_proc_sends_its_frames() -> None:
    """The server offers its memory; the source can't open it."""
    code = (
        "import os; from farside.engine.live.frame_memory import FrameBuffers\n"
        "from farside.clients.replay import _open_buffers\n"
        "from farside.server.protocol import SharedMemory\n"
        "from support.doubles import CAMERAS\n"
        "buffers = FrameBuffers(CAMERAS, 1, 'farside-test')\n"
        "memory = SharedMemory(os.getpid(), 'farside-test', tuple(buffers.files))\n"
        "print(_open_buffers(memory, CAMERAS))\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    for way, expected in ((WITHOUT, "None"), ([], "[{'v0'")):
        done = subprocess.run([*way, sys.executable, "-c", code], capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(expected)
