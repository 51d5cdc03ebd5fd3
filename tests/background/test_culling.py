"""Foreground culling: rays through pixels with complementary rays, and rays to triangles."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.culling import cull_unmarked, mark_missed, mark_pixels
from farside.engine.background.pbs import ProbableBackgroundSurface
from farside.engine.geometry.mesh import Mesh
from farside.engine.kernels.background.complementary_rays import OFFSETS
from farside.engine.kernels.background.culling import SAMPLES, SMALL_PX
from farside.engine.rig.camera import Equirectangular
from oracle import rays as slow_rays
from support.models import SETTINGS, model_of, pbi_of, sheets
from support.rooms import camera_row, frame

DELTAS = ((0.0, 0.0), (0.4, 0.0), (0.1, 0.06))  # metres, and an error of disparity: 0.24 to 0.54 m of what is seen here


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("delta", DELTAS)
def test_marks_are_those_of_the_slow_twin(stride, delta):
    cameras = camera_row(2, (24, 16))
    meshes = sheets(0)
    pbs = ProbableBackgroundSurface(70)
    pbs.set_static(0, 0, meshes[0])
    pbs.set_static(69, 69, meshes[1])
    pbs.set_progressive(1, 1, meshes[2])
    pbs.commit()
    starts = np.cumsum([0, *(len(m.points) for m in meshes)])
    points = np.concatenate([m.points for m in meshes])
    triangles = np.concatenate([m.triangles + s for m, s in zip(meshes, starts, strict=False)])
    for number, camera in zip((1, 66), cameras, strict=True):
        rays = mark_pixels(pbs, number, camera.packed(), stride, delta)
        rows = [min(r + stride // 2, 15) + 0.5 for r in range(0, 16, stride)]
        columns = [min(c + stride // 2, 23) + 0.5 for c in range(0, 24, stride)]
        uvs = [(u + du, v + dv) for v in rows for u in columns for du, dv in OFFSETS]
        expected = slow_rays.marked(camera, uvs, points, triangles, delta)
        word, bit = divmod(number, 64)
        found = np.concatenate([s.marks[:, word] >> np.uint64(bit) & np.uint64(1) for s in pbs.surfaces()])
        np.testing.assert_array_equal(found != 0, expected)
        assert len(uvs) <= rays <= 2 * len(uvs)
    assert 0 < expected.sum() < len(expected)
    assert cull_unmarked(pbs) == sum(np.count_nonzero(s.marks.sum(axis=1) == 0) for s in pbs.surfaces()) > 0


@pytest.mark.parametrize("share", [False, True])
@pytest.mark.parametrize("delta", DELTAS)
@pytest.mark.parametrize("size_px", [1.0, 9.0])  # of the triangles in their own picture
def test_marks_by_triangle_are_those_of_the_slow_twin(size_px, delta, share):
    cameras = camera_row(3, (24, 16))
    cameras[2] = dataclasses.replace(cameras[2], projection=Equirectangular(24, 16, (-1.2, 1.0), (-0.5, 0.5)))
    pbs = ProbableBackgroundSurface(70)
    meshes = [dataclasses.replace(m, uv=np.float32(2 * size_px) * m.points[:, 1:]) for m in sheets(3)]
    pbs.set_static(0, 0, meshes[0])
    pbs.set_static(69, 69, meshes[1])
    pbs.set_progressive(1, 1, meshes[2])
    pbs.commit()
    starts = np.cumsum([0, *(len(m.points) for m in meshes)])
    points = np.concatenate([m.points for m in meshes])
    triangles = np.concatenate([m.triangles + s for m, s in zip(meshes, starts, strict=False)])
    packed = np.zeros((70, 20))
    numbers = [66, 3, 68]
    packed[numbers] = [camera.packed() for camera in cameras]
    samples = SAMPLES if size_px > SMALL_PX else SAMPLES[:1]
    expected = slow_rays.background(cameras, samples, points, triangles, delta)  # [cameras, triangles]
    rays, left = mark_missed(pbs, numbers, packed, delta, share=share)
    marks = np.concatenate([s.marks for s in pbs.surfaces()])
    np.testing.assert_array_equal(marks.any(axis=1), expected.any(axis=0))
    for number, by_camera in zip(numbers, expected, strict=True):
        word, bit = divmod(number, 64)
        assert not np.any((marks[:, word] >> np.uint64(bit) & np.uint64(1) != 0) & ~by_camera)
    assert 0 < np.count_nonzero(marks.any(axis=1)) < len(triangles) < rays
    unmarked = np.count_nonzero(~marks.any(axis=1))
    for surface, missed in left:
        np.testing.assert_array_equal(missed, np.flatnonzero(~surface.marks.any(axis=1)))
    assert cull_unmarked(pbs, left) == unmarked
    assert cull_unmarked(pbs) == 0


@pytest.mark.parametrize("box_y", [0.0, 0.5])
def test_both_ways_of_culling_find_the_same_background(box_y):
    cameras = camera_row()
    depths = {}
    for stride in (0, 1):
        settings = dataclasses.replace(SETTINGS, culling_stride=stride)
        model, _first = model_of(cameras, frame(0, cameras, box_y=box_y), settings)
        for index in range(1, 5):
            model.update(frame(index, cameras, box_y=box_y + 0.15 * index))
        depths[stride] = pbi_of(model, cameras[1])[0]
    assert np.mean(~np.isclose(depths[0], depths[1], atol=0.01)) < 0.002


def test_triangles_smaller_than_the_stride_are_not_missed():
    cameras = camera_row(2)
    y, z = np.meshgrid(np.linspace(1, -1, 60), np.linspace(1, -1, 60))
    points = np.stack([np.full(y.shape, 4.0), y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    k = np.arange(3600).reshape(60, 60)
    a, b, c = k[:-1, :-1].ravel(), k[:-1, 1:].ravel(), k[1:, :-1].ravel()
    pbs = ProbableBackgroundSurface(2)
    pbs.set_static(0, 0, Mesh(points, np.zeros((3600, 2), np.float32), np.stack([a, c, b], -1).astype(np.int32)))
    pbs.commit()
    packed = np.array([camera.packed() for camera in cameras])
    assert mark_pixels(pbs, 0, packed[0], 8, (0.1, 0.0)) > 0
    assert np.count_nonzero(pbs.static[0].marks) < 1000
    mark_missed(pbs, (0, 1), packed, (0.1, 0.0))
    assert cull_unmarked(pbs) == 0
    for camera in (0, 1, 0, 1):
        mark_pixels(pbs, camera, packed[camera], 8, (0.1, 0.0))
        mark_missed(pbs, (camera, 1 - camera), packed, (0.1, 0.0))
        assert np.all(pbs.static[0].marks != 0)


def wall(distance, half=3.0, count=9):
    """A flat sheet of squares across the x axis."""
    y, z = np.meshgrid(np.linspace(half, -half, count), np.linspace(half, -half, count))
    points = np.stack([np.full(y.shape, distance), y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    k = np.arange(count**2).reshape(count, count)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).astype(np.int32)
    return Mesh(points, np.zeros((len(points), 2), np.float32), triangles)


@pytest.mark.parametrize(("delta", "found"), [(0.2, [True, True, False]), (0.06, [True, False, False])])
def test_complementary_rays_mark_what_lies_just_before_the_closest_hit(delta, found):
    """Three walls at 4, 3.95 and 3.7 m: rays from outside hit the first; only complementary rays reach the others."""
    camera = camera_row(1, (48, 32))[0]
    pbs = ProbableBackgroundSurface(3)
    for number, distance in enumerate((4.0, 3.95, 3.7)):
        pbs.set_static(number, number, wall(distance))
    pbs.commit()
    rays = mark_pixels(pbs, 0, camera.packed(), 1, (delta, 0.0))
    assert rays == 2 * 2 * 48 * 32  # each hits, and is followed by its complementary one
    middle = np.abs(pbs.static[0].mesh.points[pbs.static[0].mesh.triangles][..., 1:]).max(axis=(1, 2)) < 1.6
    assert middle.sum() > 8  # well inside the picture
    for number, expected in enumerate(found):
        marked = pbs.static[number].marks[:, 0] != 0
        assert marked[middle].all() if expected else not marked.any()
