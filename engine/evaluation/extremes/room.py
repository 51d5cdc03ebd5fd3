"""A furnished room that is known exactly: seen by any camera in float64, at any scale, anywhere in the world.

Everything is defined in the room's own frame, in metres, and *placed* in the world by a similarity. The views of a
placed rig have the same codes as those of the rig at home, so a picture can differ only by the engine's own errors.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ...rig.camera import Camera, Perspective, Pose
from ...rig.depth import DepthCoding
from ...rig.frame import Frame, Texture, View
from ...support.array_types import F64

__all__ = ["CODING", "HOME", "Placement", "Room", "Sight", "rig", "turned"]


CODING = DepthCoding(0.4, 20.0, 16, has_invalid=True)
_RIPPLE = 160.0  # the pattern's amplitude, luma codes
_WAVES = np.array([[1.7, 0.0, 1.1], [0.3, 1.9, -0.6], [-0.6, 0.9, 1.8]])  # rad/m: a pixel is a small part of a wave


@dataclass(frozen=True, slots=True)
class Sight:
    """The sight of a camera, for each pixel [h, w].

    depth: z-depth or range, as its projection measures it, metres; inf for nothing. luma: codes. surface: number of the
    box; -1 for nothing.
    """

    depth: F64
    luma: F64
    surface: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Room:
    """Boxes [n, 2, 3]: lower and upper corners, metres.

    The first box is the room, seen from inside. The others hang in it, so near to the `rig` that their silhouettes are
    depth edges everywhere. Without walls, rays that miss the other boxes see nothing.
    """

    boxes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = (
        ((-7.0, -6.0, -2.6), (9.0, 6.0, 2.8)),
        ((2.2, 0.5, -0.8), (2.9, 1.5, 0.3)),
        ((1.8, -1.7, -0.6), (2.3, -0.9, 0.5)),
    )
    walls: bool = True

    def look(self, camera: Camera) -> Sight:
        """The sight of a camera: the ray of each pixel's centre is intersected with every box (slab method)."""
        v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
        axes = camera.projection.directions(np.stack([u, v], axis=-1)) @ camera.pose.rotation().T
        eye = np.asarray(camera.pose.position)
        depth, surface = np.full(u.shape, np.inf), np.full(u.shape, -1)
        for number, (low, high) in enumerate(self.boxes):
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = (np.stack([low, high]) - eye)[:, None, None] / axes
            enters, leaves = np.nanmax(ends.min(axis=0), axis=-1), np.nanmin(ends.max(axis=0), axis=-1)
            if number == 0:
                found, t = self.walls & (leaves > 0), leaves
            else:
                found, t = (enters < leaves) & (enters > 0), enters
            found &= t < depth
            depth, surface = np.where(found, t, depth), np.where(found, number, surface)
        points = eye + np.where(surface < 0, 0.0, depth)[..., None] * axes
        return Sight(depth, np.where(surface < 0, 512.0, _luma(points, surface)), surface)

    def view(self, camera: Camera) -> View:
        """The view that a camera records."""
        sight = self.look(camera)
        depth = np.where(np.isfinite(sight.depth), sight.depth, np.nan)
        return View(camera, texture_of(sight.luma), camera.depth.codes(depth))

    def frame(self, cameras: Sequence[Camera], index: int = 0) -> Frame:
        """The frame that a rig records at one instant."""
        return Frame(index, tuple(self.view(camera) for camera in cameras))


def _luma(points: F64, surface: npt.NDArray[np.int64]) -> F64:
    phases = points @ _WAVES.T + 0.9 * surface[..., None]
    luma: F64 = 512.0 + _RIPPLE * np.sin(phases).mean(axis=-1)
    return luma


def texture_of(luma: F64) -> Texture:
    """A texture with the given luma (codes, [h, w]) and chroma derived from half the luma; h and w are even."""
    codes = np.rint(luma).astype(np.uint16)
    chroma = (codes[::2, ::2] // 2 + 256).astype(np.uint16)
    return Texture(codes, chroma, (1024 - chroma).astype(np.uint16))


@dataclass(frozen=True, slots=True)
class Placement:
    """Position, orientation and scale of the room in the world: world = pose (scale * room)."""

    scale: float = 1.0
    pose: Pose = field(default_factory=Pose)

    def camera(self, camera: Camera) -> Camera:
        """A camera of the room at its place in the world; its depth range is scaled too."""
        r = self.pose.rotation()
        place = np.asarray(self.pose.position) + r @ (self.scale * np.asarray(camera.pose.position))
        pose = Pose.from_matrix(np.column_stack([r @ camera.pose.rotation(), place]))
        coding = dataclasses.replace(
            camera.depth, near=self.scale * camera.depth.near, far=self.scale * camera.depth.far
        )
        return dataclasses.replace(camera, pose=pose, depth=coding)

    def frame(self, frame: Frame) -> Frame:
        """A frame of the room's cameras as the placed cameras record it: with the same codes."""
        return Frame(
            frame.index, tuple(dataclasses.replace(view, camera=self.camera(view.camera)) for view in frame.views)
        )


HOME = Placement()


def turned(position: tuple[float, float, float], yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Pose:
    """A pose from a position in metres and angles in degrees."""
    return Pose.from_euler(position, math.radians(yaw), math.radians(pitch), math.radians(roll))


def rig(size: tuple[int, int] = (144, 108), fov_deg: float = 90.0, coding: DepthCoding = CODING) -> list[Camera]:
    """Four cameras, a forearm apart and turned slightly outwards; their positions are no exact binary fractions."""
    projection = Perspective.from_fov(*size, math.radians(fov_deg))
    places = ((0.013, 0.31, 0.117), (0.007, -0.29, 0.103), (-0.011, 0.297, -0.151), (0.003, -0.303, -0.139))
    return [
        Camera(f"v{i}", projection, turned(place, 8.0 if place[1] > 0 else -8.0, 3.0 * i - 5.0, 1.5 * i), coding)
        for i, place in enumerate(places)
    ]
