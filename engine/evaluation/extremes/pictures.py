"""Pictures of a placed room, and their differences from the truth or from one another.

There are two oracles: the room itself, and the same picture of the room at home. Only *solid* pixels are compared.
A pixel is solid if no silhouette is near it in the picture, none is near the point's image in any camera, and some
camera shows the point. In all other pixels rounding may decide between two surfaces.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ...geometry.minification import level_for
from ...geometry.prepared_view import pixels_per_radian
from ...geometry.scene_scale import Scene
from ...pipeline.engine import Engine
from ...rig.camera import Camera, Perspective
from ...rig.frame import Frame
from ...rig.viewer import RenderedPicture
from ...settings import Settings
from ...support.array_types import B1, F64
from .case import Measured
from .room import HOME, Placement, Room, Sight

__all__ = ["Shot", "against_home", "against_truth", "take"]


_CALM_PX = 3  # least distance of silhouettes: a texel's footprint, and one pixel each for blending and smoothing
_CODE = 1.0  # two roundings, of a source's code and of the picture's, half a code each


@dataclass(frozen=True)
class Shot:
    """A picture of a room from a rig; everything is described as it stands at home.

    frames: how often the same frame is shown before the picture is taken. noise: the largest error of a pixel's depth
    as a share of its disparity; errors are evenly distributed.
    """

    target: Camera
    cameras: Sequence[Camera]
    room: Room = field(default_factory=Room)
    settings: Settings = field(default_factory=lambda: Settings.preset("balanced"))
    frames: int = 2
    noise: float = 0.0

    def frame(self) -> Frame:
        """The frame that the rig records, with noise."""
        rng, views = np.random.default_rng(5), []
        for view in self.room.frame(self.cameras).views:
            wrong = 1.0 + self.noise * rng.uniform(-1.0, 1.0, view.codes.shape)
            depth = view.camera.depth.depth(view.codes) / wrong
            views.append(dataclasses.replace(view, codes=view.camera.depth.codes(depth)) if self.noise else view)
        return Frame(0, tuple(views))


def take(shot: Shot, placement: Placement = HOME) -> tuple[RenderedPicture, Engine]:
    """The picture with the background model, and its engine; room, rig and target are placed in the world."""
    target, frame = placement.camera(shot.target), placement.frame(shot.frame())
    engine = Engine([view.camera for view in frame.views], shot.settings)
    for index in range(shot.frames):
        engine.update(dataclasses.replace(frame, index=index), {"viewer": target})
    return engine.render_camera(target, "viewer"), engine


def against_truth(shot: Shot, picture: RenderedPicture) -> list[Measured]:
    """Disparity and luma of a picture at home against the room's; raises ValueError if no pixel is solid.

    The mesh is within its tolerance (pixels of parallax at the rig's radius) of the coded depth. Surfaces may be moved
    by this tolerance, which a slope or a gradient turns into a difference in disparity or luma. Interpolation between
    texels, or their mean, adds half the curvature of the luma over a texel, in pixels of the picture.
    """
    truth = shot.room.look(shot.target)
    solid = _solid(shot, truth)
    if not solid.any():
        raise ValueError("solid pixels: none: expected some to compare")
    q = 1.0 / truth.depth
    along, across, texel = _moved(shot, truth)
    stretch = _stretch(shot.target) * pixels_per_radian(shot.target)
    luma_bound = _CODE + stretch * across * _steepest(truth.luma) + 0.5 * texel**2 * _sharpest(truth.luma)
    return [
        _worst(np.abs(picture.disparity - q), along + stretch * across * _steepest(q), solid, "1/m"),
        _worst(np.abs(picture.texture.y - truth.luma), luma_bound, solid, "codes"),
    ]


def _moved(shot: Shot, truth: Sight) -> tuple[F64, F64, F64]:  # [h, w] each
    """Bounds on how far the points that the target sees may be moved, and the length of a camera's texel there.

    Points may be moved along the target's rays (disparity, 1/m) and across them (radians). The texel's length is in
    pixels of the picture, at least 1. A camera's mesh is off along the camera's rays by its tolerance or the rounding
    of codes. With noise, its corners are off by as much as the noise, and pixels between corners by as much again.
    """
    scene = Scene.of(shot.cameras, shot.settings, shot.frame())
    points = _points(shot.target, truth)
    eye = np.linalg.norm(points - shot.target.pose.position, axis=-1)
    along, across, texel = np.zeros(eye.shape), np.zeros(eye.shape), np.ones(eye.shape)
    for camera in shot.cameras:
        distance = np.linalg.norm(points - camera.pose.position, axis=-1)
        off = max(scene.triangulation(camera, shot.settings).tolerance, camera.depth.step) + 2.0 * camera.depth.step
        off += 2.0 * shot.noise / distance
        moved = off * distance * distance  # metres
        area = np.linalg.norm(np.cross(points - camera.pose.position, points - shot.target.pose.position), axis=-1)
        along = np.maximum(along, moved / eye**2)
        across = np.maximum(across, moved * area / (distance * eye**2))
        reduced = 2.0 ** level_for(pixels_per_radian(camera) / pixels_per_radian(shot.target))
        texel = np.maximum(texel, reduced * _texel(camera, points))
    return along, across, texel


def against_home(shot: Shot, placement: Placement, rounding_m: float) -> list[Measured]:
    """A placed picture against the picture at home, and the model's triangles that survived in both.

    `rounding_m` is the rounding of positions on the way, in metres of the room; it may move the picture. Two roundings
    to whole codes may differ by one code. Triangles may be judged differently if their distance to a bound of delta is
    within the rounding.
    """
    (home, at_home), (away, elsewhere) = take(shot), take(shot, placement)
    truth = shot.room.look(shot.target)
    solid = _solid(shot, truth)
    q = 1.0 / truth.depth
    moved_px = rounding_m * q * _stretch(shot.target) * pixels_per_radian(shot.target)
    luma = np.abs(away.texture.y.astype(np.float64) - home.texture.y)
    disparity = np.abs(placement.scale * away.disparity.astype(np.float64) - home.disparity)
    counts = [engine.status()["background"]["s_pbs_valid"] for engine in (at_home, elsewhere)]
    assert at_home.model is not None
    judged = 2.0 * counts[0] * rounding_m / at_home.model.delta
    return [
        _worst(luma, _CODE + moved_px * _steepest(truth.luma), solid, "codes"),
        _worst(disparity, rounding_m * q * q + moved_px * _steepest(q) + 2.0**-22 * q, solid, "1/m"),
        Measured(abs(counts[1] - counts[0]), 1.0 + judged, "triangles"),
    ]


def _worst(error: F64, bound: F64, solid: B1, unit: str) -> Measured:
    """Error and bound of the solid pixel with the largest share of its bound."""
    at = np.argmax(np.where(solid, np.nan_to_num(error / bound, nan=np.inf), -1.0))
    return Measured(float(error.ravel()[at]), float(bound.ravel()[at]), unit)


def _solid(shot: Shot, truth: Sight) -> B1:  # [h, w]
    """Mask of the solid pixels: see the module's docstring."""
    points = _points(shot.target, truth)
    solid, shown = _calm(truth.surface, _CALM_PX), np.zeros(truth.surface.shape, bool)
    for camera in shot.cameras:
        sight = shot.room.look(camera)
        uv, depth = camera.project(points)
        with np.errstate(invalid="ignore"):
            inside = (depth > 0) & (uv >= 0).all(-1) & (uv[..., 0] < camera.width) & (uv[..., 1] < camera.height)
        x, y = (np.where(inside, c, 0).astype(int) for c in (uv[..., 0], uv[..., 1]))
        # A pixel of the picture may cover many pixels of the camera.
        reach = math.ceil(_CALM_PX * max(1.0, pixels_per_radian(camera) / pixels_per_radian(shot.target)))
        calm, same = _calm(sight.surface, reach)[y, x], sight.surface[y, x] == truth.surface
        solid &= ~inside | (calm & (same | (depth > sight.depth[y, x])))
        shown |= inside & same & (depth < 1.02 * sight.depth[y, x])
    result: B1 = solid & shown & (truth.surface >= 0)
    return result


def _points(camera: Camera, sight: Sight) -> F64:  # [h, w, 3]
    """The points of the room that a camera sees, metres."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    return camera.unproject(np.stack([u, v], axis=-1), np.where(np.isfinite(sight.depth), sight.depth, 1.0))


def _calm(surface: npt.NDArray[np.int64], reach: int) -> B1:
    """Mask of pixels with a single surface within `reach` pixels; what lies outside the picture is another surface."""
    size = 2 * reach + 1
    padded = np.pad(surface, reach, constant_values=-2)
    rows = np.lib.stride_tricks.sliding_window_view(padded, size, axis=0)
    low, high = (np.lib.stride_tricks.sliding_window_view(f(axis=-1), size, axis=1) for f in (rows.min, rows.max))
    calm: B1 = low.min(axis=-1) == high.max(axis=-1)
    return calm


def _texel(camera: Camera, points: F64) -> F64:  # [h, w, 3] -> [h, w]
    """Length of a camera's texel in a picture of these points, in pixels of the picture; 0 where there is no texel.

    It is the inverse of the least distance by which a step of one pixel moves the point's image in the camera.
    """
    uv, _depth = camera.project(points)
    turn = camera.width if camera.wraps else np.inf
    steps = []
    for axis in (0, 1):
        step = 0.5 * (np.roll(uv, -1, axis) - np.roll(uv, 1, axis))
        step[..., 0] -= turn * np.rint(step[..., 0] / turn) if np.isfinite(turn) else 0.0
        steps.append(step)
    (a, b), (c, d) = (np.moveaxis(step, -1, 0) for step in steps)
    sum2, area = a * a + b * b + c * c + d * d, a * d - b * c
    least2 = 0.5 * (sum2 - np.sqrt(np.maximum(sum2**2 - 4.0 * area**2, 0.0)))  # the smaller singular value's square
    with np.errstate(divide="ignore"):
        texel: F64 = np.nan_to_num(1.0 / np.sqrt(np.maximum(least2, 0.0)), nan=0.0)
    return texel


def _stretch(camera: Camera) -> F64:  # [h, w]
    """Pixels per radian in each pixel, relative to the middle of the picture."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    directions = camera.projection.directions(np.stack([u, v], axis=-1))
    if isinstance(camera.projection, Perspective):
        focal = np.array([camera.projection.fx, camera.projection.fy])
        larger = float(np.abs(focal).max() / np.sqrt(np.abs(focal).prod()))
        stretch: F64 = larger * (directions**2).sum(axis=-1)
    else:
        stretch = 1.0 / np.maximum(np.hypot(directions[..., 0], directions[..., 1]), 1e-3)
    return stretch


def _steepest(values: F64) -> F64:
    """The largest step between neighbours among the pixels within two of each pixel [h, w].

    It is infinite or nan where a value there is not finite.
    """
    steps = np.zeros(values.shape)
    for axis in (0, 1):
        step = np.abs(np.diff(values, axis=axis))
        pad = [(0, 0), (0, 0)]
        for side in ((0, 1), (1, 0)):
            pad[axis] = side
            steps = np.maximum(steps, np.pad(step, pad))
    return _largest_near(steps)


def _sharpest(values: F64) -> F64:
    """The largest second difference among the pixels within two of each pixel [h, w]."""
    bends = np.zeros(values.shape)
    for axis in (0, 1):
        bend = np.abs(np.diff(values, n=2, axis=axis))
        pad = [(0, 0), (0, 0)]
        pad[axis] = (1, 1)
        bends = np.maximum(bends, np.pad(bend, pad))
    return _largest_near(bends)


def _largest_near(values: F64) -> F64:
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2), (5, 5))
    largest: F64 = windows.max(axis=(2, 3))
    return largest
