"""In the process of a core: it works for the threads of its owner (`core_process`), one thread for each."""

from __future__ import annotations

import os
import pickle
import socket
import sys
import threading
import weakref
from collections import deque
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ..rig.camera import Camera
from ..rig.frame import Fault, Frame, Lent, View
from ..rig.viewer import StereoView
from .core import Core, Updated
from .frame_memory import lay_out, map_memory
from .interpreter import SETTLES_AFTER, SWITCH_S, set_aside

__all__ = ["Answer", "FileQuestion", "Question", "call", "make_core", "run", "serve", "update"]

_PACKET = 1 << 16  # bytes; pickled settings are smaller


class Answer(NamedTuple):
    """What work has come to."""

    result: Any
    error: Exception | None
    released: list[int]  # numbers of the frames that the process has stopped reading


class Question(NamedTuple):
    """A question to the owner: where do the viewers look now?"""


class FileQuestion(NamedTuple):
    """A question to the owner: for a file that it has open. It is answered by the file itself (SCM_RIGHTS)."""

    file: int


class _Host:
    """Shared by the threads of the core's process: the core, and the frames that it reads."""

    def __init__(self) -> None:
        self.core: Core
        self.updates = 0
        self.released: deque[int] = deque()
        self._maps: dict[Lent, Any] = {}

    def frame(
        self, line: Connection, number: int, index: int, views: tuple[tuple[Camera, Fault | None], ...], lent: Lent
    ) -> Frame:
        """A frame in lent memory; its number is added to `released` when its planes are gone."""
        cameras = tuple(camera for camera, _ in views)
        if lent not in self._maps:
            # Memory under another name is of an earlier source and is not lent again.
            self._maps = {known: memory for known, memory in self._maps.items() if known.name == lent.name}
            try:
                self._maps[lent] = _map(line, lent.file, cameras)
            except (EOFError, OSError):
                self.released.append(number)
                raise
        memory = np.frombuffer(self._maps[lent], np.uint8)
        weakref.finalize(memory, self.released.append, number).atexit = False
        planes = lay_out(memory, cameras)
        return Frame(index, tuple(View(camera, *planes[camera.name], fault) for camera, fault in views))

    def take_released(self) -> list[int]:
        """Numbers of the frames released since the last call."""
        return [self.released.popleft() for _ in range(len(self.released))]


def _map(line: Connection, file: int, cameras: tuple[Camera, ...]) -> Any:
    """The memory of a file of the owner's. /proc, which would have it too, is not there in every container."""
    line.send_bytes(pickle.dumps(FileQuestion(file)))
    with socket.socket(fileno=os.dup(line.fileno())) as ours:
        _, files, _, _ = socket.recv_fds(ours, len(b"file"), 1)
    if not files:
        raise EOFError
    try:
        return map_memory(files[0], cameras)
    finally:
        os.close(files[0])


def make_core(host: _Host, line: Connection, make: Callable[..., Core], *arguments: Any) -> None:
    """Work: make the core."""
    host.core = make(*arguments)


def call(host: _Host, line: Connection, method: str, *arguments: Any) -> Any:
    """Work: call a method of the core."""
    return getattr(host.core, method)(*arguments)


def run(host: _Host, line: Connection, work: Callable[..., Any], *arguments: Any) -> Any:
    """Work: call a function with the core."""
    return work(host.core, *arguments)


def update(
    host: _Host, line: Connection, number: int, what: Any, speeds: Mapping[str, float], f_vin: float
) -> Updated:
    """Work: let the core take a frame, or the index, views (cameras and faults) and memory of one."""

    def look() -> Mapping[str, StereoView]:
        line.send_bytes(pickle.dumps(Question()))
        views: dict[str, StereoView] = pickle.loads(line.recv_bytes())
        return views

    frame = what if isinstance(what, Frame) else host.frame(line, number, *what)
    updated = host.core.update(frame, look, speeds, f_vin)
    host.updates += 1
    if host.updates in SETTLES_AFTER:
        set_aside()
    return updated


def serve() -> NoReturn:
    """The main function of the core's process; its first argument is the descriptor of the control socket."""
    sys.setswitchinterval(SWITCH_S)
    control, host = socket.socket(fileno=int(sys.argv[1])), _Host()
    while True:
        packet, files, _, _ = socket.recv_fds(control, _PACKET, 1)
        if files:
            threading.Thread(target=_work, args=(host, Connection(files[0])), daemon=True).start()
        elif packet:
            host.core.retune(pickle.loads(packet))
        else:
            os._exit(0)  # even if work is under way: nobody waits for it


def _work(host: _Host, line: Connection) -> None:
    """Work for one thread of the owner until that thread ends."""
    while True:
        try:
            message = line.recv_bytes()
            line.send_bytes(_answer(host, line, message))
        except (EOFError, OSError):
            return
        del message


def _answer(host: _Host, line: Connection, message: bytes) -> bytes:
    try:
        work, *arguments = pickle.loads(message)
        result = work(host, line, *arguments)
        del arguments
        return pickle.dumps(Answer(result, None, host.take_released()), protocol=5)
    except Exception as error:  # a boundary: raised again in the process that asked for the work
        return pickle.dumps(Answer(None, _portable(error), host.take_released()))


def _portable(error: Exception) -> Exception:
    """The error, or a RuntimeError with its text if it cannot be pickled."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # its class may raise anything
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
