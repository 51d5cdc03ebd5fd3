"""A room with a pilaster, a projector with three discs, and a cube, for tests of 3D effects."""

from __future__ import annotations

import io
import math

import numpy as np
from farside.engine.io.coloured_meshes import ColouredMesh
from farside.engine.io.mesh_files import to_file
from farside.engine.rig.camera import Perspective, Pose
from farside.engine.rig.frame import Frame, View
from PIL import Image
from support.rooms import BOX_X, BOX_Y, WALL_X, WALL_Y, texture_of

PILASTER = (3.0, WALL_X), (0.2, 0.6)  # x and y: it stands out of the wall, and nobody sees behind it
DISCS = ((40.0, 30.0), (100.0, 60.0), (165.0, 85.0))  # of the picture, pixels from its upper left corner
RADIUS = 7.0
PICTURE = 200, 120


def directions(camera):
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    start = np.array(camera.pose.position)
    return start, camera.unproject(np.stack([u, v], -1), np.ones_like(u)) - start


def depth_of_box(start, rays, low, high):
    """Depth [h, w] at which rays enter a box, infinity where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - start) / rays, (high - start) / rays
    enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)


def room(camera, *, pilaster=False, person_y=None, half=0.3):
    """Depth and luma [h, w] of the wall, with a pilaster and a person (a square before it) if asked for."""
    start, rays = directions(camera)
    depth = (WALL_X - start[0]) / rays[..., 0]
    luma = np.full(depth.shape, WALL_Y)
    if pilaster:
        (x0, x1), (y0, y1) = PILASTER
        near = depth_of_box(start, rays, np.array([x0, y0, -9.0]), np.array([x1, y1, 9.0]))
        luma, depth = np.where(near < depth, 420, luma), np.minimum(near, depth)
    if person_y is not None:
        t = (BOX_X - start[0]) / rays[..., 0]
        at = start + t[..., None] * rays
        on = (np.abs(at[..., 1] - person_y) < half) & (np.abs(at[..., 2]) < half)
        depth, luma = np.where(on, t, depth), np.where(on, BOX_Y, luma)
    return depth, luma


def frame(index, cameras, **options):
    views = []
    for camera in cameras:
        depth, luma = room(camera, **options)
        views.append(View(camera, texture_of(luma), camera.depth.codes(depth)))
    return Frame(index, tuple(views))


def discs():
    """White discs on a transparent picture, uint8 [h, w, 4]."""
    w, h = PICTURE
    v, u = np.mgrid[0:h, 0:w] + 0.5
    away = np.min([np.hypot(u - x, v - y) for x, y in DISCS], axis=0)
    rgba = np.full((h, w, 4), 255, np.uint8)
    rgba[..., 3] = np.rint(255 * np.clip(RADIUS + 0.5 - away, 0.0, 1.0))
    return rgba


def white():
    return np.full((60, 80, 4), 255, np.uint8)


def on_the_wall(pose, fov, places):
    """Points [n, 3] of the wall at which a projector of the pictures' size throws places of its picture."""
    projection = Perspective.from_fov(*PICTURE, fov)
    rays = projection.directions(np.array(places)) @ pose.rotation().T
    start = np.array(pose.position)
    return start + ((WALL_X - start[0]) / rays[:, 0])[:, None] * rays


def png(rgba):
    file = io.BytesIO()
    Image.fromarray(rgba).save(file, "PNG")
    return file.getvalue()


CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
     (1, 5, 7), (1, 7, 3)],
    np.int32,
)  # fmt: skip


def cube_glb(colours=None):
    """A cube of 2 m around its origin as a GLB file; its corners have all colours, or the given ones."""
    colours = 0.5 + 0.5 * CUBE if colours is None else colours
    return to_file(ColouredMesh(CUBE, FACES, np.asarray(colours, np.float32)), "glb")


def looking_at_the_wall(y=0.0, z=0.0):
    """A pose whose x axis meets the wall in its middle."""
    return Pose.from_euler((0.0, y, z), math.atan2(-y, WALL_X), math.atan2(z, math.hypot(y, WALL_X)), 0.0)
