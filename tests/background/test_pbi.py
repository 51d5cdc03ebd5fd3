from __future__ import annotations

import io
import itertools

import numpy as np
import pytest
import trimesh
from farside.engine.background.model import BackgroundModel
from farside.engine.background.pbi import enlarged, imaginary_camera
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.io.coloured_meshes import ColouredMesh, srgb_from_ycbcr
from farside.engine.io.glb import to_glb
from farside.engine.io.mesh_files import to_ply
from farside.engine.kernels.background.uncovered import CELL
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, View
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from support.rooms import BOX_X, CODING, WALL_X, WALL_Y, camera_row, frame, see, texture_of

HEAD = Pose.from_euler((0.2, -0.1, 0.3), 0.5, -0.2, 0.1)
EYES = {
    "symmetric": (Perspective.from_fov(64, 72, 1.5), Perspective.from_fov(64, 72, 1.5)),
    "asymmetric": (
        Perspective.from_tangents(64, 72, 1.3, 0.8, 1.2, 1.1),
        Perspective.from_tangents(64, 72, 0.8, 1.3, 1.2, 1.1),
    ),
}


def model_of(cameras, first, **options):
    settings = Settings(n_init=len(cameras), **options)
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    model.update(first)
    return model


def frustum_points(camera):
    """World points at the corners of a picture, near to far."""
    corners = itertools.product((0.0, camera.width), (0.0, camera.height))
    return np.array([camera.unproject(uv, depth) for uv in corners for depth in (0.3, 1.0, 5.0, 100.0)])


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize("speed", [0.0, 1.5])
def test_the_imaginary_camera_holds_both_eyes_wherever_the_head_gets_to(eyes, speed):
    view = StereoView(HEAD, 0.064, *EYES[eyes])
    camera = imaginary_camera(view, speed, 30.0, CODING)
    behind = (np.array(camera.pose.position) - HEAD.position) @ HEAD.rotation()
    assert -0.5 < behind[0] < 0
    assert np.allclose(behind[1:], 0)
    for step in itertools.product((-1, 0, 1), repeat=3):
        travel = np.array(step) / max(np.linalg.norm(step), 1) * speed / 30.0
        for eye in view.moved(HEAD.translated(travel)).eyes(CODING):
            uv, depth = camera.project(frustum_points(eye))
            assert np.all(depth > 0)
            assert np.all((uv >= 0) & (uv <= (camera.width, camera.height)))
    density = camera.projection.fx / EYES[eyes][0].fx
    assert 1.0 <= density < 1.1


def test_pbi_scale_changes_the_size_only():
    view = StereoView(HEAD, 0.064, *EYES["symmetric"])
    full, half = (imaginary_camera(view, 0.5, 30.0, CODING, scale) for scale in (1.0, 0.5))
    assert full.pose == half.pose
    assert half.width == pytest.approx(full.width / 2, abs=2)
    points = frustum_points(half)
    np.testing.assert_allclose(full.project(points)[0], 2 * half.project(points)[0], atol=3)


@pytest.mark.parametrize("bad", [(-1.0, 30.0, 1.0), (0.0, 0.0, 1.0), (0.0, 30.0, 0.0)])
def test_impossible_speeds_and_rates_are_refused(bad):
    speed, f_vin, scale = bad
    with pytest.raises(ValueError, match="head speed, f_vin, scale"):
        imaginary_camera(StereoView(HEAD, 0.064, *EYES["symmetric"]), speed, f_vin, CODING, scale)


@pytest.mark.parametrize(
    "projection",
    [
        Perspective(64, 48, -50.0, 45.0, 20.0, 30.0),
        Equirectangular(64, 48, (-1.0, 1.0), (-0.8, 0.7)),
        Equirectangular(64, 48, (-np.pi, np.pi), (-np.pi / 2, np.pi / 2)),
    ],
)
def test_an_enlarged_camera_sees_a_little_more(projection):
    camera = Camera("c", projection, HEAD, DepthCoding(0.1, 10.0))
    wide = enlarged(camera, CODING)
    assert wide.pose == camera.pose
    assert wide.depth == CODING
    rng = np.random.default_rng(0)
    points = camera.unproject(rng.uniform((0, 0), (64, 48), (500, 2)), 2.0)
    uv, depth = wide.project(points)
    assert np.all((depth > 0) & np.all((uv >= 0) & (uv <= (wide.width, wide.height)), axis=-1))
    assert wide.width * wide.height < 1.6 * 64 * 48


@pytest.mark.parametrize(
    "projection", [Perspective.from_fov(60, 40, 0.7), Equirectangular(61, 41, (-0.3, 0.3), (-0.2, 0.2))]
)
def test_depth_is_coded_as_the_imaginary_cameras_projection_has_it(projection):
    cameras = camera_row()
    model = model_of(cameras, frame(0, cameras))
    camera = Camera("i", projection, Pose.from_euler((-0.2, 0.1, 0.05), 0.1, 0.05, 0.2), CODING)
    view = model.render_pbi(camera).view
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    points = camera.unproject(np.stack([u, v], -1), camera.depth.depth(view.codes))
    assert np.isfinite(points).all()
    np.testing.assert_allclose(points[..., 0], WALL_X, atol=0.01)
    np.testing.assert_array_equal(view.texture.y, WALL_Y)
    np.testing.assert_array_equal(view.texture.cb, WALL_Y // 2)
    np.testing.assert_array_equal(view.texture.cr, WALL_Y // 2 + 1)


def test_colours_are_those_seen_there():
    cameras = camera_row(1, (96, 64))
    u = np.arange(96) + 0.5
    ramp = np.broadcast_to(np.rint(100 + 6 * u), (64, 96))
    model = model_of(cameras, Frame(0, (View(cameras[0], texture_of(ramp), see(cameras[0]).codes),)))
    view = model.render_pbi(cameras[0]).view
    np.testing.assert_allclose(view.texture.y[1:-1, 1:-1], ramp[1:-1, 1:-1], atol=1)
    focal = cameras[0].projection.fx
    between = Camera("b", Perspective(48, 64, focal, focal, 24.25, 32.0), Pose(), CODING)
    columns = model.render_pbi(between).view.texture.y[32]
    np.testing.assert_allclose(columns, 100 + 6 * (np.arange(48) + 24.25), atol=1)


@pytest.mark.parametrize("box_y", [None, 0.2])
@pytest.mark.parametrize(
    "projection", [Perspective.from_fov(81, 61, 0.7), Equirectangular(80, 60, (-0.35, 0.35), (-0.25, 0.25))]
)
def test_fewer_rays_give_the_same_picture(projection, box_y):
    cameras = camera_row(1)
    ramp = np.broadcast_to(np.rint(100 + 6 * (np.arange(96) + 0.5)), (64, 96))
    seen = see(cameras[0], box_y)
    model = model_of(cameras, Frame(0, (View(cameras[0], texture_of(ramp), seen.codes),)), baseline_m=0.4)
    camera = Camera("i", projection, Pose.from_euler((0.3, 0.5, 0.05), -0.1, 0.05, 0.2), CODING)
    few, all_ = (model.render_pbi(camera, sparse=sparse).view for sparse in (True, False))
    assert np.any(all_.codes == 0) == (box_y is not None)  # behind the box
    np.testing.assert_array_equal(few.codes == 0, all_.codes == 0)
    planes = [(few.codes, all_.codes)]
    planes += [(getattr(few.texture, p), getattr(all_.texture, p)) for p in ("y", "cb", "cr")]
    for found, expected in planes:
        difference = np.abs(found.astype(int) - expected)
        assert np.mean(difference > 2) <= (0 if box_y is None else 0.002)  # corners of the box, less than a pixel
        assert np.mean(difference > 1) < 0.005


def test_where_nothing_was_seen_there_is_code_0():
    cameras = camera_row()
    model = model_of(cameras, frame(0, cameras))
    away = Camera("a", Perspective.from_fov(20, 20, 1.0), Pose.from_euler((0, 0, 0), np.pi, 0, 0), CODING)
    assert not model.render_pbi(away).view.codes.any()
    without = Camera("w", Perspective.from_fov(20, 20, 1.0), Pose(), DepthCoding(0.5, 20.0))
    with pytest.raises(ValueError, match="expected one with invalid codes"):
        model.render_pbi(without)


# Export


def test_the_exported_mesh_is_the_wall_in_its_colour():
    cameras = camera_row()
    mesh = model_of(cameras, frame(0, cameras)).mesh()
    np.testing.assert_allclose(mesh.vertices[:, 0], WALL_X, atol=0.01)
    expected = srgb_from_ycbcr(np.array([[WALL_Y, WALL_Y // 2, WALL_Y // 2 + 1]], np.float32))
    np.testing.assert_array_equal(mesh.colours, np.broadcast_to(expected, mesh.colours.shape))


def test_files_hold_the_mesh_in_their_axes():
    vertices = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    colours = 255 * np.eye(3, dtype=np.uint8)
    mesh = ColouredMesh(vertices, np.array([[0, 1, 2]], np.int32), np.eye(3, dtype=np.float32))
    glb = trimesh.load_scene(io.BytesIO(to_glb(mesh)), file_type="glb").to_mesh()
    # Forward (x) is -z in glTF, left (y) is -x, up (z) is y; a rotation, so that winding stays.
    np.testing.assert_allclose(glb.vertices, [[0, 0, -1], [-2, 0, 0], [0, 3, 0]], atol=1e-6)
    np.testing.assert_array_equal(glb.faces, mesh.triangles)
    ply = trimesh.load(io.BytesIO(to_ply(mesh)), file_type="ply")
    np.testing.assert_allclose(ply.vertices, vertices, atol=1e-6)
    np.testing.assert_array_equal(ply.visual.vertex_colors[:, :3], colours)
    np.testing.assert_array_equal(ply.faces, mesh.triangles)


def test_bt709_limited_range_becomes_srgb():
    ycbcr = np.array([[64, 512, 512], [940, 512, 512], [64 + 876 * 0.2126, 512 - 896 * 0.1146, 512 + 448]])
    np.testing.assert_allclose(srgb_from_ycbcr(ycbcr), [[0, 0, 0], [1, 1, 1], [1, 0, 0]], atol=1e-4)


def test_joined_meshes_keep_only_the_vertices_in_use():
    corner = np.eye(3)
    colours = np.zeros((3, 3), np.float32)
    used = ColouredMesh(corner, np.array([[0, 1, 2]], np.int32), colours)
    unused = ColouredMesh(corner + 5, np.empty((0, 3), np.int32), colours)
    joined = ColouredMesh.joined([unused, used])
    np.testing.assert_array_equal(joined.vertices, corner)
    np.testing.assert_array_equal(joined.triangles, [[0, 1, 2]])
    assert len(ColouredMesh.joined([]).triangles) == 0


def test_only_wanted_cells_are_made():
    cameras = camera_row()
    model = model_of(cameras, frame(0, cameras, box_y=0.1))
    camera = Camera("i", Perspective.from_fov(61, 43, 0.7), Pose((-0.1, 0.1, 0.0)), CODING)
    everything = model.render_pbi(camera)
    wanted = np.random.default_rng(0).integers(0, 2, (11, 16)).astype(np.uint8)
    part = model.render_pbi(camera, wanted=wanted)
    made = np.kron(wanted, np.ones((CELL, CELL)))[:43, :61] != 0
    assert not part.view.codes[~made].any()
    for found, expected in ((part.view.codes, everything.view.codes), (part.view.texture.y, everything.view.texture.y)):
        assert np.mean(np.abs(found.astype(int) - expected)[made] > 2) < 0.005
    assert part.rays < 0.9 * everything.rays


@pytest.mark.parametrize("standing", [False, True])
def test_what_lies_between_the_imaginary_camera_and_the_eyes_is_not_shown(standing):
    """Someone in front of the wall is in the model, but nearer than the near limit of the picture."""
    cameras = camera_row()
    first = frame(0, cameras, box_y=0.0)
    model = model_of(cameras, first)
    scene, settings = model.state().scene.scene(), model.settings
    views = [PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in first.views]
    camera = Camera("i", Perspective.from_fov(60, 40, 0.3), Pose((-0.2, 0.0, 0.0)), CODING)
    depths = {}
    for near in (0.0, 2.9):  # the box is 2.7 m away, the wall 4.2 m
        view = model.render_pbi(camera, ViewTable(views) if standing else None, near=near).view
        depths[near] = camera.depth.depth(view.codes)
    on_box = np.isclose(depths[0.0], BOX_X + 0.2, atol=0.02)
    assert on_box.mean() > 0.2
    if standing:
        assert not np.any(depths[2.9] < 2.9)
    else:  # the farthest surface is shown, wherever it is
        np.testing.assert_array_equal(depths[2.9], depths[0.0])
