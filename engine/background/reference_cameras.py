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
    (metres, world), is the same array for life.

    moved: the cameras that are elsewhere in the newest frame; moving: those that have moved in any frame so far;
    unseen: those that were left out of all frames so far, whose captures are blank.
    """

    def __init__(self, cameras: Sequence[Camera], origin: F64) -> None:
        self.cameras = tuple(cameras)
        self.packed = np.zeros((len(self.cameras), CAMERA_SIZE))
        self.moved: set[int] = set()
        self.moving: set[int] = set()
        self.unseen: set[int] = set()
        self.next = 0  # whose turn comes first
        self._origin = origin

    def __len__(self) -> int:
        return len(self.cameras)

    def place(self, cameras: Sequence[Camera]) -> None:
        """Sets the poses of all cameras."""
        self.cameras = tuple(cameras)
        self.packed[:] = [camera.packed(self._origin) for camera in self.cameras]

    def place_one(self, index: int, camera: Camera) -> None:
        """Sets one camera to its new pose, in which it begins a capture."""
        self.cameras = (*self.cameras[:index], camera, *self.cameras[index + 1 :])
        self.packed[index] = camera.packed(self._origin)
        self.moved.discard(index)
        if index in self.unseen:
            self.unseen.discard(index)
        else:
            self.moving.add(index)

    def still(self) -> list[int]:
        """The cameras that are in the newest frame where their current captures began."""
        return [c for c in range(len(self.cameras)) if c not in self.moved and c not in self.unseen]

    def still_in(self, frame: Frame) -> list[int]:
        """The cameras that are in this frame where their current captures began; one that is left out of it is where it
        was."""
        still, views = self.still(), frame.views
        return [
            c for c, camera in enumerate(self.cameras)
            if c not in self.unseen and (views[c].camera.pose == camera.pose if views[c].there else c in still)
        ]  # fmt: skip

    def seen_in(self, frame: Frame) -> list[int]:
        """The cameras that are not left out of this frame and have a capture."""
        return [c for c in frame.there if c not in self.unseen]

    def note_moved(self, frame: Frame) -> None:
        """Notes which cameras are elsewhere in the newest frame."""
        self.moved = set(range(len(self.cameras))) - set(self.still_in(frame)) - self.unseen
        self.moving |= self.moved

    def asked_after(self, group: Sequence[int]) -> list[int]:
        """The cameras outside a group in the order in which they are asked for marks; moving ones come last, because
        the marks of the others are renewed more often."""
        others = [c for c in range(len(self.cameras)) if c not in group and c not in self.unseen]
        return sorted(others, key=lambda c: c in self.moving)

    def next_group(self, n_update: int, seen: Sequence[int]) -> list[int]:
        """The cameras whose turn it is (n_rv^update of them) among those `seen_in` the frame; each of these has one
        turn per round, and a camera that is left out waits for the next round."""
        count = len(self.cameras)
        ahead = [c for k in range(count) if (c := (self.next + k) % count) in seen]
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
