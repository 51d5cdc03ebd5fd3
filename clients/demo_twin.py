"""The demo's twin, which is played while another process makes it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from farside.engine.io.tmiv import Sequence, open_sequence
from farside.engine.io.whole_sequence import hidden_folder, is_being_written
from farside.engine.rig.camera import Camera, Pose
from farside.engine.rig.frame import Fault, Frame, Texture, View

__all__ = ["FIRST_VIEWS", "DemoTwin"]

T = TypeVar("T")
_POLL_S, _NICENESS = 0.2, 5
FIRST_VIEWS = 5  # views with which the first frame is shown already: as many as a picture is drawn from
_TO_COME = Fault("not made yet")


def _give_way(process: int) -> None:
    """Put a process, with all its threads, behind others: the rest of the twin can wait for kernels and pictures."""
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{process}/task").iterdir():
            os.setpriority(os.PRIO_PROCESS, int(thread.name), _NICENESS)


def _first_view(recording: Sequence, name: str) -> View:
    if recording.pictures_of(name) > 0:
        return recording.view(name, 0)
    return View.blank(recording.camera(name), _TO_COME)


class DemoTwin:
    """A recording that grows while it is made in a folder; an interrupted run leaves no folder.

    `start`, then `wait_for_cameras`, then use it as a `Recording`; `stop` at the end. Its first frame comes as soon as
    some views are there; those that are still to be made are left out of it.
    """

    def __init__(self, folder: Path, scale: float, total: int) -> None:
        self.folder, self.total = folder, total
        self._scale, self._done, self._started = scale, 0, False
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = threading.Event()
        self._told = tempfile.TemporaryFile()  # noqa: SIM115 # its error output, open as long as the twin
        self._open: Sequence | None = None
        self._place, self._opened = folder, 0.0  # of what is open: where, and when, s

    def start(self) -> None:
        """Start the process, unless another demo makes this twin now; it ends with the thread that calls this."""
        self._started = True
        if is_being_written(self.folder):
            return
        self._done, self._open = 0, None
        run = [sys.executable, "-m", "farside.clients.bound", str(os.getpid()), "farside.clients.cli"]
        options = ["--scale", str(self._scale), "--frames", str(self.total), "--no-truth"]
        command = [*run, "synth", "museum", str(self.folder), *options]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=self._told)

    async def wait_for_cameras(self) -> None:
        """Wait until its cameras are known; raises OSError as `check` does."""
        while not self._begun:
            self.check()
            await asyncio.sleep(_POLL_S / 4)

    @property
    def _begun(self) -> bool:
        with contextlib.suppress(ValueError, OSError):
            return bool(self.source_names)
        return False

    async def wait_for_first_views(self) -> None:
        """Wait until some views of the first frame are there; raises OSError as `check` does."""
        while self.first_views < FIRST_VIEWS:
            self.check()
            await asyncio.sleep(_POLL_S / 2)
        if self._process is not None:
            _give_way(self._process.pid)

    @property
    def first_views(self) -> int:
        """Views of the first frame that are there."""
        with contextlib.suppress(ValueError, OSError):
            return self._read(lambda recording: sum(recording.pictures_of(name) > 0 for name in recording.source_names))
        return 0

    def check(self) -> None:
        """Raises OSError, with what the process said last, if it has failed. Makes the twin if another demo has not, or
        if it is gone."""
        if self._started and not self.folder.is_dir() and (self._process is None or self._process.poll() == 0):
            self.start()
        self._complain()

    def _complain(self) -> None:
        if self._process is not None and self._process.poll():
            self._told.seek(0)
            last = self._told.read().decode(errors="replace").strip().splitlines()[-1:]
            why = last[0] if last else f"its process has ended with code {self._process.returncode}"
            raise OSError(f"twin: {self.folder}: expected to be made: {why}")

    def pause(self) -> None:
        """Let the process stand still until `go_on`."""
        if self._process is not None:
            self._process.send_signal(signal.SIGSTOP)

    def go_on(self) -> None:
        """End a pause."""
        if self._process is not None:
            self._process.send_signal(signal.SIGCONT)

    def stop(self) -> None:
        """End the process, if it still runs; who waits for its first frame gets an OSError."""
        self._stopped.set()
        if self._process is not None:
            self.go_on()
            self._process.terminate()
            self._process.wait()
        self._told.close()

    @property
    def done(self) -> int:
        """Frames that are there; never fewer than before."""
        with contextlib.suppress(ValueError, OSError):
            self._done = max(self._done, self._read(lambda recording: recording.frame_count))
        return self._done

    def _read(self, read: Callable[[Sequence], T]) -> T:
        """What a function reads from the recording, also while that moves to its place."""
        for _ in range(2):
            with contextlib.suppress(ValueError, OSError):
                return read(self._recording)
            self._open = None  # the files are looked for anew
        return read(self._recording)

    @property
    def _recording(self) -> Sequence:
        """The recording where it is now: it moves when it is complete. Raises ValueError if there is none yet."""
        hidden, now = hidden_folder(self.folder), time.monotonic()
        grown = self._place == hidden and now - self._opened > _POLL_S  # a recording knows the files that it has opened
        if self._open is None or grown or not self._place.is_dir():
            self._place = hidden if hidden.is_dir() else self.folder
            self._open, self._opened = open_sequence(self._place, growing=True), now
        return self._open

    @property
    def name(self) -> str:
        """The name for people."""
        return self._read(lambda recording: recording.name)

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self._read(lambda recording: recording.fps)

    @property
    def frame_count(self) -> int:
        """Frames that are there: at least one, of which views may be left out."""
        return max(1, self.done)

    @property
    def source_names(self) -> tuple[str, ...]:
        """The reference cameras."""
        return self._read(lambda recording: recording.source_names)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """All cameras."""
        return self._read(lambda recording: recording.camera_names)

    @property
    def truth_names(self) -> tuple[str, ...]:
        """The virtual cameras with ground truth."""
        return self._read(lambda recording: recording.truth_names)

    def camera(self, name: str, frame: int = 0) -> Camera:
        """A camera."""
        return self._read(lambda recording: recording.camera(name, frame))

    def poses(self, name: str) -> list[Pose] | None:
        """None: all cameras are fixed."""
        return self._read(lambda recording: recording.poses(name))

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        """The reference views of one instant. It waits for some views of the first one; those that are not made then
        are left out. If the twin was lost with another demo, which made it, the nearest frame of the one that
        `check` begins comes.

        Raises OSError as `check` does, and if it was stopped meanwhile; ValueError or OSError for a whole twin that
        cannot be read."""
        while True:
            try:
                frame = self._frame_now(index, names)
            except (ValueError, OSError):
                self._complain()  # why it is not there, if that is known
                if self.folder.is_dir():
                    raise
                frame = None
            if frame is not None:
                return frame
            self._complain()
            if self._stopped.wait(_POLL_S / 2):
                raise OSError(f"twin: {self.folder}: expected to be made: stopped")

    def _frame_now(self, index: int, names: Iterable[str] | None) -> Frame | None:
        """A frame, or the newest one if it is not made yet; None: there is none yet."""
        wanted = self.source_names if names is None else tuple(names)
        if self.done > 0:
            return self._read(lambda recording: recording.frame(min(index, recording.frame_count - 1), wanted))
        if self.first_views >= FIRST_VIEWS:
            return self._read(lambda recording: Frame(0, tuple(_first_view(recording, name) for name in wanted)))
        return None

    def frames(self, start: int = 0, stop: int | None = None, names: Iterable[str] | None = None) -> Iterator[Frame]:
        """Frames in order, as far as they are there when the iterator reaches them."""
        index, wanted = start, None if names is None else tuple(names)
        while index < (self.frame_count if stop is None else stop):
            yield self.frame(index, wanted)
            index += 1

    def texture(self, name: str, frame: int) -> Texture:
        """A camera's picture."""
        return self._read(lambda recording: recording.texture(name, frame))
