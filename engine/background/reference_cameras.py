"""The rig's reference cameras: their poses, which of them have moved, and whose turn it is (sections 3.3.3 and 4.2)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..rig.camera import Camera
from ..rig.frame import Frame, View
from ..support.array_types import F64
from ..support.packed import CAMERA_SIZE

__all__ = ["ReferenceCameras"]


class ReferenceCameras:
    """Cameras in the poses in which their current captures began; packed float64 [n, CAMERA_SIZE], relative to `origin`
    (metres, world), is the same array for life."""

    def __init__(self, cameras: Sequence[Camera], origin: F64) -> None:
        self.cameras = tuple(cameras)
        self.packed = np.zeros((len(self.cameras), CAMERA_SIZE))
        self.moved: set[int] = set()  # since their current captures began
        self.next = 0  # whose turn comes first
        self._origin = origin

    def __len__(self) -> int:
        return len(self.cameras)

    def place(self, cameras: Sequence[Camera]) -> None:
        """Sets the poses of all cameras."""
        self.cameras = tuple(cameras)
        self.packed[:] = [camera.packed(self._origin) for camera in self.cameras]

    def place_one(self, index: int, camera: Camera) -> None:
        """Sets one camera to its new pose; it no longer counts as moved."""
        self.cameras = (*self.cameras[:index], camera, *self.cameras[index + 1 :])
        self.packed[index] = camera.packed(self._origin)
        self.moved.discard(index)

    def fixed(self) -> list[int]:
        """The cameras that have not moved."""
        return [c for c in range(len(self.cameras)) if c not in self.moved]

    def fixed_in(self, frame: Frame) -> list[int]:
        """The cameras that have not moved before, nor in this frame."""
        return [c for c in self.fixed() if frame.views[c].camera.pose == self.cameras[c].pose]

    def note_moved(self, frame: Frame) -> set[int]:
        """Notes and returns the cameras that have moved in this frame and not before."""
        moved = set(self.fixed()) - set(self.fixed_in(frame))
        self.moved |= moved
        return moved

    def next_group(self, n_update: int) -> list[int]:
        """The cameras whose turn it is (n_rv^update of them); each has one turn per round."""
        count = len(self.cameras)
        ahead = [c for k in range(count) if (c := (self.next + k) % count) not in self.moved]
        group = ahead[:n_update]
        if group:
            self.next = (group[-1] + 1) % count
        return group

    def check_one(self, index: int, view: View) -> None:
        """Raises ValueError for a view that is not of camera number `index`; its pose may be another."""
        if not 0 <= index < len(self.cameras):
            raise ValueError(f"camera {index}: expected 0 to {len(self.cameras) - 1}")
        if view.camera != _as_in(self.cameras[index], view.camera):
            raise ValueError(f"view {view.camera.name}: {view.camera}: expected {self.cameras[index]}")

    def check(self, frame: Frame) -> None:
        """Raises ValueError if a frame is of other cameras; poses may differ."""
        names = tuple(view.camera.name for view in frame.views)
        if names != tuple(camera.name for camera in self.cameras):
            raise ValueError(f"frame {frame.index}: views {names}: expected one of each camera, in order")
        for view, camera in zip(frame.views, self.cameras, strict=True):
            if view.camera != _as_in(camera, view.camera):
                raise ValueError(f"frame {frame.index}: view {camera.name}: {view.camera}: expected {camera}")


def _as_in(camera: Camera, other: Camera) -> Camera:
    """A camera in the pose of another."""
    return dataclasses.replace(camera, pose=other.pose)
