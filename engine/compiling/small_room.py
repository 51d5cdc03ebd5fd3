"""A wall, a table before it, someone who leaves, a chair that comes and goes, and light that fades: all that settings
past the paper's limits follow (`Settings.light_s`, `cull_stale`, `middle_layers`)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera, Perspective, Pose
from ..rig.depth import DepthCoding
from ..rig.frame import Frame, Texture, View

__all__ = ["small_room"]

_CAMERAS, _APART_M, _SIZE = 5, 0.6, (96, 64)
_WALL_M = 4.0
_FRAMES, _LEAVES, _COMES, _GOES = 60, 8, 16, 44  # frames; those in which someone leaves, and the chair comes and goes

Square = tuple[float, float, float, int]  # distance, place to the left, half a side, metres; luma


def small_room() -> Iterator[Frame]:
    """Its frames, as cameras in a row see it that look along x."""
    coding, lens = DepthCoding(0.5, 20.0, 16, has_invalid=True), Perspective.from_fov(*_SIZE, 1.2)
    places = [_APART_M * (k - (_CAMERAS - 1) / 2) for k in range(_CAMERAS)]
    cameras = [Camera(f"v{k}", lens, Pose((0.0, place, 0.0)), coding) for k, place in enumerate(places)]
    for index in range(_FRAMES):
        squares: list[Square] = [(2.5, -0.4, 0.25, 500)]
        if index < _LEAVES:
            squares.append((1.5, 0.2, 0.4, 700))
        if _COMES <= index < _GOES:
            squares.append((2.0, 0.5, 0.25, 800))
        fades = 1.0 - 0.4 * index / _FRAMES
        yield Frame(index, tuple(_look(camera, squares, fades) for camera in cameras))


def _look(camera: Camera, squares: list[Square], gain: float) -> View:
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    start = np.array(camera.pose.position)
    rays = camera.unproject(np.stack([u, v], -1), np.ones_like(u)) - start
    depth, luma = np.full(u.shape, _WALL_M), np.full(u.shape, 300.0)
    for x, y, half, code in squares:
        aside = np.abs(start[1:] + x * rays[..., 1:] - (y, 0.0))
        on = (aside < half).all(axis=-1)
        depth, luma = np.where(on, x, depth), np.where(on, code, luma)
    grey: npt.NDArray[np.uint16] = np.full((camera.height // 2, camera.width // 2), 512, np.uint16)
    texture = Texture((gain * luma).astype(np.uint16), grey, grey.copy())
    return View(camera, texture, camera.depth.codes(depth))
