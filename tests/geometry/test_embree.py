from __future__ import annotations

import numba
import numpy as np
import pytest
from farside.engine.geometry.embree import EmbreeError, MarkQuery, RayScene, intersect_address, occluded_address
from farside.engine.kernels.background.intersect import intersect1
from farside.engine.kernels.background.ray_hit import INVALID_ID
from farside.engine.kernels.background.rays import BESIDE_PX, Tracer, farthest_hit, is_free
from farside.engine.kernels.base.memory import address_of
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.support import runtime
from oracle.rays import farthest, hit_distances

CODING = DepthCoding(0.1, 100.0)


@numba.njit(parallel=True, nogil=True)
def farthest_hits(tracer, camera, uv, result):
    for i in numba.prange(len(uv)):
        distance, _u, _v, geometry, primitive, _length = farthest_hit(tracer, camera, uv[i, 0], uv[i, 1])
        result[i, 0], result[i, 1], result[i, 2] = distance, geometry, primitive


@numba.njit
def first_hit(function, scene, query, origin, direction):
    return intersect1(
        function, scene, query, origin[0], origin[1], origin[2], direction[0], direction[1], direction[2],
        np.float32(0.0), np.float32(1e6),
    )  # fmt: skip


@numba.njit
def free_rays(tracer, origins, directions, far, result):
    for i in range(len(origins)):
        (ox, oy, oz), (dx, dy, dz) = origins[i], directions[i]
        result[i] = is_free(tracer, ox, oy, oz, dx, dy, dz, far)


def height_field(n, depth, seed=0):
    """A rough square sheet of n x n points around the x axis, metres; and its triangles."""
    rng = np.random.default_rng(seed)
    y, z = np.meshgrid(np.linspace(2, -2, n), np.linspace(2, -2, n))
    points = np.stack([depth + 0.2 * rng.random((n, n)), y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    return points, triangles.astype(np.int32)


def scene_of(*meshes):
    scene, flags = RayScene(), []
    for i, (points, triangles) in enumerate(meshes):
        flags.append(np.zeros(len(triangles), np.uint8))
        scene.set(i, points, triangles, flags[-1])
    scene.commit()
    return scene, flags


def tracer_of(scene, bounds):
    return Tracer(intersect_address(), occluded_address(), scene.address, bounds)


def cast(scene, camera, uv):
    result = np.empty((len(uv), 3))
    bounds = scene.bounds() + np.array([[-0.01], [0.01]])
    farthest_hits(tracer_of(scene, bounds), camera.packed(), np.asarray(uv, float), result)
    return result


@pytest.mark.parametrize("lasting", [False, True])
def test_rays_meet_the_same_with_either_hierarchy(lasting):
    points, triangles = height_field(40, 2.0)
    scene, invalid = RayScene(), np.zeros(len(triangles), np.uint8)
    invalid[::3] = 1
    scene.set(0, points, triangles, invalid, lasting=lasting)
    scene.commit()
    camera = Camera("c", Perspective.from_fov(32, 32, 0.6), Pose(), CODING)
    found = cast(scene, camera, np.random.default_rng(0).uniform(4, 28, (300, 2)))
    other, flags = scene_of((points, triangles))
    flags[0][:] = invalid
    expected = cast(other, camera, np.random.default_rng(0).uniform(4, 28, (300, 2)))
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert 0.5 < (found[:, 0] > 0).mean() < 0.9


def test_the_threading_layer_is_tbb():
    runtime.require_tbb()
    assert numba.threading_layer() == "tbb"


def test_thread_count_is_bounded():
    assert 1 <= runtime.thread_count() <= numba.config.NUMBA_NUM_THREADS
    with pytest.raises(ValueError, match="threads: 0: expected 1 to"):
        runtime.set_thread_count(0)


@pytest.mark.parametrize(
    "projection",
    [
        Perspective.from_fov(64, 48, 1.2),
        Perspective(64, 48, -50.0, 45.0, 20.0, 30.0),
        Equirectangular(64, 48, (-1.0, 1.0), (-0.8, 0.7)),
    ],
)
def test_farthest_hits_are_those_of_brute_force(projection):
    camera = Camera("c", projection, Pose.from_euler((-0.3, 0.2, -0.1), 0.1, -0.05, 0.2), CODING)
    near, far = height_field(6, 2.0), height_field(5, 3.0, seed=1)
    scene, _flags = scene_of(near, far)
    rng = np.random.default_rng(2)
    uv = rng.uniform((0, 0), (64, 48), (200, 2))
    hits = cast(scene, camera, uv)
    points = np.concatenate([near[0], far[0]])
    triangles = np.concatenate([near[1], far[1] + len(near[0])])
    found = 0
    for (u, v), (distance, geometry, primitive) in zip(uv, hits, strict=True):
        expected, triangle = farthest(camera, u, v, points, triangles)
        if triangle < 0:  # a ray that hits nothing is compared a little to the side
            expected, triangle = farthest(camera, u + BESIDE_PX, v - BESIDE_PX, points, triangles)
        if triangle < 0:
            assert distance < 0
            continue
        found += 1
        assert distance == pytest.approx(expected, rel=1e-5)
        assert geometry * len(near[1]) + primitive == triangle
    assert found > 50


def test_no_ray_leaks_through_edges_and_corners():
    points, triangles = height_field(20, 2.0)
    scene, _flags = scene_of((points, triangles))
    camera = Camera("c", Perspective.from_fov(100, 100, 1.0), Pose(), CODING)
    middles = 0.5 * (points[triangles[:, 0]] + points[triangles[:, 1]])
    uv, _depth = camera.project(np.concatenate([points, middles]))
    inside = np.all(np.abs(np.concatenate([points, middles])[:, 1:]) < 1.99, axis=1)
    hits = cast(scene, camera, uv[inside])
    assert len(hits) > 1000
    assert np.all(hits[:, 0] > 0)


def test_invalid_triangles_are_not_there_and_no_commit_is_needed():
    near, far = height_field(4, 2.0), height_field(4, 3.0)
    scene, flags = scene_of(near, far)
    camera = Camera("c", Perspective.from_fov(10, 10, 0.5), Pose(), CODING)
    uv = [(5.2, 5.1)]
    assert cast(scene, camera, uv)[0, 1] == 1
    flags[1][:] = 1
    assert cast(scene, camera, uv)[0, 1] == 0
    flags[0][:] = 1
    assert cast(scene, camera, uv)[0, 0] < 0
    flags[1][:] = 0
    assert cast(scene, camera, uv)[0, 1] == 1


def test_geometries_are_replaced_and_removed():
    near, far = height_field(4, 2.0), height_field(4, 3.0)
    scene, _flags = scene_of(near, far)
    camera = Camera("c", Perspective.from_fov(10, 10, 0.5), Pose(), CODING)
    moved = (far[0] + np.float32([2, 0, 0]), far[1])
    scene.set(1, *moved, np.zeros(len(far[1]), np.uint8))
    scene.commit()
    assert 5.0 < cast(scene, camera, [(5.2, 5.1)])[0, 0] < 5.3
    scene.set(1, far[0], far[1][:0], np.zeros(0, np.uint8))
    scene.commit()
    assert 2.0 < cast(scene, camera, [(5.2, 5.1)])[0, 0] < 2.3
    scene.remove(0)
    scene.commit()
    assert np.all(scene.bounds()[0] > scene.bounds()[1])


def test_a_marking_ray_passes_through_and_marks_all():
    sheets = [height_field(5, x, seed=int(x)) for x in (2.0, 3.0, 4.0)]
    scene, flags = scene_of(*sheets)
    marks = [np.zeros((len(triangles), 2), np.uint64) for _points, triangles in sheets]
    table = np.array([(address_of(m), 2) for m in marks], np.int64)
    query = MarkQuery(table, 1, 1 << 63)
    flags[1][:] = 1
    origin, direction = np.float32([0, 0.3, 0.2]), np.float32([1, 0.1, -0.05])
    hit = first_hit(intersect_address(), scene.address, query.address, origin, direction)
    assert hit[3] == INVALID_ID
    for k, (points, triangles) in enumerate(sheets):
        expected = ~np.isnan(hit_distances(origin, direction, points, triangles)) & (k != 1)
        np.testing.assert_array_equal(marks[k][:, 1] == 1 << 63, expected)
        assert not marks[k][:, 0].any()


def test_a_ray_is_free_up_to_what_is_there():
    sheets = [height_field(5, x, seed=int(x)) for x in (2.0, 3.0, 4.0)]
    scene, flags = scene_of(*sheets)
    flags[0][:] = 1  # the first sheet is switched off
    rng = np.random.default_rng(3)
    origins, directions = rng.uniform(-0.5, 0.5, (200, 3)), np.array([1.0, 0, 0]) + rng.uniform(-0.4, 0.4, (200, 3))
    rays = list(zip(np.float32(origins), np.float32(directions), strict=True))
    hits = np.array([np.concatenate([hit_distances(*ray, *sheet) for sheet in sheets[1:]]) for ray in rays])
    nearest = np.nan_to_num(hits, nan=np.inf).min(axis=1)
    for far in (2.0, 3.2, 5.0):
        result = np.empty(200, bool)
        free_rays(tracer_of(scene, scene.bounds()), origins, directions, far, result)
        np.testing.assert_array_equal(result, nearest > far)
    assert 0 < result.sum() < 200


def test_what_embree_refuses_is_raised():
    scene = RayScene()
    with pytest.raises(EmbreeError, match="rtcSetSceneBuildQuality: error"):
        scene._call("SetSceneBuildQuality", scene.address, 99)


def test_flags_of_another_shape_are_refused():
    points, triangles = height_field(4, 2.0)
    with pytest.raises(ValueError, match=r"invalid: uint8 \(3,\): expected uint8 \[18\]"):
        RayScene().set(0, points, triangles, np.zeros(3, np.uint8))


def test_memory_follows_the_meshes_and_ends_with_them():
    scene, _flags = scene_of()
    empty = scene.memory
    sizes = []
    for n in (20, 80, 160):
        points, triangles = height_field(n, 5.0)
        scene.set(0, points, triangles, np.zeros(len(triangles), np.uint8))
        scene.commit()
        sizes.append(scene.memory - empty)
    # A copied point takes 12 bytes. A triangle takes a leaf and its share of the nodes: tens to hundreds of bytes.
    assert sizes[0] < sizes[1] < sizes[2]
    assert 12 * len(points) + 20 * len(triangles) < sizes[2] < 12 * len(points) + 400 * len(triangles)
    scene.remove(0)
    scene.commit()
    assert scene.memory - empty < 0.2 * sizes[2]
    counted = scene._allocated
    del scene
    assert counted[0] == 0
