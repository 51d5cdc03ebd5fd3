"""A core in a process of its own, so that its computations never block the interpreter of the process that owns it."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from itertools import count
from multiprocessing.connection import Connection
from typing import Any

from ..rig.camera import Camera
from ..rig.effects import Effect
from ..rig.frame import Frame
from ..rig.viewer import EncodedPair, StereoView
from ..settings import Settings
from .core import Core, CoreLostError, Look, Updated
from .core_host import Answer, FileQuestion, call, make_core, run, update

__all__ = ["ProcessCore", "kill_all"]

_START = "from farside.engine.live.core_host import serve; serve()"
_END_S = 10.0  # time for a process to end before it is killed
_processes: weakref.WeakSet[subprocess.Popen[bytes]] = weakref.WeakSet()  # of all cores, those that end included


def kill_all() -> None:
    """End the processes of all cores at once, whatever they do; whoever waits for one gets CoreLostError.

    For a program that must end: it may be called from a signal handler.
    """
    for process in list(_processes):
        process.kill()


class ProcessCore:
    """A core in a process of its own (`core.Core`).

    Every calling thread has a thread of that process that works for it. If a frame's memory is lent (`Frame.lent`),
    only its name is sent, and its file when the process asks for it, which it does once. The frame stays reserved until
    the process has stopped reading it. `make` is called in that process, with the arguments, and returns the core that
    does the work; it is pickled, as are questions and answers. Raises CoreLostError if the process has ended;
    exceptions of the core are raised here.
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
        self._made = False
        try:
            self._ask(make_core, make, *arguments)
            self._made = True
        except BaseException:
            self.close()
            raise

    def give_way(self, niceness: int) -> None:
        """Lower the priority of the thread, in that process, that works for the calling one."""
        self._ask(call, "give_way", niceness)

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        """Take a frame; the status also has the `pid` of the process. Raises OSError if the lent file is not open."""
        if frame.lent is not None:
            os.fstat(frame.lent.file)
        number = next(self._numbers)
        self._frames[number] = frame
        views = tuple((view.camera, view.fault) for view in frame.views)
        what = (frame.index, views, frame.lent) if frame.lent is not None else frame
        try:
            updated: Updated = self._ask(update, number, what, dict(speeds), f_vin, look=look)
        finally:
            if frame.lent is None:  # the process has a copy
                del self._frames[number]
        return dataclasses.replace(updated, status={**updated.status, "pid": self.pid})

    def picture(self, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """Both eyes' pictures of the newest frame, encoded in that process."""
        pair: EncodedPair = self._ask(call, "picture", view, viewer, encoding)
        return pair

    def retune(self, settings: Settings) -> None:
        """Use other settings from the next picture on; returns at once."""
        try:
            self._control.send(pickle.dumps(settings))
        except OSError as error:
            raise self._lost() from error

    def continues(self, cameras: Sequence[Camera]) -> bool:
        """Whether a source with these cameras goes on with the model of that process."""
        goes_on: bool = self._ask(call, "continues", tuple(cameras))
        return goes_on

    def begin_model(self) -> None:
        """Build the background model from the next frame on."""
        self._ask(call, "begin_model")

    def put_effect(self, name: str, effect: Effect, content: Any = None) -> None:
        """Add or change a 3D effect."""
        self._ask(call, "put_effect", name, effect, content)

    def remove_effect(self, name: str) -> None:
        """Remove a 3D effect."""
        self._ask(call, "remove_effect", name)

    def mesh(self, file_format: str, colours: str | None = None) -> bytes:
        """The background model as a file, made in that process."""
        data: bytes = self._ask(call, "mesh", file_format, colours)
        return data

    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a question about the background model, found in that process."""
        answer: dict[str, Any] = self._ask(call, "query", question, dict(arguments))
        return answer

    def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """The result of `work(core, *arguments)` in that process: for inspection."""
        return self._ask(run, work, *arguments)

    @property
    def held_frames(self) -> int:
        """The number of frames that are reserved because the process reads them."""
        return len(self._frames)

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    def close(self) -> None:
        """Close the core, and end the process; no call may be under way. If the last reference to this core is gone,
        the process ends without that."""
        if self._made:
            self._made = False
            with contextlib.suppress(CoreLostError):
                self._ask(call, "close")
        if self._end.detach():
            _end(self._control, self._process)
        self._lines = threading.local()

    def _ask(self, *work: Any, look: Look = dict) -> Any:
        message = pickle.dumps(work, protocol=5)
        try:
            line = self._line()
            line.send_bytes(message)
            while not isinstance(answer := pickle.loads(line.recv_bytes()), Answer):
                if isinstance(answer, FileQuestion):
                    self._hand_over(answer.file)
                else:
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

    def _hand_over(self, file: int) -> None:
        """Send an open file to the process."""
        with socket.socket(fileno=os.dup(self._lines.line.fileno())) as ours:
            socket.send_fds(ours, [b"file"], [file])

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
