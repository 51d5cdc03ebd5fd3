"""A model that begins with an earlier one: it shows what the present views do not, and obeys what they see."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from farside.engine.background.model import BackgroundModel
from farside.engine.background.saved_model import SavedModel
from farside.engine.background.seed_files import read_seed, seed_of
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.refinement import refined
from farside.engine.geometry.scene_scale import Scene
from farside.engine.io.coloured_meshes import ColouredMesh, srgb_from_ycbcr
from farside.engine.io.glb import to_glb
from farside.engine.io.mesh_files import to_file
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.rig.camera import Perspective, Pose
from farside.engine.rig.frame import Fault, Frame, Texture, View
from farside.engine.settings import Settings
from PIL import Image
from support.models import near_points, pbi_of, picture_of
from support.rooms import BOX_X, BOX_Y, WALL_X, camera_row, frame, see
from support.texels import at

SETTINGS = Settings(n_init=3)
FORMATS = ("saved", "texture", "vertex")


def coloured(view, shift=0):
    """The view with colours that change slowly over the wall, and by `shift`."""
    camera = view.camera
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    at = camera.unproject(np.stack([u, v], -1), np.full(u.shape, WALL_X - camera.pose.position[0]))
    luma = 450 + shift + 40 * at[..., 1] + 30 * at[..., 2]
    half = at[::2, ::2]
    cb, cr = 500 + 10 * half[..., 1], 530 - 10 * half[..., 2]
    return View(camera, Texture(*(np.rint(p).astype(np.uint16) for p in (luma, cb, cr))), view.codes)


def model_of(views, seed=None, settings=SETTINGS):
    cameras, first = [view.camera for view in views], Frame(0, tuple(views))
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first), seed=seed)
    model.update(first)
    return model


def saved(model):
    return SavedModel.of(model.cameras, 0, model, None)


def through_file(model, kind, folder):
    """A model as a seed, by way of a file."""
    path = folder / f"{kind}.file"
    if kind == "saved":
        saved(model).write(path)
    else:
        path.write_bytes(to_file(model.textured_mesh() if kind == "texture" else model.mesh(), "glb"))
    return read_seed(path)


def empty_room(cameras=None, shift=0):
    return model_of([coloured(see(camera), shift) for camera in cameras or camera_row()])


def shown(model, camera, present=None):
    """A PBI's depth, luma and chroma, without the outermost pixels."""
    table = None
    if present is not None:
        scene = model.state().scene.scene()
        options = [scene.triangulation(view.camera, model.settings) for view in present]
        table = ViewTable([PreparedView(v, o, scene.origin) for v, o in zip(present, options, strict=True)])
    view = model.render_pbi(camera, table, near=0.1).view
    texture = view.texture
    depth, luma = camera.depth.depth(view.codes)[2:-2, 2:-2], texture.y[2:-2, 2:-2].astype(int)
    return depth, luma, texture.cb[1:-1, 1:-1], texture


@pytest.mark.parametrize("kind", FORMATS)
def test_what_someone_hides_since_the_beginning_is_known_from_before(tmp_path, kind):
    seed = through_file(empty_room(), kind, tmp_path)
    views = [coloured(see(camera, box_y=0.0, half=0.8)) for camera in camera_row()]
    eye = dataclasses.replace(camera_row()[1], pose=Pose((-0.1, 0.15, 0.05)))
    without, _ = pbi_of(model_of(views), eye)
    hidden = np.isnan(without) | (without < WALL_X - 0.5)
    assert hidden.mean() > 0.05
    model = model_of(views, seed)
    depth, luma, cb, _ = shown(model, eye)
    np.testing.assert_allclose(depth, WALL_X + 0.1, atol=0.02)
    expected = coloured(see(eye))
    # Through 8 bits and a JPEG, a step is four codes of luma; at vertices nothing is lost but by the spacing.
    np.testing.assert_allclose(luma, expected.texture.y[2:-2, 2:-2], atol=8)
    np.testing.assert_allclose(cb, expected.texture.cb[1:-1, 1:-1], atol=8)
    assert near_points(model).size == 0  # who stands there is in front of a known wall


@pytest.mark.parametrize("kind", FORMATS)
def test_the_present_views_colours_win_where_they_see_the_surface(tmp_path, kind):
    seed = through_file(empty_room(shift=200), kind, tmp_path)
    views = [coloured(see(camera)) for camera in camera_row()]
    model = model_of(views, seed)
    _, luma, _, _ = shown(model, camera_row()[1], views)
    inner = (slice(4, -4), slice(4, -4))
    np.testing.assert_allclose(luma[inner], coloured(see(camera_row()[1])).texture.y[2:-2, 2:-2][inner], atol=2)
    unseeded, seeded = model_of(views).counts()["s_pbs"], model.counts()["s_pbs"]
    assert seeded < 3 * unseeded  # what they show is not there twice


@pytest.mark.parametrize("kind", FORMATS)
def test_what_has_left_since_is_culled(tmp_path, kind):
    before = [see(camera, box_y=0.0, half=0.2) for camera in camera_row()]
    for view in before:  # nothing but the box: the model then takes it for background
        view.codes[view.texture.y != BOX_Y] = 0
    earlier = model_of(before)
    assert near_points(earlier).size > 0
    model = model_of([see(camera) for camera in camera_row()], through_file(earlier, kind, tmp_path))
    assert near_points(model).size == 0


@pytest.mark.parametrize("settings", [SETTINGS, Settings.preset("paper"), Settings(viewing_space=(0, 0, 0, 1.0))])
def test_surfaces_outside_of_all_pictures_stay(tmp_path, settings):
    wide = [
        dataclasses.replace(camera, projection=Perspective.from_fov(192, 96, 2.2)) for camera in camera_row()
    ]
    seed = through_file(empty_room(wide), "texture", tmp_path)
    cameras = camera_row()
    model = model_of([coloured(see(camera)) for camera in cameras], seed, settings)
    for index in range(1, 8):  # all cameras had their turns
        model.update(Frame(index, tuple(coloured(see(camera)) for camera in cameras)))
    eye = dataclasses.replace(wide[1], projection=Perspective.from_fov(120, 60, 1.9))
    depth, luma, _, _ = shown(model, eye)
    assert np.isnan(depth).mean() < 0.01
    inner = np.isfinite(depth)
    np.testing.assert_allclose(luma[inner], coloured(see(eye)).texture.y[2:-2, 2:-2][inner], atol=8)


def test_a_camera_that_is_moved_may_cull_what_no_camera_saw(tmp_path):
    wide = [dataclasses.replace(camera, projection=Perspective.from_fov(192, 96, 2.2)) for camera in camera_row()]
    near = [see(camera, box_y=2.5, half=0.3) for camera in wide]
    for view in near:
        view.codes[view.texture.y != BOX_Y] = 0
    seed = through_file(model_of(near), "vertex", tmp_path)
    cameras = camera_row()
    model = model_of([see(camera) for camera in cameras], seed)
    before = len(near_points(model))
    assert before > 0
    turned = dataclasses.replace(cameras[0], pose=Pose.from_euler(cameras[0].pose.position, 0.6, 0.0, 0.0))
    moved = [turned, *cameras[1:]]
    model.recapture(0, see(turned, box_y=2.5, half=0.3), np.array(IDENTITY))
    for index in range(1, 4):
        model.update(frame(index, moved, box_y=2.5, half=0.3))
    assert len(near_points(model)) > 0.5 * before
    for index in range(4, 14):  # it leaves
        model.update(frame(index, moved))
    assert len(near_points(model)) < 0.2 * before


@pytest.mark.parametrize("kind", FORMATS)
def test_a_seeded_model_continues_bit_for_bit_from_a_file(tmp_path, kind):
    seed = through_file(empty_room(), kind, tmp_path)
    # A little behind the wall: of two surfaces at exactly the same depth, either may be hit first.
    behind = [dataclasses.replace(part, vertices=part.vertices + np.array([0.003, 0, 0])) for part in seed.parts]
    seed = dataclasses.replace(seed, parts=tuple(behind))
    cameras = camera_row()
    walk = [frame(index, cameras, box_y=0.1 * index, half=0.5) for index in range(8)]
    model = model_of(walk[0].views, seed)
    for one in walk[1:4]:
        model.update(one)
    saved(model).write(tmp_path / "again.farside")
    read = SavedModel.read(tmp_path / "again.farside")
    assert read.about().seeded > 0
    other = BackgroundModel.from_state(read.model)
    for one in walk[4:]:
        assert dataclasses.replace(other.update(one), stages={}) == dataclasses.replace(model.update(one), stages={})
    for present in (None, walk[-1].views):
        for found, expected in zip(
            shown(other, cameras[0], present)[:3], shown(model, cameras[0], present)[:3], strict=True
        ):
            np.testing.assert_array_equal(found, expected)
    assert to_glb(other.textured_mesh()) == to_glb(model.textured_mesh())


def followed(index, box=True, shift=0):
    """A frame of a rig whose first camera moves away along the wall, while someone walks."""
    cameras = camera_row()
    cameras[0] = dataclasses.replace(cameras[0], pose=Pose((0.0, -0.4 - 0.25 * index, 0.0)))
    who = {"box_y": 0.1 * index, "half": 0.5} if box else {}
    return Frame(index, tuple(coloured(see(camera, **who), shift) for camera in cameras))


@pytest.mark.parametrize("kind", FORMATS)
def test_a_seeded_model_of_a_moving_rig_keeps_its_atlases_and_continues_bit_for_bit(tmp_path, kind):
    seed = through_file(empty_room(), kind, tmp_path)
    model = model_of(followed(0).views, seed)
    atlases = [item.number for item in model.state().atlases]
    assert atlases
    numbers = set()
    for index in range(1, 9):
        model.update(followed(index))
        numbers |= {capture.number for capture in model.captures}
    assert numbers.isdisjoint(atlases)
    assert list(model._captures.snapshot().atlases) == atlases
    assert len(numbers) < 9  # those of captures that were dropped are given again
    saved(model).write(tmp_path / "again.farside")
    read = SavedModel.read(tmp_path / "again.farside")
    assert [item.number for item in read.model.atlases] == atlases
    assert read.model.remains
    other = BackgroundModel.from_state(read.model)
    for index in range(9, 15):
        one = followed(index)
        assert dataclasses.replace(other.update(one), stages={}) == dataclasses.replace(model.update(one), stages={})
    assert [item.number for item in model.state().atlases] == atlases
    assert to_glb(other.textured_mesh()) == to_glb(model.textured_mesh())
    assert to_file(other.mesh(), "ply") == to_file(model.mesh(), "ply")


@pytest.mark.parametrize("kind", FORMATS)
def test_what_a_moving_camera_has_left_is_a_seed_with_its_colours(tmp_path, kind):
    before = model_of(followed(0, box=False).views)
    for index in range(1, 9):
        before.update(followed(index, box=False))
    assert saved(before).model.remains
    seed = through_file(before, kind, tmp_path)
    far = dataclasses.replace(camera_row()[0], name="far", pose=Pose((0.0, -2.0, 0.0)))
    views = [coloured(see(camera), 200) for camera in camera_row()]
    without, _, _, _ = shown(model_of(views), far)
    model = model_of(views, seed)
    depth, luma, cb, _ = shown(model, far)
    only_before = np.isnan(without) & ~np.isnan(depth)
    assert only_before.mean() > 0.25
    np.testing.assert_allclose(depth[only_before], WALL_X, atol=0.02)
    expected = coloured(see(far))
    limit = 2 if kind == "saved" else 8  # 8 bits and a JPEG: see above
    assert np.abs(luma - expected.texture.y[2:-2, 2:-2])[only_before].max() <= limit
    assert np.abs(cb.astype(int) - expected.texture.cb[1:-1, 1:-1])[only_before[::2, ::2]].max() <= limit


@pytest.mark.parametrize("settings", [SETTINGS, Settings(n_init=3, culling_stride=1, rays_by_triangle=False)])
def test_what_only_a_camera_sees_that_is_left_out_at_first_stays_until_its_turn(tmp_path, settings):
    """A card that nobody else sees; the camera then sees past it."""
    cameras = camera_row()
    turned = dataclasses.replace(cameras[0], pose=Pose.from_euler(cameras[0].pose.position, 0.9, 0.0, 0.0))
    rig = [turned, *cameras[1:]]
    path = tmp_path / "card.glb"
    card = np.array([[BOX_X, y, z] for y in (2.5, 3.1) for z in (-0.3, 0.3)])
    grey = np.full((4, 3), 0.5, np.float32)
    path.write_bytes(to_glb(ColouredMesh(card, np.array([[0, 1, 2], [2, 1, 3]], np.int32), grey)))
    views = [dataclasses.replace(see(turned), fault=Fault("missing")), *map(see, rig[1:])]
    model = model_of(views, read_seed(path), settings)
    before = np.count_nonzero(near_points(model)[:, 1] < 4.0)
    assert before > 0
    for index in range(1, 7):
        model.update(Frame(index, tuple(views)))
    assert np.count_nonzero(near_points(model)[:, 1] < 4.0) == before
    for index in range(7, 17):
        model.update(frame(index, rig))
    assert np.count_nonzero(near_points(model)[:, 1] < 4.0) == 0


@pytest.mark.parametrize("kind", FORMATS)
def test_exported_textures_have_the_seeds_colours(tmp_path, kind):
    seed = through_file(empty_room(), kind, tmp_path)
    model = model_of([coloured(see(camera, box_y=0.0, half=0.8)) for camera in camera_row()], seed)
    for part in model.textured_mesh().parts:
        found = at(picture_of(part.picture), part.uv[part.triangles].mean(axis=1))
        place = part.vertices[part.triangles].mean(axis=1)
        luma, cb, cr = 450 + 40 * place[:, 1] + 30 * place[:, 2], 500 + 10 * place[:, 1], 530 - 10 * place[:, 2]
        expected = srgb_from_ycbcr(np.stack([luma, cb, cr], -1))
        np.testing.assert_allclose(found, 255 * expected, atol=6)


def test_a_wall_of_two_triangles_is_divided_and_only_its_hidden_part_stays(tmp_path):
    wall = np.array([[WALL_X, y, z] for y in (-4.0, 4.0) for z in (-3.0, 3.0)])
    grey = np.full((4, 3), 0.5, np.float32)
    path = tmp_path / "wall.glb"
    path.write_bytes(to_glb(ColouredMesh(wall, np.array([[0, 1, 2], [2, 1, 3]], np.int32), grey)))
    model = model_of([see(camera, box_y=0.0, half=0.8) for camera in camera_row()], read_seed(path))
    depth, luma, _, _ = shown(model, camera_row()[1])
    np.testing.assert_allclose(depth, WALL_X, atol=0.02)
    hidden = np.abs(luma - (64 + 876 * 0.5)) < 3
    assert 0.05 < hidden.mean() < 0.9


def other_programs_wall(path):
    """The wall as a file of another program: two triangles, with a texture of dark and bright stripes, one pair a
    metre along y."""
    y, z = np.array([-4.0, 4.0, -4.0, 4.0]), np.array([-3.0, -3.0, 3.0, 3.0])
    stripes = np.full((64, 64, 3), 60, np.uint8)
    stripes[:, 32:] = 200
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(stripes), metallicFactor=0.0)
    visual = trimesh.visual.TextureVisuals(uv=np.stack([y, z], -1), material=material)
    gltf = np.stack([-y, z, np.zeros(4)], -1)  # x right, y up
    wall = trimesh.Trimesh(gltf, [[0, 1, 2], [2, 1, 3]], visual=visual, process=False)
    scene = trimesh.Scene()
    scene.add_geometry(wall, transform=trimesh.transformations.translation_matrix([0.0, 0.0, -WALL_X]))
    path.write_bytes(scene.export(file_type="glb"))


def test_a_texture_that_repeats_lies_where_another_program_put_it(tmp_path):
    other_programs_wall(tmp_path / "wall.glb")
    model = model_of([see(camera, box_y=0.0, half=0.8) for camera in camera_row()], read_seed(tmp_path / "wall.glb"))
    eye = camera_row()[1]
    depth, luma, _, _ = shown(model, eye)
    np.testing.assert_allclose(depth, WALL_X, atol=0.02)
    v, u = np.mgrid[0:64, 0:96] + 0.5
    y = eye.unproject(np.stack([u, v], -1), np.full(u.shape, WALL_X))[2:-2, 2:-2, 1]
    stripes = np.abs((2 * y) % 1.0 - 0.5) < 0.35  # away from borders of stripes
    seeded = (np.abs(y) < 0.5) & (np.abs(v[2:-2, 2:-2] - 32) < 8) & stripes  # behind the box, for all cameras
    expected = np.where(y % 1.0 < 0.5, 64 + 876 * 60 / 255, 64 + 876 * 200 / 255)
    assert np.count_nonzero(seeded) > 100
    np.testing.assert_allclose(luma[seeded], expected[seeded], atol=4)


def test_divided_triangles_are_the_same_surface_without_gaps():
    rng = np.random.default_rng(4)
    points, uv = rng.uniform(-3, 3, (12, 3)), rng.uniform(0, 900, (12, 2)).astype(np.float32)
    triangles = np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6], [7, 8, 9]], np.int32)
    found, corners, places = refined(points, triangles, uv, 0.2, 0.5, 100.0)

    def area(vertices, faces):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()

    assert area(found, corners) == pytest.approx(area(points, triangles), rel=1e-9)
    ends = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    seen = found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 0.5)
    assert np.linalg.norm(seen[ends[:, 0]] - seen[ends[:, 1]], axis=1).max() <= 0.2
    assert np.abs(places[ends[:, 0]] - places[ends[:, 1]]).max() <= 100.0
    # A side inside of the surface belongs to two triangles: the diagonal of the first two is divided alike on both.
    _, uses = np.unique(ends, axis=0, return_counts=True)
    outline = np.count_nonzero(uses == 1)
    assert set(np.unique(uses)) == {1, 2}
    assert outline < np.count_nonzero(uses == 2)


@pytest.mark.parametrize("change", ["cut", "bit", "none"])
def test_a_seed_that_cannot_be_read_is_refused(tmp_path, change):
    path = tmp_path / "room.farside"
    saved(empty_room()).write(path)
    data = bytearray(path.read_bytes())
    if change == "cut":
        del data[-1:]
    elif change == "bit":
        data[len(data) // 2] ^= 4
    else:
        data = bytearray(b"nothing of the kind")
    path.write_bytes(data)
    with pytest.raises(ValueError, match=f"^{path}: .*: expected "):
        read_seed(path)


def test_a_saved_seed_has_the_captures_pictures():
    model = empty_room()
    seed = seed_of(saved(model))
    assert sum(len(part.triangles) for part in seed.parts) == model.counts()["s_pbs_valid"]
    assert not any(part.atlas.scattered for part in seed.parts)
    np.testing.assert_array_equal(seed.parts[0].atlas.y, model.captures[0].image.texture.y)
