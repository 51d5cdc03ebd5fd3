"""The front buffer (paper Fig. 3): all data that rendering reads, replaced as a whole when the next frame is ready."""

from __future__ import annotations

import dataclasses
import threading
from dataclasses import dataclass

from ..rendering.effects import Effects
from ..rendering.renderer import FrameContent, PreparedFrame
from ..settings import Settings
from ..support.array_types import F64

__all__ = ["DoubleBuffer", "FrontBuffer"]


@dataclass(frozen=True, slots=True)
class FrontBuffer:
    """One finished frame and the settings for rendering it. It never changes, so any number of threads may read it.

    frame_index: of the video frame. content: its reference views, each viewer's PBI, and delta; prepared: the same,
    prepared by the renderer. tones float64 [n, 4, 4]: of the views (`background.exposure`); None: exposure is not
    followed. effects: what pictures show besides the frame; None: nothing.
    """

    frame_index: int
    content: FrameContent
    prepared: PreparedFrame
    tones: F64 | None
    settings: Settings
    effects: Effects | None = None


class DoubleBuffer:
    """Double buffering (paper Fig. 3): pictures show the front buffer while the back end fills the next one.

    Any thread may read, and may set the settings of the next picture; the back-end thread swaps.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._front: FrontBuffer | None = None
        self._lock = threading.Lock()

    @property
    def settings(self) -> Settings:
        """The settings of the next picture."""
        return self._settings

    @property
    def front(self) -> FrontBuffer | None:
        """The front buffer, from which the next picture is rendered; None before the first frame."""
        return self._front

    def retune(self, settings: Settings) -> None:
        """Use other settings from the next picture on; ValueError if a setting differs that is not in `PER_PICTURE`."""
        with self._lock:
            settings.fixed_as_in(self._settings)
            self._settings = settings
            if self._front is not None:
                self._front = dataclasses.replace(self._front, settings=settings)

    def show(self, effects: Effects | None) -> None:
        """Show other effects from the next picture on, until the next swap."""
        with self._lock:
            if self._front is not None:
                self._front = dataclasses.replace(self._front, effects=effects)

    def swap(self, back: FrontBuffer) -> None:
        """Make the complete back buffer the front buffer, with the newest settings."""
        with self._lock:
            self._front = dataclasses.replace(back, settings=self._settings)
