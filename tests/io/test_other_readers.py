"""Exported models in other programs: three.js shows the room as the engine does; Khronos' validator is silent.

The engine's picture is the probable background image at the canvas' pose: what it lays behind the drawn views.
"""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine import Engine, Settings
from farside.engine.background.model import BackgroundModel
from farside.engine.geometry.scene_scale import Scene
from farside.engine.io.coloured_meshes import ColouredMesh, TexturedMesh
from farside.engine.io.mesh_files import COLOURS, to_file
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.rig.texture import to_rgb
from farside.engine.synth import make_twin, twin_frame
from support.rooms import camera_row, see
from support.three import complaints, viewer

SCALE, FRAMES = 0.15, 3
LUMA = np.array([0.2126, 0.7152, 0.0722])
WANTED_DB = 30.0
GREY = 64 + 438  # half of the code range
HEADS = {
    "ahead": ((0.0, 0.0, 0.0), 0.0, 0.0),
    "to the left, and up": ((0.1, 0.1, 0.05), 0.6, 0.1),
    "to the right, and down": ((-0.1, 0.15, 0.0), -0.9, -0.4),
    "off the rig": ((0.25, 0.25, 0.1), 0.1, 0.0),
}


@pytest.fixture(scope="module")
def museum():
    """The engine after some frames of the museum twin, and the last of them."""
    twin = make_twin("museum", SCALE)
    engine = Engine(twin.sources, Settings.preset("balanced"))
    for index in range(FRAMES):
        engine.update(frame := twin_frame(twin, index))
    return engine, frame


def a_target(engine, head):
    move, yaw, pitch = HEADS[head]
    middle = np.mean([camera.pose.position for camera in engine.cameras], axis=0)
    pose = Pose.from_euler(tuple((middle + move).tolist()), yaw, pitch, 0.0)
    depth = engine.cameras[0].depth
    coding = DepthCoding(depth.near, depth.far, 16, has_invalid=True)
    return Camera("canvas", Perspective.from_fov(640, 480, 1.4), pose, coding)


def the_backdrop(engine, frame, camera):
    """The PBI, R'G'B' [h, w, 3], and where it has a surface."""
    table = engine.model._new_triangles.table(frame.views)
    view = engine.model.render_pbi(camera, table, sparse=False).view
    return to_rgb(view.texture), view.codes > 0


def the_canvas(shown, camera):
    """What three.js shows, R'G'B' [h, w, 3], and where it shows a surface."""
    picture, other = (shown.picture(camera, background) for background in ((1.0, 0.0, 1.0), (0.0, 1.0, 0.0)))
    return picture, (picture == other).all(axis=-1)


def psnr_y(a, b, where):
    error = ((a.astype(float) - b.astype(float)) @ LUMA)[where]
    return 10 * np.log10(255**2 / np.mean(error**2))


def test_three_shows_what_the_engine_has_behind_its_views(museum):
    engine, frame = museum
    found = {}
    with viewer(engine.export("glb")) as shown:
        for head in HEADS:
            camera = a_target(engine, head)
            (expected, modelled), (picture, covered) = the_backdrop(engine, frame, camera), the_canvas(shown, camera)
            assert modelled.mean() > 0.97
            assert (modelled != covered).mean() < 0.002  # the same holes
            found[head] = psnr_y(picture, expected, modelled & covered)
    assert min(found.values()) > WANTED_DB, found


def test_colours_at_the_vertices_are_right_but_blurred(museum):
    engine, frame = museum
    camera = a_target(engine, "ahead")
    (expected, modelled), found = the_backdrop(engine, frame, camera), {}
    for colours in COLOURS:
        with viewer(engine.export("glb", colours)) as shown:
            picture, covered = the_canvas(shown, camera)
        where = modelled & covered
        found[colours] = psnr_y(picture, expected, where)
        means = [image[where].mean(axis=0) for image in (picture, expected)]
        np.testing.assert_allclose(*means, atol=2.0)
    assert 20.0 < found["vertex"] < found["texture"] - 5.0


@pytest.mark.parametrize("colours", COLOURS)
def test_half_grey_in_is_half_grey_out(colours):
    cameras = camera_row(1)
    codes = see(cameras[0]).codes
    half = np.full((32, 48), 512, np.uint16)
    frame = Frame(0, (View(cameras[0], Texture(np.full(codes.shape, GREY, np.uint16), half, half), codes),))
    engine = Engine(cameras, Settings(n_init=1))
    engine.update(frame)
    with viewer(engine.export("glb", colours)) as shown:
        picture = shown.picture(cameras[0])
    inner = picture[2:-2, 2:-2].astype(int)  # a view's surface ends at the centres of its outermost pixels
    assert np.unique(inner).tolist() in ([127], [128], [127, 128])  # of 255


# Khronos' validator


@pytest.mark.parametrize("colours", COLOURS)
def test_the_validator_has_nothing_to_say_about_the_museum(museum, colours, tmp_path):
    engine, _ = museum
    assert complaints(engine.export("glb", colours), tmp_path) == []


@pytest.mark.parametrize("colours", COLOURS)
def test_nor_about_a_small_model(colours, tmp_path):
    cameras = camera_row(2, size=(16, 12))
    settings, first = Settings(n_init=2), Frame(0, tuple(see(camera) for camera in cameras))
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    model.update(first)
    mesh = model.mesh() if colours == "vertex" else model.textured_mesh()
    assert complaints(to_file(mesh, "glb"), tmp_path) == []


@pytest.mark.parametrize("mesh", [ColouredMesh.joined([]), TexturedMesh(())], ids=["vertex", "texture"])
def test_nor_about_an_empty_one(mesh, tmp_path):
    assert complaints(to_file(mesh, "glb"), tmp_path) == []


def test_but_it_does_see_what_is_wrong(tmp_path):
    data = to_file(ColouredMesh(np.eye(3), np.array([[0, 1, 2]], np.int32), np.eye(3, dtype=np.float32)), "glb")
    assert complaints(data, tmp_path) == []
    assert complaints(data.replace(b'"VEC4"', b'"VEC2"'), tmp_path)
