"""Views that arrive: what is wrong with one camera's part of a frame leaves this view out, and ends nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from farside.engine.live.frame_memory import Planes
from farside.engine.rig.camera import Camera
from farside.engine.rig.frame import Fault, View
from farside.engine.rig.pose_watch import PoseWatch

from .pictures import decode_view
from .protocol import CloseCode, ProtocolError, ViewData

__all__ = ["MISSING", "Arrivals"]

MISSING = Fault("missing", "no view came")
_ANNOUNCED_MISSING = Fault("missing", "the source has no picture of it")
_REASONS = ("texture", "depth", "pose")  # fields of a view that reasons are named after; all others are "size"


class Arrivals:
    """Makes views of messages, for the cameras of one source with `fps` frames a second."""

    def __init__(self, cameras: Sequence[Camera], fps: float) -> None:
        self.cameras = {camera.name: camera for camera in cameras}
        self._watches = {camera.name: PoseWatch(fps, camera.pose) for camera in cameras}

    def check(self, message: ViewData) -> None:
        """Raises ProtocolError for a camera that was not announced."""
        if message.camera not in self.cameras:
            raise ProtocolError(CloseCode.CAMERA, "camera", message.camera, "one of " + ", ".join(self.cameras))

    def view(self, message: ViewData, memory: Mapping[str, Planes]) -> View:
        """The view in a message of an announced camera, put into that camera's planes of `memory`. It is left out if it
        is missing, damaged, or of another size, or if its pose is not finite or jumps."""
        if message.missing:
            return self.left_out(message.camera, memory, _ANNOUNCED_MISSING)
        if message.damage is not None:
            return self.left_out(message.camera, memory, _fault_of(message.damage))
        try:
            view = decode_view(message, self.cameras, memory)
        except ProtocolError as error:
            return self.left_out(message.camera, memory, _fault_of(error))
        jump = None if message.pose is None else self._watches[message.camera].jump(message.frame, message.pose)
        return dataclasses.replace(view, fault=jump) if jump else view

    def left_out(self, name: str, memory: Mapping[str, Planes], fault: Fault = MISSING) -> View:
        """A view of a camera that is left out; whatever is in its planes."""
        return View(self.cameras[name], *memory[name], fault)


def _fault_of(error: ProtocolError) -> Fault:
    field = error.field.partition(".")[0]
    reason = field if field in _REASONS else "size"
    return Fault(reason, str(error).removeprefix(f"{reason}: "))
