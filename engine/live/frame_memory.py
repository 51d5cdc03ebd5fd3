"""Memory for arriving frames: a few buffers that are reused, and that another process can map and write to."""

from __future__ import annotations

import fcntl
import math
import mmap
import os
import threading
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera
from ..rig.frame import Lent, Texture

__all__ = ["FrameBuffer", "FrameBuffers", "Planes", "frame_bytes", "lay_out", "map_memory", "open_buffer"]

_ALIGNMENT = 64  # bytes


class Planes(NamedTuple):
    """The arrays of one view's texture and depth codes (uint16 [h, w])."""

    texture: Texture
    codes: npt.NDArray[np.uint16]


def _shapes(camera: Camera) -> list[tuple[int, int]]:
    """Shapes of Y, Cb, Cr and the depth codes."""
    luma, chroma = (camera.height, camera.width), ((camera.height + 1) // 2, (camera.width + 1) // 2)
    return [luma, chroma, chroma, luma]


def _padded(shape: tuple[int, int]) -> int:
    return -(-2 * math.prod(shape) // _ALIGNMENT) * _ALIGNMENT


def frame_bytes(cameras: Sequence[Camera]) -> int:
    """Bytes of memory of a frame."""
    return sum(_padded(shape) for camera in cameras for shape in _shapes(camera))


def lay_out(memory: npt.NDArray[np.uint8], cameras: Sequence[Camera]) -> dict[str, Planes]:
    """The planes of a frame in its memory, by camera: Y, Cb, Cr, depth, each at a multiple of 64 bytes."""
    offset, planes = 0, {}
    for camera in cameras:
        arrays = []
        for shape in _shapes(camera):
            arrays.append(memory[offset : offset + 2 * math.prod(shape)].view(np.uint16).reshape(shape))
            offset += _padded(shape)
        planes[camera.name] = Planes(Texture(*arrays[:3]), arrays[3])
    return planes


@dataclass(frozen=True, slots=True)
class FrameBuffer:
    """The memory of one frame; it is free again when the last reference to its planes is gone."""

    number: int
    planes: dict[str, Planes]  # by camera


class FrameBuffers:
    """Memory of `count` frames, taken and given back; `on_free` is called, in any thread, when one has come back.

    Each buffer is an anonymous file (memfd) that a process with access to this one can open: `files` are the
    descriptors here, `name` is the files' name in /proc. Their size is sealed. Buffers are reused because fresh memory
    costs more than filling it, and no more than `count` frames are ever kept.
    """

    def __init__(
        self, cameras: Sequence[Camera], count: int, name: str, on_free: Callable[[], None] = lambda: None
    ) -> None:
        self.cameras, self.name = tuple(cameras), name
        self.files = [_create(name, frame_bytes(self.cameras)) for _ in range(count)]
        self._maps: list[Any] = [mmap.mmap(file, frame_bytes(self.cameras)) for file in self.files]
        self._on_free = on_free
        self._free = deque(range(count))
        self._closed = False
        self._lock = threading.Lock()

    def take(self) -> FrameBuffer | None:
        """A free buffer; None if all are in use."""
        with self._lock:
            if not self._free:
                return None
            number = self._free.popleft()
        memory = np.frombuffer(self._maps[number], np.uint8)
        weakref.finalize(memory, self._give_back, number).atexit = False  # the base of all planes: outlives them
        return FrameBuffer(number, lay_out(memory, self.cameras))

    def lent(self, number: int) -> Lent:
        """The address of buffer `number` for another process."""
        return Lent(os.getpid(), self.files[number], self.name)

    def _give_back(self, number: int) -> None:
        with self._lock:
            if self._closed:
                self._drop(number)
                return
            self._free.append(number)
        self._on_free()

    def close(self) -> None:
        """Frees the memory. Buffers in use stay, and can be opened, until they are given back; `on_free` is not called.
        """
        with self._lock:
            self._closed = True
            while self._free:
                self._drop(self._free.pop())

    def _drop(self, number: int) -> None:
        os.close(self.files[number])
        self._maps[number] = None


def _create(name: str, size: int) -> int:
    file = os.memfd_create(name, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(file, size)
    fcntl.fcntl(file, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL)
    return file


def open_buffer(process: int, file: int, name: str, cameras: Sequence[Camera]) -> dict[str, Planes]:
    """The planes of another process' buffer, writable; arguments as in `Lent`.

    Raises OSError if it cannot be opened (there is no /proc, or the process is of another user or in another
    container), or its name or size is not the expected one.
    """
    path = f"/proc/{process}/fd/{file}"
    opened = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        found = os.readlink(f"/proc/self/fd/{opened}"), os.fstat(opened).st_size
        if found != (f"/memfd:{name} (deleted)", frame_bytes(cameras)):
            raise OSError(f"{path}: {found}: expected {name} of {frame_bytes(cameras)} bytes")
        return lay_out(np.frombuffer(map_memory(opened, cameras), np.uint8), cameras)
    finally:
        os.close(opened)


def map_memory(file: int, cameras: Sequence[Camera]) -> mmap.mmap:
    """The memory of a frame in an open file, writable; raises OSError if it has another size than expected."""
    if (size := os.fstat(file).st_size) != frame_bytes(cameras):
        raise OSError(f"a frame's memory: {size} bytes: expected {frame_bytes(cameras)}")
    return mmap.mmap(file, size)
