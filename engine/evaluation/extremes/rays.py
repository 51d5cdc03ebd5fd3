"""Rays do not leak; bad triangles neither hide nor show anything; culling does not depend on order, place or turn."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from ...background.culling import cull_unmarked, mark_missed
from ...background.pbs import ProbableBackgroundSurface
from ...background.ray_tracer import EmbreeTracer
from ...geometry.mesh import Mesh
from ...geometry.scene_scale import Scene
from ...geometry.triangulation import TriangulationOptions, triangulate
from ...kernels.background.rays import Tracer
from ...kernels.evaluation.leaks import count_leaks, farthest_distances
from ...rig.camera import Camera, Equirectangular, Perspective
from ...settings import Settings
from ...support.array_types import F64
from .case import Case, Measured
from .room import CODING, HOME, Placement, Room, rig, turned

__all__ = ["ray_cases"]


_PLAIN = Room(Room().boxes[:1])
_DELTA = 0.1
# A ray's origin, its direction and the distance to the hit are rounded to single precision: seven numbers.
_ROUNDINGS = 7 * 2.0**-24


def ray_cases() -> list[Case]:
    """Cases of watertightness, bad triangles, layers and culling."""
    leaks = [
        Case("leaks of a closed mesh", name, partial(_leaks, rays, scale, offset))
        for name, rays, scale, offset in (
            ("1 m, ten million rays", 3_400_000, 1.0, 0.0), ("1 mm, a million rays", 340_000, 1e-3, 0.0),
            ("10 km, a million rays", 340_000, 1e4, 0.0), ("1 m, 1 km away, a million rays", 340_000, 1.0, 1e3),
        )
    ]  # fmt: skip
    bad = [
        Case("farthest hit", name, partial(_farthest, kind))
        for kind, name in enumerate(("whole walls", "slivers", "with zero-area triangles", "with duplicates"))
    ]
    layers = [
        Case("layers apart by", f"{share:g} delta, culled", partial(_layers, share)) for share in (0.0, 0.1, 0.3, 1.5)
    ]
    turned_by = [Placement(pose=turned((0.0, 0.0, 0.0), 90)), Placement(1e-3, turned((3e6, -1e6, 2e5), 37, 20, 60))]
    return [
        *leaks, *bad, *layers,
        Case("culling", "cameras in other orders", _order),
        *(Case("culling", f"rig turned, {k + 1}", partial(_elsewhere, place)) for k, place in enumerate(turned_by)),
    ]  # fmt: skip


def _ball(rough: float) -> tuple[F64, npt.NDArray[np.int32]]:
    """Points and triangles of a closed, rough ball of radius 1 to 1 + rough: a grid of azimuths between two poles."""
    columns, rows = 160, 80
    k = np.arange(1, rows)
    theta, phi = np.meshgrid(np.pi * k / rows, 2 * np.pi * np.arange(columns) / columns, indexing="ij")
    ring = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    points = np.concatenate([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], ring.reshape(-1, 3)])
    points *= 1.0 + rough * np.random.default_rng(2).random((len(points), 1))
    number = 2 + np.arange(ring[..., 0].size).reshape(rows - 1, columns)
    right = np.roll(number, -1, axis=1)
    top, bottom = np.zeros(columns, int), np.ones(columns, int)
    parts = [
        np.stack(three, axis=-1).reshape(-1, 3)
        for three in (
            (top, number[0], right[0]),
            (bottom, right[-1], number[-1]),
            (number[:-1], number[1:], right[:-1]),
            (right[:-1], number[1:], right[1:]),
        )
    ]
    return points, np.concatenate(parts).astype(np.int32)


def _packed(pbs: ProbableBackgroundSurface) -> Tracer:
    """The ray tracer's scene in the form that kernels take."""
    assert isinstance(pbs.tracer, EmbreeTracer)
    return pbs.tracer.packed


def _surface_of(*meshes: Mesh) -> ProbableBackgroundSurface:
    pbs = ProbableBackgroundSurface(len(meshes))
    for number, mesh in enumerate(meshes):
        pbs.set_static(number, number, mesh)
    pbs.commit()
    return pbs


def _mesh(points: F64, triangles: npt.NDArray[np.int32]) -> Mesh:
    return Mesh(points.astype(np.float32), np.zeros((len(points), 2), np.float32), triangles)


def _leaks(rays: int, scale: float, offset: float) -> list[Measured]:
    """The number of rays that miss a closed ball from inside.

    `rays` rays each go towards insides, sides and corners of its triangles. `scale` is the ball's radius and `offset`
    its distance from the origin along each axis, metres.
    """
    points, triangles = _ball(0.1)
    mesh = _mesh(scale * points + offset, triangles)
    sphere = Equirectangular(8192, 4096, (-np.pi, np.pi), (-np.pi / 2, np.pi / 2))
    rng = np.random.default_rng(3)
    cameras = [
        Camera("eye", sphere, turned((float(x), float(y), float(z)), *rng.uniform(-180, 180, 3)), CODING).packed()
        for x, y, z in offset + scale * rng.uniform(-0.4, 0.4, (500, 3))
    ]
    pbs = _surface_of(mesh)
    missed = count_leaks(
        _packed(pbs), mesh.points, mesh.triangles, np.array(cameras), 7, rays
    )  # fmt: skip
    return [Measured(sum(missed), 0.0, "rays")]


def _walls(kind: int) -> Mesh:
    """The room's walls by `kind`: two triangles each (0), slivers (1), with zero-area triangles (2), all thrice (3)."""
    low, high = np.array(_PLAIN.boxes[0])
    points = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles: list[tuple[int, ...]] = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    if kind == 1:
        points, triangles = _cut_into_slivers(points, triangles)
    elif kind == 2:
        triangles += [t for a, b, c in triangles for t in ((a, a, b), (a, b, a), (c, c, c))]
    elif kind == 3:
        triangles = triangles + triangles + triangles[::-1]
    return _mesh(points, np.array(triangles, np.int32))


def _cut_into_slivers(points: F64, triangles: Sequence[tuple[int, ...]]) -> tuple[F64, list[tuple[int, ...]]]:
    """Fans from a corner of each triangle to points on its opposite side, some only 1e-5 of that side apart."""
    shares = np.sort(np.concatenate([np.geomspace(1e-5, 0.5, 40), 1.0 - np.geomspace(1e-5, 0.4, 40)]))
    out: list[tuple[int, ...]] = []
    for a, b, c in triangles:
        side = points[b] + shares[:, None] * (points[c] - points[b])
        numbers = [b, *range(len(points), len(points) + len(side)), c]
        points = np.concatenate([points, side])
        out += [(a, p, q) for p, q in itertools.pairwise(numbers)]
    return points, out


def _farthest(kind: int) -> list[Measured]:
    """The error of the farthest hits' distances to the walls of `kind`.

    The bound grows with the slant, because a sideways shift changes the distance more on a slanted wall.
    """
    camera = Camera("eye", Perspective.from_fov(192, 144, 2.2), turned((0.3, -0.7, 0.2), 33, 21, 12), CODING)
    pbs = _surface_of(_walls(kind))
    found = np.empty((camera.height, camera.width))
    farthest_distances(_packed(pbs), camera.packed(), found)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    rays = camera.unproject(np.stack([u, v], axis=-1), np.ones_like(u)) - camera.pose.position
    length = np.linalg.norm(rays, axis=-1)
    distance = _PLAIN.look(camera).depth * length
    at = np.asarray(camera.pose.position) + (distance / length)[..., None] * rays
    walls = np.abs(at[..., None, :] - np.array(_PLAIN.boxes[0]))  # [h, w, 2, 3]
    axis = walls.min(axis=2).argmin(axis=-1)
    slant = length / np.abs(np.take_along_axis(rays, axis[..., None], axis=-1)[..., 0])
    reach = float(np.linalg.norm(np.ptp(np.array(_PLAIN.boxes[0]), axis=0)))
    error = np.abs(np.where(np.isnan(found), np.inf, found) - distance)
    worst = np.argmax(error / slant)
    return [Measured(float(error.ravel()[worst]), float(_ROUNDINGS * reach * slant.ravel()[worst]), "m")]


def _layers(share: float) -> list[Measured]:
    """Triangles judged wrongly among two walls, one behind the other by `share` times delta.

    Both walls stay if they are at most half a delta apart along the rays (where distances are at most 1.5 times as long
    as at right angles); beyond that only the farther wall stays.
    """
    camera = Camera("eye", Perspective.from_fov(96, 72, 1.4), turned((0.0, 0.0, 0.0), 0), CODING)
    near, far = (_wall(camera, depth) for depth in (4.0, 4.0 + share * _DELTA))
    pbs = _surface_of(near, far)
    mark_missed(pbs, [0], np.array([camera.packed()] * 2), (_DELTA, 0.0))
    cull_unmarked(pbs)
    invalid = [int(np.count_nonzero(pbs.static[k].invalid)) for k in (0, 1)]
    expected = len(near.triangles) if share > 0.5 else 0
    return [Measured(abs(invalid[0] - expected) + invalid[1], 0.0, "triangles")]


def _wall(camera: Camera, depth: float) -> Mesh:
    codes = CODING.codes(np.full((camera.height, camera.width), depth))
    exact = triangulate(camera, codes, TriangulationOptions(1e-3, 1.0))
    points = exact.points * np.float32(depth) / exact.points[:, :1]
    return Mesh(points, exact.uv, exact.triangles)


def _culled(order: Sequence[int], placement: Placement = HOME) -> tuple[list[npt.NDArray[np.uint8]], float]:
    """For each view the flags of its mesh's triangles after culling (1: invalid), and delta in metres.

    The meshes of all views are one surface; the cameras mark it in the given order.
    """
    settings = Settings.preset("balanced")
    frame = placement.frame(Room().frame(rig()))
    cameras = [view.camera for view in frame.views]
    scene, pbs = Scene.of(cameras, settings, frame), ProbableBackgroundSurface(len(cameras))
    for number, view in enumerate(frame.views):
        mesh = triangulate(view.camera, view.codes, scene.triangulation(view.camera, settings), origin=scene.origin)
        pbs.set_static(number, number, mesh)
    pbs.commit()
    delta = _DELTA * placement.scale
    packed = np.array([camera.packed(scene.origin) for camera in cameras])
    mark_missed(pbs, order, packed, (delta, 0.0), share=len(order) % 2 == 0 and order[0] > 0)
    cull_unmarked(pbs)
    return [pbs.static[number].invalid for number in range(len(cameras))], delta


def _differences(one: list[npt.NDArray[np.uint8]], other: list[npt.NDArray[np.uint8]]) -> int:
    return sum(
        int(np.count_nonzero(a != b)) if a.shape == b.shape else max(len(a), len(b))
        for a, b in zip(one, other, strict=True)
    )


def _order() -> list[Measured]:
    """The number of triangles that are judged differently when the cameras mark in another order."""
    at_first, _delta = _culled((0, 1, 2, 3))
    if not sum(int(invalid.sum()) for invalid in at_first):
        raise ValueError("culled triangles: none: expected some")
    differing = [_differences(at_first, _culled(order)[0]) for order in ((3, 2, 1, 0), (2, 0, 3, 1))]
    return [Measured(max(differing), 0.0, "triangles")]


def _elsewhere(placement: Placement) -> list[Measured]:
    """The number of triangles that are judged differently when the whole scene stands elsewhere.

    It may happen where samples lie within rounding of a bound of delta, or of a triangle's or a picture's border.
    """
    home, delta = _culled((0, 1, 2, 3))
    count = sum(len(invalid) for invalid in home)
    rounding = _ROUNDINGS * 20.0 + 4.0 * float(np.spacing(max(map(abs, placement.pose.position)))) / placement.scale
    return [
        Measured(
            _differences(home, _culled((0, 1, 2, 3), placement)[0]), 1.0 + 2.0 * count * rounding / delta, "triangles"
        )
    ]
