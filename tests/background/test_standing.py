"""The surface that the backdrop shows behind a pixel: the nearest that no view sees past, or has seen past."""

from __future__ import annotations

import dataclasses

import numba
import numpy as np
import pytest
from farside.engine.background.capture import Present as Evidence
from farside.engine.background.model import BackgroundModel
from farside.engine.geometry.embree import RayScene, intersect_address, occluded_address
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.background.rays import Tracer
from farside.engine.kernels.background.standing import Present, standing_hit
from farside.engine.kernels.background.surfaces import CAMERA, LATE, SURFACE_SIZE
from farside.engine.kernels.base.sight import looks_through, shows
from farside.engine.kernels.base.view_table import EDGE
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Fault, Frame, View
from farside.engine.settings import Settings
from oracle import standing as slow
from support.rooms import CODING, FAR_X, FAR_Y, NEAR_X, NEAR_Y, camera_row, texture_of, wall_with_window

ORIGIN = np.zeros(3)
DELTA = (0.1, 0.0)


def prepared(camera, codes, luma=500):
    return PreparedView(
        View(camera, texture_of(np.full(codes.shape, luma)), codes), TriangulationOptions(0.0, 0.2), ORIGIN
    )


@numba.njit
def _hits(tracer, camera, uv, surfaces, present, delta, result):
    for i in range(len(uv)):
        distance, _u, _v, geometry, primitive, _length, rays = standing_hit(
            tracer, camera, uv[i, 0], uv[i, 1], surfaces, present, delta
        )
        result[i, 0], result[i, 1], result[i, 2], result[i, 3] = distance, geometry, primitive, rays


def random_case(projection, seed):
    """A camera, a few sheets at random depths with a view each, whose pictures show some of them, or nothing."""
    rng = np.random.default_rng(seed)
    camera = Camera("eye", projection, Pose.from_euler((-0.2, 0.1, 0.0), 0.05, -0.05, 0.1), CODING)
    meshes, views, depths = [], [], np.array([2.7, 3.6, 4.5, 5.4]) + rng.uniform(-0.2, 0.2, 4)
    for k, depth in enumerate(depths):
        y, z = np.meshgrid(np.linspace(1.6, -1.6, 5), np.linspace(1.6, -1.6, 5))
        points = np.stack([depth + rng.uniform(-0.02, 0.02, y.shape), y, z], -1).reshape(-1, 3).astype(np.float32)
        n = np.arange(25).reshape(5, 5)
        a, b, c, d = n[:-1, :-1].ravel(), n[:-1, 1:].ravel(), n[1:, :-1].ravel(), n[1:, 1:].ravel()
        triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).astype(np.int32)
        meshes.append((points, triangles[rng.random(len(triangles)) < 0.7], k))
        view = Camera(f"v{k}", Perspective.from_fov(24, 18, 1.0), Pose((0.0, rng.uniform(-0.5, 0.5), 0.0)), CODING)
        blocks = rng.choice([*depths, depth, depth, 8.0, np.nan], (3, 4))  # what it sees, six by six pixels each
        present = CODING.codes(np.kron(blocks, np.ones((6, 6))))
        older = CODING.codes(np.kron(rng.choice(depths, (3, 4)), np.ones((6, 6))))
        memory = np.where((present == 0) | (older == 0), np.maximum(present, older), np.minimum(present, older))
        views.append((view, present, memory.astype(np.uint16)))
    return camera, meshes, views, rng.uniform((0, 0), (camera.width, camera.height), (150, 2))


@pytest.mark.parametrize("late", [(), (0, 1)])
@pytest.mark.parametrize("near", [0.0, 3.2])
@pytest.mark.parametrize(
    "projection", [Perspective.from_fov(40, 30, 0.6), Equirectangular(40, 30, (-0.3, 0.3), (-0.25, 0.25))]
)
@pytest.mark.parametrize("seed", range(3))
def test_the_shown_surface_is_that_of_the_slow_choice(projection, near, seed, late):
    camera, meshes, views, uv = random_case(projection, seed)
    scene, flags = RayScene(), [np.zeros(len(triangles), np.uint8) for _points, triangles, _owner in meshes]
    for number, ((points, triangles, _owner), flag) in enumerate(zip(meshes, flags, strict=True)):
        scene.set(number, points, triangles, flag)
    scene.commit()
    table = ViewTable([prepared(view, present) for view, present, _memory in views])
    codes = np.array([[present.ctypes.data, memory.ctypes.data] for _view, present, memory in views])
    surfaces, result = np.zeros((len(meshes), SURFACE_SIZE), np.int64), np.empty((len(uv), 4))
    surfaces[:, CAMERA] = [owner for _points, _triangles, owner in meshes]
    bounds = scene.bounds() + np.array([[-0.01], [0.01]])
    tracer = Tracer(intersect_address(), occluded_address(), scene.address, bounds)
    surfaces[list(late), LATE] = 1
    _hits(tracer, camera.packed(), uv, surfaces, Present(near, table.rows, codes), DELTA, result)
    asked = [
        (view, row[EDGE], present, memory) for (view, present, memory), row in zip(views, table.rows, strict=True)
    ]
    layers = []
    for (u, v), (distance, mesh, triangle, rays) in zip(uv, result, strict=True):
        expected, *which = slow.standing(camera, u, v, near, meshes, asked, DELTA, late=late)
        assert (distance > 0) == np.isfinite(expected)
        if np.isfinite(expected):
            assert distance == pytest.approx(expected, abs=1e-4)
            assert [mesh, triangle] == which
            layers.append((which[0], rays))
    shown, rays = np.array(layers).T
    assert len(set(shown)) == (3 if near else 4)
    assert rays.min() == 1
    assert rays.max() >= 4


@pytest.mark.parametrize("late", [(), (0, 1)])
@pytest.mark.parametrize("has_invalid", [True, False])
@pytest.mark.parametrize("gone", range(4))
def test_of_a_view_that_is_left_out_only_the_memory_counts(gone, has_invalid, late):
    camera, meshes, views, uv = random_case(Perspective.from_fov(40, 30, 0.6), 0)
    coding = dataclasses.replace(CODING, has_invalid=has_invalid)
    if not has_invalid:  # what is not seen is far away
        views = [(dataclasses.replace(view, depth=coding), present, memory) for view, present, memory in views]
    scene, flags = RayScene(), [np.zeros(len(triangles), np.uint8) for _points, triangles, _owner in meshes]
    for number, ((points, triangles, _owner), flag) in enumerate(zip(meshes, flags, strict=True)):
        scene.set(number, points, triangles, flag)
    scene.commit()
    given = [prepared(view, present) for view, present, _memory in views]
    given[gone].view = dataclasses.replace(given[gone].view, fault=Fault("missing"))
    present = Evidence(0.0, ViewTable(given), {c: memory for c, (_view, _present, memory) in enumerate(views)})
    surfaces, result = np.zeros((len(meshes), SURFACE_SIZE), np.int64), np.empty((len(uv), 4))
    surfaces[:, CAMERA] = [owner for _points, _triangles, owner in meshes]
    bounds = scene.bounds() + np.array([[-0.01], [0.01]])
    tracer = Tracer(intersect_address(), occluded_address(), scene.address, bounds)
    surfaces[list(late), LATE] = 1
    _hits(tracer, camera.packed(), uv, surfaces, present.packed(), DELTA, result)
    asked = [(view, one.table_row[EDGE], *codes) for one, (view, *codes) in zip(given, views, strict=True)]
    nothing = np.zeros_like(views[gone][1])  # its present view, in a coding in which that is no depth
    blind = dataclasses.replace(views[gone][0], depth=CODING)
    differs = 0
    for (u, v), (distance, mesh, triangle, _rays) in zip(uv, result, strict=True):
        found = [
            slow.standing(camera, u, v, 0.0, meshes, asked, DELTA, {gone: (blind, nothing)} if left_out else {}, late)
            for left_out in (True, False)
        ]
        differs += found[0] != found[1]
        assert (distance > 0) == np.isfinite(found[0][0])
        if np.isfinite(found[0][0]):
            assert distance == pytest.approx(found[0][0], abs=1e-4)
            assert [mesh, triangle] == list(found[0][1:])
    assert (differs > 0) == (gone != 3)  # the farthest surface is shown where no other stands

@pytest.mark.parametrize(
    ("seen", "through", "shown"),
    [(3.0, False, True), (3.08, False, True), (2.92, False, True), (2.0, False, False), (3.2, True, False),
     (6.0, True, False), (np.nan, False, False)],
)  # fmt: skip
@pytest.mark.parametrize("delta", [DELTA, (0.02, 0.1 / 9.0)])  # at 3 m the same
def test_what_a_view_says_of_a_point(seen, through, shown, delta):
    camera = camera_row(1)[0]
    codes = np.full((camera.height, camera.width), CODING.codes(np.array(seen)), np.uint16)
    row, at = prepared(camera, codes).table_row, np.array([3.0, 0.2, 0.1])
    assert looks_through(row, codes.ctypes.data, *at, delta) == through == slow.looks_through(camera, codes, at, delta)
    assert shows(row, codes.ctypes.data, *at, delta) == shown == slow.shows(camera, row[EDGE], codes, at, delta)
    for outside in ((-3.0, 0.0, 0.0), (3.0, 40.0, 0.0), (0.01, 0.0, 0.0)):
        assert not looks_through(row, codes.ctypes.data, *outside, delta)
        assert not shows(row, codes.ctypes.data, *outside, delta)


def test_a_slanted_surface_is_seen_and_a_depth_edge_is_not():
    camera = camera_row(1)[0]
    depth = np.broadcast_to(np.linspace(2.0, 5.0, camera.width), (camera.height, camera.width))
    slanted, edge = CODING.codes(depth), CODING.codes(np.where(depth < 3.5, 2.0, 5.0))
    at = camera.unproject([48.0, 32.0], 3.5)
    for codes, expected in ((slanted, True), (edge, False)):
        row = prepared(camera, codes).table_row
        assert shows(row, codes.ctypes.data, *at, (0.01, 0.0)) == expected
        assert not looks_through(row, codes.ctypes.data, *at, (0.01, 0.0))


# Two walls, the nearer one with a window


def seen_from(pose, standing):
    """Luma and x coordinate of the backdrop of two walls, and which pixels look through the window."""
    cameras = camera_row(5, (192, 128), 0.6)
    first = Frame(0, tuple(wall_with_window(camera) for camera in cameras))
    settings = Settings(n_init=5, baseline_m=0.5)
    scene = Scene.of(cameras, settings, first)
    model = BackgroundModel(cameras, settings, scene)
    model.update(first)
    table = ViewTable([PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in first.views])
    eye = Camera("eye", Perspective.from_fov(80, 60, 0.8), pose, CODING)
    view = model.render_pbi(eye, table if standing else None).view
    v, u = np.mgrid[0:60, 0:80] + 0.5
    points = eye.unproject(np.stack([u, v], -1), CODING.depth(view.codes))
    return view.texture.y, points[..., 0], wall_with_window(eye).texture.y == FAR_Y


POSES = {
    "before": Pose((0.4, 0.1, 0.1)),
    "beside": Pose((1.0, 1.2, 0.0)),
    "aslant": Pose.from_euler((0.0, -1.2, 0.0), 0.4, 0.0, 0.0),
}


@pytest.mark.parametrize("pose", POSES)
def test_a_wall_that_stands_is_shown_and_its_window_is_open(pose):
    luma, x, window = seen_from(POSES[pose], standing=True)
    # All pixels but a texel of the cameras around the window's border, where the views prove nothing.
    assert np.mean((np.abs(x - NEAR_X) < 0.05) == ~window) > 0.97
    assert np.mean((luma == NEAR_Y) == ~window) > 0.96


def test_the_farthest_surfaces_show_the_far_wall_where_the_near_one_stands():
    _luma, x, window = seen_from(POSES["before"], standing=False)
    wrong = ~window & (np.abs(x - FAR_X) < 0.05)
    assert wrong.sum() > 0.05 * wrong.size


def test_an_unknown_backdrop_is_refused():
    with pytest.raises(ValueError, match="backdrop: 'nearest': expected one of farthest, standing"):
        Settings(backdrop="nearest")


def test_the_engine_shows_what_the_setting_says():
    """Next to a post, which hides a strip of the near wall from the only view that has depth now."""
    cameras = camera_row(5, (192, 128), 0.6)
    eye = Camera("eye", Perspective.from_fov(80, 60, 0.8), Pose((0.0, 0.25, 0.0)), DepthCoding(0.5, 20.0))
    first = Frame(0, tuple(wall_with_window(camera) for camera in cameras))
    now = [View(view.camera, view.texture, np.zeros_like(view.codes)) for view in first.views]
    now[2] = wall_with_window(cameras[2], post=True)
    wall, depths = wall_with_window(eye, post=True).texture.y == NEAR_Y, {}
    for backdrop in ("farthest", "standing"):
        engine = Engine(cameras, Settings(n_init=5, n_render=1, baseline_m=0.5, backdrop=backdrop, fill="none"))
        engine.update(first)
        engine.update(Frame(1, tuple(now)), {"me": eye})
        picture = engine.render_camera(eye, "me")
        only = wall & picture.holes(warped=True) & ~picture.holes()
        assert only.sum() > 100
        depths[backdrop] = 1.0 / picture.disparity[only]
    assert np.mean(depths["farthest"] > 0.5 * (NEAR_X + FAR_X)) > 0.5
    assert np.mean(depths["standing"] > 0.5 * (NEAR_X + FAR_X)) < 0.05
