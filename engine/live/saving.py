"""Saving of a model while it is used: copied by the thread that updates it, written by another one."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

__all__ = ["ModelFiles", "Saver"]

_log = logging.getLogger(__name__)
_SHORTEST_S = 0.02  # between two looks at the clock


class ModelFiles(NamedTuple):
    """Files of a model: where it is saved and continued from (empty: nowhere), how often it is saved, seconds, and an
    earlier model that a new one begins with (empty: none)."""

    model: str = ""
    interval_s: float = 60.0
    seed: str = ""


class Writable(Protocol):
    """A copy of a model, to be written."""

    def write(self, path: Path) -> int:
        """Writes the file as a whole; returns the number of bytes. Raises OSError."""


class Saver:
    """Saves a model to a file every `interval_s` seconds, and at the end.

    `copy` copies the model, None if there is none; between two updates the thread that updates calls it, or the saver's
    own if no update comes. What could not be written is logged and counted, and tried again after the same time. Hold
    `updating` while the model changes.
    """

    def __init__(
        self, path: Path, interval_s: float, copy: Callable[[], Writable | None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.updating = threading.Lock()
        self.path, self._interval_s, self._copy, self._clock = path, interval_s, copy, clock
        self._begun = clock()  # of the newest copy
        self._unsaved, self._ended = False, False
        self._waiting: Writable | None = None  # for the thread that writes
        self._wake = threading.Event()
        self._status: dict[str, Any] = {
            "file": str(path), "saves": 0, "failures": 0, "bytes": 0, "copy_ms": 0.0, "write_ms": 0.0, "error": "",
        }  # fmt: skip
        self._thread = threading.Thread(target=self._run, name="farside-save", daemon=True)
        self._thread.start()

    def offer(self) -> None:
        """After an update, while `updating` is held: the model is copied now if it is time."""
        self._unsaved = True
        if self._is_due():
            self._take()

    def finish(self) -> None:
        """Waits until the model is saved as it is now; after this nothing is saved any more."""
        self._ended = True
        self._wake.set()
        self._thread.join()
        with self.updating:
            if self._unsaved or self._status["error"]:
                self._take()
                if self._waiting is None:
                    _log.warning("model %s: nothing was saved: there was no model yet", self.path)
        self._write()

    def status(self) -> dict[str, Any]:
        """The file, how often it was saved and could not be, and of the newest time the bytes, the milliseconds that
        the copy held up updates and those of writing, and what went wrong."""
        return dict(self._status)

    def _is_due(self) -> bool:
        return self._unsaved and self._waiting is None and self._clock() - self._begun >= self._interval_s

    def _take(self) -> None:
        start = time.perf_counter()
        self._begun, self._waiting, self._unsaved = self._clock(), self._copy(), False
        self._status["copy_ms"] = 1e3 * (time.perf_counter() - start)
        self._wake.set()

    def _run(self) -> None:
        while not self._ended:
            self._wake.wait(max(self._interval_s, _SHORTEST_S))
            self._wake.clear()
            if self._is_due():  # no update has come since
                with self.updating:
                    if self._is_due():
                        self._take()
            self._write()

    def _write(self) -> None:
        if self._waiting is None:
            return
        start = time.perf_counter()
        try:
            size = self._waiting.write(self.path)
        except Exception as error:  # a boundary: the model goes on, whatever the disk does
            self._status["failures"] += 1
            self._status["error"] = f"{type(error).__name__}: {error}"
            _log.error("model %s could not be saved: %s: %s", self.path, type(error).__name__, error)
        else:
            self._status["saves"] += 1
            self._status.update(bytes=size, write_ms=1e3 * (time.perf_counter() - start), error="")
        self._waiting = None
