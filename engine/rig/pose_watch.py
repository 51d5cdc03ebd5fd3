"""Poses to which a camera cannot have moved: a tracker that loses itself jumps, mostly for one frame."""

from __future__ import annotations

import math

from .camera import Pose
from .frame import Fault

__all__ = ["PoseWatch", "not_a_pose"]

_SPEED, _TURN = 50.0, 30.0  # of a camera that somebody carries, throws or drives about: m/s, rad/s
_FARTHEST_M = 1e5  # from where it was announced: single precision, in which rays are cast, tells a centimetre there
_ROW = 3  # jumps in a row after which the camera does move like this


def not_a_pose(values: object) -> Fault:
    """The fault of a view whose pose is not finite; `values`: what was found instead."""
    return Fault("pose", f"{values}: expected finite numbers")


class PoseWatch:
    """Follows the poses of one camera with `fps` frames a second, and tells which are jumps. announced: where it was
    said to be before its first frame.

    A pose is believed if the camera can have come there from the last believed pose, or from the pose before, believed
    or not: a camera that has really been put elsewhere is left out of one frame only. A camera whose poses jump all the
    time moves so fast: after a few jumps faster movement is believed of it. No camera is believed to be 100 km from
    where it was announced.
    """

    def __init__(self, fps: float, announced: Pose | None = None) -> None:
        self._fps, self._announced = fps, announced
        self._believed: tuple[int, Pose] | None = None
        self._before: tuple[int, Pose] | None = None
        self._slack, self._row = 1.0, 0

    def jump(self, frame: int, pose: Pose) -> Fault | None:
        """The fault of the pose in a frame, whose number is larger than the one before; None if it is believed."""
        away = math.dist(self._announced.position, pose.position) if self._announced else 0.0
        if away > _FARTHEST_M:
            said = f"is {away:.3g} m from where the camera was announced"
            return Fault("pose", f"{said}: expected at most {_FARTHEST_M:g} m")
        believed, before, now = self._believed, self._before, (frame, pose)
        self._before = now
        if believed is not None and before is not None:
            haste = min(self._haste(believed, now), step := self._haste(before, now))
            if haste > self._slack:
                self._row += 1
                if self._row <= _ROW:
                    away = math.dist(believed[1].position, pose.position)
                    turned = math.degrees(_angle(believed[1], pose))
                    return Fault("pose", f"jumps by {away:.3g} m and {turned:.3g} degrees")
                self._slack = 2.0 * step
        self._believed, self._row = now, 0
        return None

    def _haste(self, start: tuple[int, Pose], end: tuple[int, Pose]) -> float:
        """How fast a camera moved, relative to the limits."""
        seconds = max(end[0] - start[0], 1) / self._fps
        away, turned = math.dist(start[1].position, end[1].position), _angle(start[1], end[1])
        return max(away / _SPEED, turned / _TURN) / seconds


def _angle(one: Pose, other: Pose) -> float:
    """The angle between two orientations, radians."""
    cosine = abs(sum(a * b for a, b in zip(one.orientation, other.orientation, strict=True)))
    return 2.0 * math.acos(min(cosine, 1.0))
