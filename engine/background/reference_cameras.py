"""The rig's reference cameras: where they stand, which have moved, and whose turn it is (sections 3.3.3 and 4.2)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..rig.camera import Camera
from ..rig.frame import Frame
from ..support.array_types import F64
from ..support.packed import CAMERA_SIZE

__all__ = ["ReferenceCameras"]


class ReferenceCameras:
    """Cameras as they stood when their current captures began; packed float64 [n, CAMERA_SIZE], relative to `origin`
    (metres, world), the same array for life."""

    def __init__(self, cameras: Sequence[Camera], origin: F64) -> None:
        self.cameras = tuple(cameras)
        self.packed = np.zeros((len(self.cameras), CAMERA_SIZE))
        self.moved: set[int] = set()  # since their current captures began
        self.next = 0  # whose turn comes first
        self._origin = origin

    def __len__(self) -> int:
        return len(self.cameras)

    def place(self, cameras: Sequence[Camera]) -> None:
        """All stand as they do now."""
        self.cameras = tuple(cameras)
        self.packed[:] = [camera.packed(self._origin) for camera in self.cameras]

    def place_one(self, index: int, camera: Camera) -> None:
        """One stands elsewhere, and no longer counts as moved."""
        self.cameras = (*self.cameras[:index], camera, *self.cameras[index + 1 :])
        self.packed[index] = camera.packed(self._origin)
        self.moved.discard(index)

    def fixed(self) -> list[int]:
        """The cameras that have not moved."""
        return [c for c in range(len(self.cameras)) if c not in self.moved]

    def fixed_in(self, frame: Frame) -> list[int]:
        """Those of them that do not stand elsewhere in a frame either."""
        return [c for c in self.fixed() if frame.views[c].camera.pose == self.cameras[c].pose]

    def note_moved(self, frame: Frame) -> set[int]:
        """The cameras that have moved with this frame, and not before."""
        moved = set(self.fixed()) - set(self.fixed_in(frame))
        self.moved |= moved
        return moved

    def next_group(self, n_update: int) -> list[int]:
        """The cameras whose turn it is (n_rv^update of them), each once a round."""
        count = len(self.cameras)
        ahead = [c for k in range(count) if (c := (self.next + k) % count) not in self.moved]
        group = ahead[:n_update]
        if group:
            self.next = (group[-1] + 1) % count
        return group

    def check(self, frame: Frame) -> None:
        """Raises ValueError where a frame is not of these cameras; their poses may be others."""
        names = tuple(view.camera.name for view in frame.views)
        if names != tuple(camera.name for camera in self.cameras):
            raise ValueError(f"frame {frame.index}: views {names}: expected one of each camera, in order")
        for view, camera in zip(frame.views, self.cameras, strict=True):
            if view.camera != _as_in(camera, view.camera):
                raise ValueError(f"frame {frame.index}: view {camera.name}: {view.camera}: expected {camera}")


def _as_in(camera: Camera, other: Camera) -> Camera:
    """A camera in the pose of another."""
    return dataclasses.replace(camera, pose=other.pose)
