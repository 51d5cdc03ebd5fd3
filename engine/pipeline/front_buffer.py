"""The front buffer (paper Fig. 3): all that rendering reads, replaced as a whole when the next frame is ready."""

from __future__ import annotations

import dataclasses
import threading
from dataclasses import dataclass

from ..rendering.renderer import FrameContent, PreparedFrame
from ..settings import Settings
from ..support.array_types import F64

__all__ = ["DoubleBuffer", "FrontBuffer"]


@dataclass(frozen=True, slots=True)
class FrontBuffer:
    """One finished frame and how it is rendered; never changed, so that any number of threads may read it.

    frame_index: of the video frame. content: its reference views, each viewer's PBI, and delta; prepared: the same as
    the renderer has it. tones float64 [n, 4, 4]: of the views (`background.exposure`); None: they are not followed.
    """

    frame_index: int
    content: FrameContent
    prepared: PreparedFrame
    tones: F64 | None
    settings: Settings


class DoubleBuffer:
    """Double buffering (paper Fig. 3): pictures show the front buffer while the back end fills the next one.

    Any thread may read; the back-end thread swaps. Settings of the next picture come from any thread.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._front: FrontBuffer | None = None
        self._lock = threading.Lock()

    @property
    def settings(self) -> Settings:
        """Those of the next picture."""
        return self._settings

    @property
    def front(self) -> FrontBuffer | None:
        """What the next picture is rendered from; None before the first frame."""
        return self._front

    def retune(self, settings: Settings) -> None:
        """Render from the next picture on with other settings; ValueError for one that is fixed (`Settings`)."""
        with self._lock:
            settings.fixed_as_in(self._settings)
            self._settings = settings
            if self._front is not None:
                self._front = dataclasses.replace(self._front, settings=settings)

    def swap(self, back: FrontBuffer) -> None:
        """The back buffer is complete: it is the front buffer from now on, with the newest settings."""
        with self._lock:
            self._front = dataclasses.replace(back, settings=self._settings)
