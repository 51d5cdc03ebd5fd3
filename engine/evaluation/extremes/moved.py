"""The room anywhere in the world and at any scale: its pictures are those of the room at home."""

from __future__ import annotations

import io
from functools import partial

import numpy as np
import trimesh

from ...io.mesh_files import to_file
from ...rig.camera import Camera, Perspective, Pose
from .case import Case, Measured
from .pictures import Shot, against_home, take
from .room import CODING, Placement, rig, turned

__all__ = ["moved_cases"]

_EXTENT_M = 20.0  # size of the room
# Rounding as a share of the room's size: points, rays and hits are float32, relative to the rig's middle; the three
# roundings add up.
_SINGLE = 3 * 2.0**-24
_TARGET = Camera("target", Perspective.from_fov(80, 60, 1.4), turned((0.05, 0.11, 0.02), 4, 2, -3), CODING)


def moved_cases() -> list[Case]:
    """Cases with offsets up to 10 000 km, scales over eight powers of ten, and turns about arbitrary axes."""
    offsets = [
        Case("world origin away by", f"{offset:g} m", partial(_placed, Placement(pose=_offset(offset))))
        for offset in (1e3, 1e5, 1e6, 1e7)
    ]
    scales = [
        Case("scene scaled by", f"{scale:g}", partial(_placed, Placement(scale)))
        for scale in (1e-3, 1e-2, 0.1, 10.0, 1e3, 1e5)
    ]
    turns = [
        Case("scene turned by", f"{yaw:g}, {pitch:g}, {roll:g} degrees", partial(_placed, Placement(pose=pose)))
        for yaw, pitch, roll in ((90, 0, 0), (37, 20, 60), (180, -85, 11))
        for pose in [turned((10.0, 20.0, 30.0), yaw, pitch, roll)]
    ]
    files = [
        Case(f"model as .{kind}, away by", f"{offset:g} m", partial(_exported, kind, offset))
        for kind in ("glb", "ply")
        for offset in (0.0, 1e7)
    ]
    both = Placement(1e-2, turned((3e5, -2e6, 8e4), 123, -45, 67))
    all_three = Case("scaled, turned and away by", "1e-2, 2e6 m", partial(_placed, both))
    return [*offsets, *scales, *turns, all_three, *files]


def _offset(metres: float) -> Pose:
    return Pose((metres, -0.7 * metres, 0.3 * metres))


def _exported(kind: str, offset: float) -> list[Measured]:
    """The largest error of vertices in the model's file, against those of the model.

    `kind` is "glb" or "ply", `offset` the distance of the room in metres. The bound is single precision relative to the
    mesh's own extent.
    """
    _picture, engine = take(Shot(_TARGET, rig()), Placement(pose=_offset(offset)))
    mesh = engine.mesh()
    data = io.BytesIO(to_file(mesh, kind))
    read = trimesh.load_scene(data, file_type=kind, process=False).to_mesh()
    expected = mesh.vertices
    if kind == "glb":
        expected = np.stack([-expected[:, 1], expected[:, 2], -expected[:, 0]], axis=-1)
    largest = float(np.ptp(expected, axis=0).max())
    bound = 2.0**-24 * largest + float(np.spacing(abs(expected).max()))
    return [Measured(float(np.abs(read.vertices - expected).max()), bound, "m")]


def _placed(placement: Placement) -> list[Measured]:
    # Each position is rounded to double precision in the world, before the rig's middle is subtracted.
    world = 2.0 * float(np.spacing(max(map(abs, placement.pose.position)))) / placement.scale
    return against_home(Shot(_TARGET, rig()), placement, world + _SINGLE * _EXTENT_M)
