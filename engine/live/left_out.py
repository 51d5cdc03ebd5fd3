"""The views that a live engine leaves out of frames: counted, and named once in the log."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..rig.frame import Fault
from ..rig.left_out import LeftOut

__all__ = ["LeftOutLog", "Settled"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Settled:
    """What became of a frame: whether it was shown (True), and why views were left out of it, by camera."""

    shown: bool
    left_out: Mapping[str, Fault] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return self.shown


class LeftOutLog(LeftOut):
    """Counts views that are left out, and logs the first of each camera and reason."""

    _waits = False  # whether the log says that the model waits

    def note(self, frame: int, faults: Mapping[str, Fault], *, waiting: bool = False) -> None:
        """Take note of the views that are left out of a frame; `waiting`: no frame has shown anything so far."""
        cameras: dict[Fault, list[str]] = {}
        for camera, fault in self.add(faults).items():
            cameras.setdefault(fault, []).append(camera)
        for fault, names in cameras.items():
            who = f"camera {names[0]}" if len(names) == 1 else f"cameras {', '.join(names)}"
            _log.warning("%s: left out of frame %d: %s (from now on only counted)", who, frame, fault)
        if waiting and not self._waits:
            self._waits = True
            _log.warning("frame %d: shows nothing; the model waits for the first frame with depth", frame)
