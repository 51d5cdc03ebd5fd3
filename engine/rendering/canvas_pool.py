"""Canvases kept for the next picture of their size, because fresh memory costs more than drawing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from .warping import Canvas

__all__ = ["CanvasPool"]


class CanvasPool:
    """Lends canvases to threads, and keeps returned ones, up to `limit_bytes` together.

    Beyond that, it frees those that have not been used for the longest time: viewers with pictures of any size come and
    go.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._idle: list[Canvas] = []  # in the order in which they were used
        self._lock = threading.Lock()

    @property
    def idle_bytes(self) -> int:
        """Bytes of the canvases that are not lent."""
        with self._lock:
            return sum(canvas.nbytes for canvas in self._idle)

    @contextmanager
    def canvas(self, width: int, height: int) -> Iterator[Canvas]:
        """A canvas of `width` x `height` pixels for this thread only while the `with` block runs."""
        canvas = self._take(height, width) or Canvas(width, height)
        try:
            yield canvas
        finally:
            self._give_back(canvas)

    def _take(self, height: int, width: int) -> Canvas | None:
        with self._lock:
            for index in reversed(range(len(self._idle))):
                if self._idle[index].disparity.shape == (height, width):
                    return self._idle.pop(index)
        return None

    def _give_back(self, canvas: Canvas) -> None:
        with self._lock:
            self._idle.append(canvas)
            total = sum(idle.nbytes for idle in self._idle)
            while total > self._limit_bytes:
                total -= self._idle.pop(0).nbytes
