"""A core in a process of its own, so that its computations never block the interpreter of the process that owns it."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import weakref
from collections import deque
from collections.abc import Callable, Mapping
from itertools import count
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ..rig.camera import Camera
from ..rig.frame import Frame, Lent, View
from ..rig.viewer import EncodedPair, StereoView
from ..settings import Settings
from .core import Core, CoreLostError, Look, Updated
from .frame_memory import lay_out, open_memory
from .interpreter import SETTLES_AFTER, SWITCH_S, set_aside

__all__ = ["ProcessCore", "kill_all"]

_START = "from farside.engine.live.core_process import serve; serve()"
_END_S = 10.0  # time for a process to end before it is killed
_PACKET = 1 << 16  # bytes; pickled settings are smaller
_processes: weakref.WeakSet[subprocess.Popen[bytes]] = weakref.WeakSet()  # of all cores, those that end included


def kill_all() -> None:
    """End the processes of all cores at once, whatever they do; whoever waits for one gets CoreLostError.

    For a program that must end: it may be called from a signal handler.
    """
    for process in list(_processes):
        process.kill()


class _Answer(NamedTuple):
    result: Any
    error: Exception | None
    released: list[int]  # numbers of the frames that the process has stopped reading


class _Question(NamedTuple):
    """A question from the core's process: where do the viewers look now?"""


class ProcessCore:
    """A core in a process of its own (`core.Core`).

    Every calling thread has a thread of that process that works for it. If a frame's memory has a name (`Frame.lent`),
    only the name is sent, and the frame stays reserved until the process has stopped reading it. `make` is called in
    that process, with the arguments, and returns the core that does the work; it is pickled, as are questions and
    answers. Raises CoreLostError if the process has ended; exceptions of the core are raised here.
    """

    def __init__(self, make: Callable[..., Core], *arguments: Any) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _START, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                process_group=0,  # Ctrl-C goes only to the owner
            )
        _processes.add(self._process)
        self._lines = threading.local()
        self._frames: dict[int, Frame] = {}  # frames that the process reads
        self._numbers = count()
        self._end = weakref.finalize(self, _end_later, self._control, self._process)
        self._end.atexit = False  # when this process ends, the system closes the socket
        try:
            self._ask(_make, make, *arguments)
        except BaseException:
            self.close()
            raise

    def give_way(self, niceness: int) -> None:
        """Lower the priority of the thread, in that process, that works for the calling one."""
        self._ask(_call, "give_way", niceness)

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        """Take a frame; the status also has the `pid` of the process."""
        number = next(self._numbers)
        self._frames[number] = frame
        cameras = tuple(view.camera for view in frame.views)
        what = (frame.index, cameras, frame.lent) if frame.lent is not None else frame
        try:
            updated: Updated = self._ask(_update, number, what, dict(speeds), f_vin, look=look)
        finally:
            if frame.lent is None:  # the process has a copy
                del self._frames[number]
        return Updated(updated.stages, {**updated.status, "pid": self.pid})

    def picture(self, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """Both eyes' pictures of the newest frame, encoded in that process."""
        pair: EncodedPair = self._ask(_call, "picture", view, viewer, encoding)
        return pair

    def retune(self, settings: Settings) -> None:
        """Use other settings from the next picture on; returns at once."""
        try:
            self._control.send(pickle.dumps(settings))
        except OSError as error:
            raise self._lost() from error

    def mesh(self, file_format: str, colours: str | None = None) -> bytes:
        """The background model as a file, made in that process."""
        data: bytes = self._ask(_call, "mesh", file_format, colours)
        return data

    def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """The result of `work(core, *arguments)` in that process: for inspection."""
        return self._ask(_run, work, *arguments)

    @property
    def held_frames(self) -> int:
        """The number of frames that are reserved because the process reads them."""
        return len(self._frames)

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    def close(self) -> None:
        """End the process; no call may be under way. This also happens when the last reference to the core is gone."""
        if self._end.detach():
            _end(self._control, self._process)
        self._lines = threading.local()

    def _ask(self, *work: Any, look: Look = dict) -> Any:
        message = pickle.dumps(work, protocol=5)
        try:
            line = self._line()
            line.send_bytes(message)
            while isinstance(answer := pickle.loads(line.recv_bytes()), _Question):
                line.send_bytes(pickle.dumps(self._seen(look)))
        except (EOFError, OSError) as error:
            raise self._lost() from error
        for number in answer.released:
            self._frames.pop(number, None)
        if answer.error is not None:
            raise answer.error
        return answer.result

    def _seen(self, look: Look) -> dict[str, StereoView]:
        """The present views of the viewers. If `look` raises, the line is closed, as it still waits for an answer."""
        try:
            return dict(look())
        except BaseException:
            self._lines.line.close()
            del self._lines.line
            raise

    def _line(self) -> Connection:
        """The calling thread's connection to the thread that works for it."""
        if not hasattr(self._lines, "line"):
            ours, theirs = socket.socketpair()
            self._lines.line = Connection(ours.detach())
            with theirs:
                socket.send_fds(self._control, [b"line"], [theirs.fileno()])
        line: Connection = self._lines.line
        return line

    def _lost(self) -> CoreLostError:
        try:
            code = self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            return CoreLostError("the engine's process does not answer")
        how = f"by {signal.Signals(-code).name}" if code < 0 else f"with {code}"
        return CoreLostError(f"the engine's process ended {how}")


def _end(control: socket.socket, process: subprocess.Popen[bytes]) -> None:
    control.close()
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _end_later(control: socket.socket, process: subprocess.Popen[bytes]) -> None:
    threading.Thread(target=_end, args=(control, process), name="farside-end").start()  # freeing gigabytes takes time


# In the process of the core


class _Host:
    """Shared by the threads of the core's process: the core, and the frames that it reads."""

    def __init__(self) -> None:
        self.core: Core
        self.updates = 0
        self.released: deque[int] = deque()
        self._maps: dict[Lent, Any] = {}

    def frame(self, number: int, index: int, cameras: tuple[Camera, ...], lent: Lent) -> Frame:
        """A frame in lent memory; its number is added to `released` when its planes are gone."""
        if lent not in self._maps:
            # Memory under another name is of an earlier source and is not lent again.
            self._maps = {known: memory for known, memory in self._maps.items() if known.name == lent.name}
            try:
                self._maps[lent] = open_memory(*lent, cameras)
            except OSError:
                self.released.append(number)
                raise
        memory = np.frombuffer(self._maps[lent], np.uint8)
        weakref.finalize(memory, self.released.append, number).atexit = False
        planes = lay_out(memory, cameras)
        return Frame(index, tuple(View(camera, *planes[camera.name]) for camera in cameras))

    def take_released(self) -> list[int]:
        """Numbers of the frames released since the last call."""
        return [self.released.popleft() for _ in range(len(self.released))]


def _make(host: _Host, line: Connection, make: Callable[..., Core], *arguments: Any) -> None:
    host.core = make(*arguments)


def _call(host: _Host, line: Connection, method: str, *arguments: Any) -> Any:
    return getattr(host.core, method)(*arguments)


def _run(host: _Host, line: Connection, work: Callable[..., Any], *arguments: Any) -> Any:
    return work(host.core, *arguments)


def _update(
    host: _Host, line: Connection, number: int, what: Any, speeds: Mapping[str, float], f_vin: float
) -> Updated:
    def look() -> Mapping[str, StereoView]:
        line.send_bytes(pickle.dumps(_Question()))
        views: dict[str, StereoView] = pickle.loads(line.recv_bytes())
        return views

    frame = what if isinstance(what, Frame) else host.frame(number, *what)
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
        return pickle.dumps(_Answer(result, None, host.take_released()), protocol=5)
    except Exception as error:  # a boundary: raised again in the process that asked for the work
        return pickle.dumps(_Answer(None, _portable(error), host.take_released()))


def _portable(error: Exception) -> Exception:
    """The error, or a RuntimeError with its text if it cannot be pickled."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # its class may raise anything
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
