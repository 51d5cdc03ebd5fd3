"""When the reference cameras last saw the surfaces of the model: how old is what the model says about a place?

For every 16 x 16 pixels of a capture's picture there is the number of the last frame in which its camera, from the
capture's pose, showed in their middle the surface of the maximum depth image, or one less than delta before it. While
someone stands there, the number stays as it is. What is left of older captures (section 4.2) was seen last when the
earliest of them began, at the latest; a late layer (`late_layers`) when it began. Of surfaces from a file, a seed or a
saved model, nothing is known until a camera sees them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..kernels.background.queried import COLUMNS, ROWS, SEEN_SIZE, STAMPS, STEP, note_seen
from ..kernels.base.memory import address_of
from ..kernels.base.tolerance import Delta
from ..rig.frame import Frame
from ..support.array_types import I32, I64
from .capture import Capture, Captures, Remains

__all__ = ["Sightings"]

_LOOKING = 6  # cameras that look in each frame; with 24, each does in every fourth frame


class Sightings:
    """The stamps of all captures. frame: the number of frames so far, which is the newest one's number.

    `note` is called by the thread that updates.
    """

    def __init__(self) -> None:
        self.frame = 0
        self.ready = False  # whether there is a model that can be asked
        self._known: dict[int, tuple[Capture | Remains, I32]] = {}  # by number; stamps [rows, columns]
        self._restored = False
        self._next = 0  # the first camera that looks in the next frame

    def resume(self) -> None:
        """The model is a saved one: its captures were seen nobody knows when."""
        self.ready = self._restored = True

    def note(self, frame: Frame, captures: Captures, cameras: Sequence[int], delta: Delta) -> None:
        """Notes what the views of a frame show; cameras: those that are where their current captures began, and are not
        left out of the frame."""
        self.frame += 1
        new = self._follow(captures)
        for c in {*self._turn(cameras), *new.intersection(cameras)}:
            capture = captures.current[c]
            stamps, image = self._known[capture.number][1], capture.image
            coding = image.camera.depth.packed()
            note_seen(frame.views[c].codes, image.codes, coding, delta, self.frame, stamps)
        self.ready, self._restored = True, False

    def _turn(self, cameras: Sequence[int]) -> list[int]:
        """The cameras that look in this frame, among those that can."""
        later, earlier = [c for c in cameras if c >= self._next], [c for c in cameras if c < self._next]
        looking = (later + earlier)[:_LOOKING]
        if looking:
            self._next = looking[-1] + 1
        return looking

    def _follow(self, captures: Captures) -> set[int]:
        """Gives new captures their stamps, and forgets those that are gone. Returns the cameras of new captures."""
        before, now, new = dict(self._known), dict[int, tuple[Capture | Remains, I32]](), set[int]()
        for capture in captures:
            known = before.get(capture.number)
            if known is not None and known[0] is capture:
                now[capture.number] = before.pop(capture.number)
            else:
                now[capture.number] = capture, self._new(capture)
                new.add(capture.camera)
        for capture, stamps in now.values():
            if isinstance(capture, Remains) and stamps[0, 0] < 0:
                gone = [_earliest(*each) for each in before.values() if each[0].camera == capture.camera]
                stamps[:] = min(gone, default=self.frame if capture.late else 0)
        self._known = now  # as a whole: other threads read it
        return new

    def _new(self, capture: Capture | Remains) -> I32:
        """A new capture's stamps: not yet seen; those of remains are -1 until they are known."""
        if isinstance(capture, Remains):
            return np.full((1, 1), 0 if self._restored else -1, np.int32)
        rows, columns = (-(-size // STEP) for size in capture.image.codes.shape)
        return np.zeros((rows, columns), np.int32)

    def table(self) -> tuple[I64, list[I32]]:
        """The stamps as kernels read them, [captures, SEEN_SIZE] by number of capture; and the arrays that must live as
        long as it is read. Any thread may call this."""
        known = self._known
        table = np.zeros((max(known, default=-1) + 1, SEEN_SIZE), np.int64)
        for number, (_capture, stamps) in known.items():
            table[number, [STAMPS, ROWS, COLUMNS]] = address_of(stamps), *stamps.shape
        return table, [stamps for _capture, stamps in known.values()]


def _earliest(capture: Capture | Remains, stamps: I32) -> int:
    """When the part of a capture that was seen longest ago was seen last; 0: nobody knows."""
    seen = stamps if isinstance(capture, Remains) else stamps[stamps > 0]
    return int(seen.min()) if seen.size else 0
