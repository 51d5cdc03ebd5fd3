"""A program that ends soon after Ctrl-C or SIGTERM, whatever it is doing.

Python handles a signal in the main thread, between two of its instructions. While that thread compiles a kernel or
waits for another thread, many seconds pass until then. The part of the handler that is written in C runs at once,
though: it writes the signal's number into a pipe, which a thread reads (`signal.set_wakeup_fd`).
"""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

__all__ = ["PATIENCE_S", "end_soon", "set_patience", "unfinished"]

PATIENCE_S = 1.5  # for what a command does on its own to end in order
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_unfinished: set[Path] = set()
_patience_s = PATIENCE_S


def end_soon() -> None:
    """From now on Ctrl-C raises KeyboardInterrupt, SIGTERM and SIGHUP raise SystemExit, and each ends the process if it
    is still there after a while.

    What is `unfinished` is removed then, and child processes are killed. A second signal ends the process at once.
    Signals that are ignored stay so. Does nothing outside the main thread, which alone hears of signals.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    read, write = os.pipe()
    os.set_blocking(write, False)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _end)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(read,), name="farside-end", daemon=True).start()


def set_patience(seconds: float) -> None:
    """How long a command may take after a signal, in seconds (default PATIENCE_S)."""
    global _patience_s
    _patience_s = seconds


@contextlib.contextmanager
def unfinished(path: Path) -> Iterator[None]:
    """While the block runs, a folder is unfinished: it is removed at the block's end, however that comes."""
    _unfinished.add(path)
    try:
        yield
    finally:
        shutil.rmtree(path, ignore_errors=True)
        _unfinished.discard(path)


def _end(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _watch(read: int) -> None:
    """Wait for a signal, then for a second one or for the end of patience."""
    while (number := os.read(read, 1)[0]) not in _SIGNALS:
        pass
    while select.select([read], [], [], _patience_s)[0]:
        if os.read(read, 1)[0] in _SIGNALS:
            break
    for path in list(_unfinished):
        shutil.rmtree(path, ignore_errors=True)
    for child in _children():
        with contextlib.suppress(OSError):
            os.kill(child, signal.SIGKILL)
    if sys.stderr.isatty():
        os.write(sys.stderr.fileno(), b"\x1b[?25h\n")  # progress bars hide the cursor
    os._exit(128 + number)


def _children() -> list[int]:
    """Child processes, as far as the system tells (Linux)."""
    found: list[int] = []
    for path in Path("/proc/self/task").glob("*/children"):
        with contextlib.suppress(OSError):
            found += map(int, path.read_text().split())
    return found
