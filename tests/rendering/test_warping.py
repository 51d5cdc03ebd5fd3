"""The rasteriser against rays: coverage, disparity, culling, clipping, margins, bands, threads."""

from __future__ import annotations

import dataclasses
import math

import numba
import numpy as np
import pytest
from farside.engine.geometry.mesh import Mesh
from farside.engine.geometry.prepared_view import PreparedView, pixels_per_radian
from farside.engine.geometry.triangulation import TriangulationOptions, triangulate
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import View
from oracle.zbuffer import zbuffer
from support.rooms import texture_of

ORIGIN = np.array([5.0, -3.0, 1.0])
POSE = Pose.from_euler(ORIGIN + np.array([0.1, 0.05, -0.1]), 0.3, -0.2, 0.1)
CODING = DepthCoding(0.3, 30.0, 16, has_invalid=True)
NEAR = 0.02

TARGETS = {
    "perspective": Perspective(47, 35, 30.0, 32.0, 23.0, 18.0),
    "turned": Perspective(40, 33, -25.0, -25.0, 19.0, 17.0),
    "beside": Perspective(40, 40, 60.0, 60.0, -30.0, 80.0),
    "sphere": Equirectangular(72, 36, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2)),
    "turned sphere": Equirectangular(71, 33, (-2.0, -2.0 + 2 * math.pi), (-math.pi / 2, math.pi / 2)),
    "part of a sphere": Equirectangular(50, 41, (1.9, 4.4), (-0.9, 1.3)),
}


def target_camera(name, pose=POSE):
    return Camera("target", TARGETS[name], pose, CODING)


def make_mesh(points, triangles):
    """A mesh of world points; the rasteriser uses only points and triangles."""
    points = np.asarray(points, float) - ORIGIN
    return Mesh(points.astype(np.float32), np.zeros((len(points), 2), np.float32), np.array(triangles, np.int32))


def world_points(mesh):
    return mesh.points.astype(float) + ORIGIN


def drawn(camera, *meshes, margin=0.0, near=NEAR):
    canvas = Canvas(camera.width, camera.height)
    for number, mesh in enumerate(meshes):
        canvas.draw(mesh, Target(camera, ORIGIN), number, near, margin)
    return canvas


def soup(rng, count, eye, size):
    """Triangles anywhere around the eye, with both windings, without needles."""
    middles = rng.standard_normal((count, 3))
    middles *= rng.uniform(0.5, 4, (count, 1)) / np.linalg.norm(middles, axis=1, keepdims=True)
    turn = np.arange(3) * 2 * math.pi / 3 + rng.uniform(0, 0.6, (count, 3))
    first, second = rng.standard_normal((2, count, 1, 3))
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second -= first * (first * second).sum(-1, keepdims=True)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    corners = middles[:, None] + size * (np.cos(turn)[..., None] * first + np.sin(turn)[..., None] * second)
    return make_mesh((corners + eye).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def check_against_rays(camera, mesh, relative, near=NEAR):
    """Compare a picture with one made by rays; returns the share of pixels that were compared."""
    nearest = near if isinstance(camera.projection, Perspective) else 0.0
    expected = zbuffer(camera, world_points(mesh), mesh.triangles, nearest)
    found = drawn(camera, mesh, near=near).disparity
    sure = expected.sure_of_coverage
    np.testing.assert_array_equal((found > 0)[sure], (expected.triangle >= 0)[sure])
    same = expected.sure_of_triangle & (expected.triangle >= 0)
    np.testing.assert_allclose(found[same], expected.disparity[same], rtol=relative)
    return np.mean(expected.sure_of_triangle)


@pytest.mark.parametrize(
    ("name", "size"),
    [(name, size) for name in TARGETS for size in (0.15, 0.6, 2.0)],
)
def test_triangle_soup(name, size):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        camera = target_camera(name)
        mesh = soup(rng, 60, camera.pose.position, size)
        assert check_against_rays(camera, mesh, 1e-4) > 0.9


def inside_of_a_box(camera, low=(-2.0, -3.0, -1.5), high=(4.0, 2.5, 1.5)):
    """Depth codes of a box around the scene origin, seen from inside."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    start = np.array(camera.pose.position)
    rays = camera.unproject(np.stack([u, v], -1), np.ones_like(u)) - start
    with np.errstate(divide="ignore"):
        to_walls = np.stack([(ORIGIN + side - start) / rays for side in (np.array(low), np.array(high))])
    return camera.depth.codes(np.where(to_walls > 0, to_walls, np.inf).min(axis=(0, -1)))


def box_mesh(projection, tolerance=0.25):
    camera = Camera("v0", projection, Pose.from_euler(ORIGIN, -0.4, 0.1, 0.0), CODING)
    pixel = 1 / (0.2 * pixels_per_radian(camera))
    options = TriangulationOptions(tolerance * pixel, 4 * pixel)
    return triangulate(camera, inside_of_a_box(camera), options, origin=ORIGIN)


SPHERE = Equirectangular(48, 24, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize("source", [SPHERE, Perspective.from_fov(32, 28, 1.8)], ids=["sphere", "perspective"])
def test_mesh_of_a_view(name, source):
    mesh = box_mesh(source)
    camera = target_camera(name)
    assert check_against_rays(camera, mesh, 1e-4) > 0.8


@pytest.mark.parametrize("name", TARGETS)
def test_back_faces_are_not_drawn(name):
    mesh = box_mesh(SPHERE)
    assert drawn(target_camera(name), mesh).disparity.max() > 0
    turned = dataclasses.replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]))
    assert drawn(target_camera(name), turned).disparity.max() == 0


@pytest.mark.parametrize("behind", [-7.3, 0.0], ids=["behind", "on the eye's plane"])
@pytest.mark.parametrize("name", ["perspective", "turned", "sphere"])
def test_floor_below_the_eye(name, behind):
    camera = target_camera(name, Pose(tuple(ORIGIN)))
    corners = [(x, y, -1.5) for x in (behind, 30.0) for y in (-40.0, 40.0)]
    floor = make_mesh(np.array(corners) + ORIGIN, [(0, 1, 2), (1, 3, 2)])
    if behind == 0.0 or name == "sphere":
        floor = dataclasses.replace(floor, triangles=np.concatenate([floor.triangles, floor.triangles[:, ::-1]]))
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    rays = camera.unproject(np.stack([u, v], -1), np.ones_like(u)) - camera.pose.position
    with np.errstate(divide="ignore"):
        depth = -1.5 / rays[..., 2]
    at = rays * depth[..., None]
    near = NEAR if name != "sphere" else 0.0
    inside = (depth > near) & (at[..., 0] > behind) & (at[..., 0] < 30) & (np.abs(at[..., 1]) < 40)
    for triangles in (floor.triangles, floor.triangles[:, ::-1]):
        found = drawn(camera, dataclasses.replace(floor, triangles=np.ascontiguousarray(triangles))).disparity
        if found.max() > 0:
            break
    np.testing.assert_array_equal(found > 0, inside)
    np.testing.assert_allclose(found[inside], 1 / depth[inside], rtol=1e-4)


def wall(distance, *, half=50.0):
    """A wall across the view axis of a camera at ORIGIN that looks along x."""
    corners = [(distance, y, z) for z in (half, -half) for y in (half, -half)]
    return make_mesh(np.array(corners) + ORIGIN, [(0, 2, 1), (1, 2, 3)])


@pytest.mark.parametrize("middle", [0.0, 6.2831, -3.1416])
@pytest.mark.parametrize("span", [1e-8, 1e-6, 1e-3, 0.1])
def test_a_small_part_of_a_sphere_is_drawn_without_walking_round_the_rest(span, middle):
    ranges = (middle - span / 2, middle + span / 2), (-span / 2, span / 2)
    camera = Camera("target", Equirectangular(40, 30, *ranges), Pose(tuple(ORIGIN)), CODING)
    triangle = [(4.0, 60.0, -60.0), (4.0, -60.0, -60.0), (4.0, 0.0, 60.0)]
    turned = np.array(triangle) * [math.cos(middle), 1.0, 1.0] + [0.0, 4.0 * math.sin(middle), 0.0]
    found = drawn(camera, make_mesh(turned + ORIGIN, [(0, 1, 2), (2, 1, 0)])).disparity
    np.testing.assert_allclose(found, 0.25, rtol=0.01)


def test_a_later_mesh_wins_where_it_is_nearer_by_the_margin():
    camera = target_camera("perspective", Pose(tuple(ORIGIN)))
    for distance, winner in ((2.0, 1), (2.4, 1), (2.6, 0), (4.0, 0), (5.0, 0)):
        canvas = drawn(camera, wall(4.0), wall(distance), margin=0.15)  # 1/4 + 0.15 is the disparity of 2.5 m
        assert (canvas.winner == winner).all()
        np.testing.assert_allclose(canvas.disparity, 1 / distance if winner else 0.25, rtol=1e-6)
    canvas = drawn(camera, wall(4.0, half=0.5), wall(1.0), margin=math.inf)
    first = drawn(camera, wall(4.0, half=0.5)).disparity > 0
    assert 0 < first.sum() < first.size
    np.testing.assert_array_equal(canvas.winner, np.where(first, 0, 1))
    np.testing.assert_allclose(canvas.disparity, np.where(first, 0.25, 1.0), rtol=1e-6)


def test_nothing_nearer_than_the_near_plane_is_drawn():
    camera = target_camera("perspective", Pose(tuple(ORIGIN)))
    assert drawn(camera, wall(0.5), near=0.6).disparity.max() == 0
    assert drawn(camera, wall(0.7), near=0.6).disparity.min() > 0
    assert drawn(camera, wall(-2.0)).disparity.max() == 0


@pytest.mark.parametrize("name", ["perspective", "part of a sphere"])
def test_bands_leave_no_seams(name):
    """A band of any number of rows has the same pixels, so the bands do not show in the picture."""
    tall, mesh = target_camera(name), box_mesh(SPHERE)
    expected = drawn(tall, mesh).disparity
    for rows in (1, 2, 3, 15, 16, 17, 31, 32, 33, tall.height):
        p = tall.projection
        if isinstance(p, Equirectangular):
            low = p.ver_range[1] - (p.ver_range[1] - p.ver_range[0]) * rows / p.height
            cropped = dataclasses.replace(p, height=rows, ver_range=(low, p.ver_range[1]))
        else:
            cropped = dataclasses.replace(p, height=rows)
        found = drawn(dataclasses.replace(tall, projection=cropped), mesh).disparity
        np.testing.assert_allclose(found, expected[:rows], rtol=1e-6)


@pytest.mark.parametrize("name", TARGETS)
def test_threads_do_not_change_the_picture(name):
    camera, meshes = target_camera(name), (box_mesh(SPHERE), soup(np.random.default_rng(1), 200, ORIGIN, 0.5))
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = drawn(camera, *meshes, margin=0.01)
    finally:
        numba.set_num_threads(threads)
    many = drawn(camera, *meshes, margin=0.01)
    np.testing.assert_array_equal(one.disparity, many.disparity)
    np.testing.assert_array_equal(one.winner, many.winner)


def test_a_canvas_is_used_again():
    camera = target_camera("perspective")
    target, canvas = Target(camera, ORIGIN), Canvas(camera.width, camera.height)
    for mesh in (wall(3.0), soup(np.random.default_rng(0), 300, ORIGIN, 0.4), box_mesh(SPHERE), wall(2.0)):
        canvas.clear()
        assert canvas.draw(mesh, target, 0, NEAR, 0.0) > 0
        np.testing.assert_array_equal(canvas.disparity, drawn(camera, mesh).disparity)
    canvas.clear()
    assert canvas.draw(make_mesh(np.empty((0, 3)), np.empty((0, 3), np.int32)), target, 0, NEAR, 0.0) == 0
    assert canvas.disparity.max() == 0


def test_a_view_is_triangulated_once():
    camera = Camera("v0", Perspective.from_fov(32, 24, 1.2), Pose(tuple(ORIGIN)), CODING)
    view = View(camera, texture_of(np.zeros((24, 32))), inside_of_a_box(camera))
    prepared = PreparedView(view, TriangulationOptions(0.0, 1.0), ORIGIN)
    assert prepared.mesh() is prepared.mesh()
    assert prepared.mesh("rims") is prepared.mesh("rims")
    assert len(prepared.mesh().triangles) == 2 * 31 * 23
    assert len(prepared.mesh("rims").triangles) == 0


def test_planes_must_be_contiguous_codes():
    camera = Camera("v7", Perspective.from_fov(32, 24, 1.2), Pose(tuple(ORIGIN)), CODING)
    view = View(camera, texture_of(np.zeros((24, 32))), np.zeros((24, 64), np.uint16)[:, ::2])
    with pytest.raises(ValueError, match="v7: planes: expected C-contiguous uint16"):
        PreparedView(view, TriangulationOptions(0.0, 1.0), ORIGIN).addresses()
