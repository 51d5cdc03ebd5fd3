"""Small analytic scenes: a wall and a box in front of it, seen by perspective cameras in a row."""

from __future__ import annotations

import numpy as np
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, Texture, View

WALL_X, BOX_X = 4.0, 2.5
WALL_Y, BOX_Y = 300, 800  # luma codes
FAR_X, NEAR_X, POST_X = 6.0, 3.0, 1.5  # two walls, the nearer one with a window, and a post in front of them
FAR_Y, NEAR_Y, POST_Y = 700, 300, 900
WINDOW = 0.5  # half of the side of the square hole in the nearer wall
CODING = DepthCoding(0.5, 20.0, 16, has_invalid=True)


def camera_row(count=3, size=(96, 64), spacing=0.4, fov=1.2):
    """Cameras along y that look in direction x."""
    projection = Perspective.from_fov(*size, fov)
    return [
        Camera(f"v{i}", projection, Pose((0.0, spacing * (i - (count - 1) / 2), 0.0)), CODING) for i in range(count)
    ]


def see(camera, box_y=None, half=0.3, *, wall=True):
    """A view of the wall and, if `box_y` is given, of a square at BOX_X with half its side `half`, metres."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    start, rays = np.array(camera.pose.position), camera.unproject(np.stack([u, v], -1), np.ones_like(u))
    rays = rays - start
    depth, luma = np.full(u.shape, np.nan), np.full(u.shape, 0)
    if wall:
        depth, luma = (WALL_X - start[0]) / rays[..., 0], np.full(u.shape, WALL_Y)
    if box_y is not None:
        t = (BOX_X - start[0]) / rays[..., 0]
        at = start + t[..., None] * rays
        on_box = (np.abs(at[..., 1] - box_y) < half) & (np.abs(at[..., 2]) < half) & (t > 0)
        depth, luma = np.where(on_box, t, depth), np.where(on_box, BOX_Y, luma)
    return View(camera, texture_of(luma), camera.depth.codes(depth))


def texture_of(luma):
    """A texture with the given luma; Cb is half of it and Cr is half of it plus one."""
    luma = np.asarray(luma, np.uint16)
    chroma = luma[::2, ::2] // 2
    return Texture(luma, chroma, (chroma + 1).astype(np.uint16))


def frame(index, cameras, box_y=None, **options):
    """All cameras' views at one instant."""
    return Frame(index, tuple(see(camera, box_y, **options) for camera in cameras))


def wall_with_window(camera, post=False):
    """A view of two parallel walls, the nearer one with a square hole; with `post`, of a post in front of them, too."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    start, points = np.array(camera.pose.position), camera.unproject(np.stack([u, v], -1), np.ones_like(u))
    rays = points - start
    t = (NEAR_X - start[0]) / rays[..., 0]
    at = start + t[..., None] * rays
    hole = (np.abs(at[..., 1]) < WINDOW) & (np.abs(at[..., 2]) < WINDOW)
    depth, luma = np.where(hole, (FAR_X - start[0]) / rays[..., 0], t), np.where(hole, FAR_Y, NEAR_Y)
    if post:
        t = (POST_X - start[0]) / rays[..., 0]
        on_post = np.abs((start + t[..., None] * rays)[..., 1] - 0.42) < 0.08
        depth, luma = np.where(on_post, t, depth), np.where(on_post, POST_Y, luma)
    return View(camera, texture_of(luma), camera.depth.codes(depth))
