"""Buffers of frames: who holds their memory, when they are free again, and which files another process may open."""

from __future__ import annotations

import gc
import os

import numpy as np
import pytest
from farside.engine.live.frame_memory import FrameBuffers, frame_bytes, lay_out, open_buffer
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, View
from support.doubles import CAMERAS, a_view

ODD = Camera("odd", Perspective(7, 5, 5, 5, 3, 2), Pose(), DepthCoding(0.5, 9))


@pytest.fixture
def buffers():
    buffers = FrameBuffers(CAMERAS, 2, "farside-test")
    yield buffers
    buffers.close()


def test_planes_lie_one_after_the_other_each_from_a_multiple_of_64_bytes_on():
    # 7 x 5 pixels of 2 bytes take 128 bytes with the gap, 4 x 3 of chroma 64.
    assert frame_bytes([ODD, ODD]) == 2 * (128 + 64 + 64 + 128)
    memory = np.zeros(frame_bytes([ODD, CAMERAS[0]]), np.uint8)
    planes = lay_out(memory, [ODD, CAMERAS[0]])
    assert [plane.shape for plane in _arrays(planes["odd"])] == [(5, 7), (3, 4), (3, 4), (5, 7)]
    start = memory.ctypes.data
    offsets = [plane.ctypes.data - start for name in ("odd", "v0") for plane in _arrays(planes[name])]
    v0 = 24 * 16 * 2
    assert offsets == [0, 128, 192, 256, 384, 384 + v0, 384 + v0 + v0 // 4, 384 + v0 + v0 // 2]
    for value, plane in enumerate(_arrays(planes["odd"]), 1):
        plane[:] = value
    assert [int(plane.max()) for plane in _arrays(planes["odd"])] == [1, 2, 3, 4]
    assert not planes["v0"].texture.y.any()


def _arrays(planes):
    return planes.texture.y, planes.texture.cb, planes.texture.cr, planes.codes


def test_a_buffer_is_free_again_when_the_last_plane_is_gone(buffers):
    freed = []
    buffers._on_free = lambda: freed.append(len(freed))
    first, second = buffers.take(), buffers.take()
    assert (first.number, second.number) == (0, 1)
    assert buffers.take() is None
    views = tuple(View(camera, *first.planes[camera.name]) for camera in CAMERAS)
    frame = Frame(0, views)
    del first, views
    assert buffers.take() is None
    part = frame.views[1].codes[3:5]  # what is made of a plane counts too
    del frame
    assert not freed
    del part
    assert freed == [0]
    again = buffers.take()
    assert again.number == 0
    assert buffers.take() is None
    del second, again


def test_what_is_in_use_outlives_the_buffers_and_tells_nobody():
    freed = []
    buffers = FrameBuffers(CAMERAS, 2, "farside-test", lambda: freed.append(1))
    taken = buffers.take()
    buffers.close()
    taken.planes["v0"].codes[:] = 5
    assert (taken.planes["v0"].codes == 5).all()
    assert buffers.take() is None
    lent = buffers.lent(taken.number)
    assert (open_buffer(*lent, CAMERAS)["v0"].codes == 5).all()
    with pytest.raises(OSError, match=r"expected farside-test|No such file"):
        open_buffer(*buffers.lent(1 - taken.number), CAMERAS)
    del taken
    gc.collect()
    with pytest.raises(OSError, match=r"expected farside-test|No such file"):
        open_buffer(*lent, CAMERAS)
    assert not freed


def test_what_another_writes_is_there(buffers):
    theirs = open_buffer(os.getpid(), buffers.files[1], "farside-test", CAMERAS)
    ours = (buffers.take(), buffers.take())[1].planes
    for camera in CAMERAS:
        seen = a_view(camera)
        theirs[camera.name].codes[:] = seen.codes
        theirs[camera.name].texture.cb[:] = 77
    assert (ours["v1"].codes == 20000).all()
    assert (ours["v1"].texture.cb == 77).all()
    assert not ours["v1"].texture.cr.any()


def test_its_size_is_fixed(buffers):
    with pytest.raises(PermissionError):
        os.ftruncate(buffers.files[0], 10)


def test_what_is_no_such_buffer_is_not_opened(buffers, tmp_path):
    process, file = os.getpid(), buffers.files[0]
    with pytest.raises(OSError, match=f"expected farside-other of {frame_bytes(CAMERAS)} bytes"):
        open_buffer(process, file, "farside-other", CAMERAS)
    with pytest.raises(OSError, match="expected farside-test of"):
        open_buffer(process, file, "farside-test", CAMERAS[:1])
    with pytest.raises(FileNotFoundError):
        open_buffer(process, 10**6, "farside-test", CAMERAS)
    path = tmp_path / "memfd:farside-test (deleted)"
    path.write_bytes(bytes(frame_bytes(CAMERAS)))
    with path.open("rb") as other, pytest.raises(OSError, match="expected farside-test"):
        open_buffer(process, other.fileno(), "farside-test", CAMERAS)
