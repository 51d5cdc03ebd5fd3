"""3D effects in the engine: where projected pictures and added meshes are, in both eyes, and what hides them."""

from __future__ import annotations

import dataclasses
import threading

import numpy as np
import pytest
from farside.engine.io.effect_files import read_mesh
from farside.engine.kernels.rendering.added_mesh import ADDED
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Perspective, Pose
from farside.engine.rig.effects import AddedMesh, Projector
from farside.engine.rig.frame import Fault
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from support import effects as room
from support.rooms import BOX_X, BOX_Y, WALL_X, WALL_Y, camera_row

FOV = 0.8
HEAD = StereoView.symmetric(Pose((0.1, 0.05, 0.0)), 240, 180, 1.2, 0.1)
OTHER = HEAD.moved(Pose.from_euler((0.4, -0.5, 0.3), 0.2, 0.08, 0.15))
PROJECTOR = Projector(room.looking_at_the_wall(-0.9, 0.3), FOV)
WHOLE = Projector(room.looking_at_the_wall(), 1.0, 1.0)  # more than the wall behind the person
PERSON = {"person_y": 0.0}


def playing(*options, quality="balanced", cameras=None, **settings):
    """An engine that has taken a frame of each of the options."""
    cameras = cameras or camera_row(3, (160, 120))
    engine = Engine(cameras, Settings.preset(quality, **settings))
    for index, one in enumerate(options):
        engine.update(room.frame(index, cameras, **one), {"head": HEAD})
    return engine


def eyes(engine, head=HEAD):
    pair = engine.render(head, "head")
    return pair.left, pair.right


def luma(picture):
    return picture.texture.y.astype(float)


def same(a, b):
    """Whether two pictures are the same bit for bit."""
    pairs = [(getattr(a.texture, name), getattr(b.texture, name)) for name in ("y", "cb", "cr")]
    return all(np.array_equal(x, y) for x, y in (*pairs, (a.disparity, b.disparity), (a.winner, b.winner)))


def shifted(projector, y, z=0.0):
    """A projector that is elsewhere and looks in the same direction."""
    x0, y0, z0 = projector.pose.position
    return dataclasses.replace(projector, pose=Pose((x0, y0 + y, z0 + z), projector.pose.orientation))


def cut(mask):
    """Pixels of a mask whose neighbours within two pixels all belong to it."""
    padded = np.pad(mask, 2, constant_values=True)
    h, w = mask.shape
    return np.all([padded[j : j + h, i : i + w] for j in range(5) for i in range(5)], axis=0)


def discs_seen(picture, projector=PROJECTOR, places=room.DISCS, bare=WALL_Y):
    """Where each disc's middle is in a picture, pixels."""
    excess = luma(picture) - bare
    v, u = np.mgrid[0 : picture.camera.height, 0 : picture.camera.width] + 0.5
    found = []
    for expected in picture.camera.project(room.on_the_wall(projector.pose, FOV, places))[0]:
        near = np.where(np.hypot(u - expected[0], v - expected[1]) < 14, np.maximum(excess, 0), 0)
        assert near.max() > 400
        found.append(((near * u).sum() / near.sum(), (near * v).sum() / near.sum()))
    return np.array(found)


@pytest.mark.parametrize("quality", ["fast", "balanced", "best"])
@pytest.mark.parametrize("head", [HEAD, OTHER], ids=["in the rig", "elsewhere"])
def test_a_picture_is_where_the_projector_throws_it_in_both_eyes(quality, head):
    engine = playing({}, {}, quality=quality)
    engine.put_effect("discs", PROJECTOR, room.discs())
    for picture in eyes(engine, head):
        expected, _ = picture.camera.project(room.on_the_wall(PROJECTOR.pose, FOV, room.DISCS))
        np.testing.assert_allclose(discs_seen(picture), expected, atol=0.3)


def test_a_picture_is_in_the_same_place_on_the_backdrop():
    """The person leaves a hole, which shows the backdrop, which is drawn farther away than the wall is."""
    engine = playing({}, {}, {"person_y": 0.25, "half": 0.6}, n_render=1, delta_m=0.15)
    projector = shifted(Projector(room.looking_at_the_wall(0.9, 0.3), FOV), -0.17)
    middle = room.DISCS[1:2]
    away = HEAD.moved(Pose((0.0, -0.9, 0.0)))
    engine.update(room.frame(3, engine.cameras, person_y=0.25, half=0.6), {"head": away})
    bare, _ = eyes(engine, away)
    engine.put_effect("discs", projector, room.discs())
    left, _ = eyes(engine, away)
    (u, v) = left.camera.project(room.on_the_wall(projector.pose, FOV, middle))[0][0]
    backdrop = left.winner == len(left.report.views)
    assert backdrop[int(v) - 3 : int(v) + 4, int(u) - 3 : int(u) + 4].all()
    assert 1 / left.disparity[int(v), int(u)] == pytest.approx(WALL_X + 0.15, abs=0.01)
    np.testing.assert_allclose(discs_seen(left, projector, middle, luma(bare))[0], (u, v), atol=0.3)


def test_a_pilaster_casts_a_shadow_which_is_where_it_should_be():
    engine = playing({"pilaster": True}, {"pilaster": True})
    before = eyes(engine)
    projector = Projector(room.looking_at_the_wall(-1.5), 1.2)
    engine.put_effect("white", projector, room.white())
    (x0, x1), (y0, y1) = room.PILASTER
    start = np.array(projector.pose.position)
    for old, new in zip(before, eyes(engine), strict=True):
        depth, _ = room.room(new.camera, pilaster=True)
        v, u = np.mgrid[0 : new.camera.height, 0 : new.camera.width] + 0.5
        points = new.camera.unproject(np.stack([u, v], -1), depth)
        rays = points - start
        low, high = np.array([x0, y0, -9.0]) + 0.02, np.array([x1, y1, 9.0]) - 0.02
        inner = room.depth_of_box(start, rays, low, high) < 0.99
        outer = room.depth_of_box(start, rays, low - 0.06, high + 0.06) < 0.999
        seen = (luma(new) - luma(old))[2:-2, 2:-2]
        shadow, light = inner[2:-2, 2:-2], ~outer[2:-2, 2:-2]
        inside = np.abs(depth - WALL_X).argmin() >= 0 and (points[..., 2] ** 2 < 0.6)[2:-2, 2:-2]
        shadow, light = shadow & inside, light & inside & (np.abs(points[..., 1]) < 1.2)[2:-2, 2:-2]
        assert shadow.sum() > 300
        assert light.sum() > 3000
        assert (np.abs(seen[shadow]) < 1).mean() > 0.98
        assert (seen[light] > 300).mean() > 0.98


@pytest.mark.parametrize("quality", ["fast", "balanced", "best"])
def test_a_person_before_the_wall_is_not_painted(quality):
    engine = playing({}, {}, PERSON, quality=quality)
    before = eyes(engine)
    engine.put_effect("white", WHOLE, room.white())
    for old, new in zip(before, eyes(engine), strict=True):
        start, rays = room.directions(new.camera)
        at = start + ((BOX_X - start[0]) / rays[..., 0])[..., None] * rays
        away = np.maximum(np.abs(at[..., 1]), np.abs(at[..., 2]))
        person, wall = away < 0.26, (away > 0.36) & (away < 0.6)
        assert person.sum() > 500
        np.testing.assert_array_equal(new.texture.y[person], old.texture.y[person])
        assert (np.abs(luma(new)[person] - BOX_Y) < 20).all()
        assert (luma(new)[wall] > 900).mean() > 0.995


@pytest.mark.parametrize(("blend", "strength", "expected"), [("mix", 0.25, 460), ("add", 0.25, 519), ("add", 1, 1023)])
def test_strength_and_blending(blend, strength, expected):
    engine = playing({}, {})
    engine.put_effect("white", dataclasses.replace(WHOLE, strength=strength, blend=blend), room.white())
    for picture in eyes(engine):
        assert np.median(luma(picture)[80:100, 110:130]) == pytest.approx(expected, abs=1.5)


def test_live_video_of_a_camera_is_thrown_and_goes_on():
    cameras = camera_row(3, (160, 120))
    engine = playing({}, {}, cameras=cameras)
    wide = dataclasses.replace(WHOLE, camera="v1", fov_rad=1.5)
    engine.put_effect("live", wide)
    assert (np.abs(luma(eyes(engine)[0]) - WALL_Y) < 12).all()
    engine.update(room.frame(2, cameras, **PERSON), {"head": HEAD})
    # The projector is where the camera is, and has a wider field of view: the picture of the person is larger than what
    # the person hides of the wall.
    shown = luma(eyes(engine)[0])
    projector = Perspective.from_fov(160, 120, wide.fov_rad)
    person = (0.3 / BOX_X) * cameras[1].projection.fx / projector.fx * WALL_X
    assert person > 0.64 > 0.54 > 0.3 * WALL_X / BOX_X
    (u, v), _ = eyes(engine)[0].camera.project((WALL_X, 0.6, 0.0))
    assert shown[int(v), int(u)] > 700
    lost = room.frame(3, cameras, **PERSON)
    views = list(lost.views)
    views[1] = dataclasses.replace(views[1], fault=Fault("missing"))
    engine.update(dataclasses.replace(lost, views=tuple(views)), {"head": HEAD})
    assert luma(eyes(engine)[0])[int(v), int(u)] > 700  # the last picture stays


def test_a_cube_behind_a_person_is_hidden_by_them_and_hides_the_wall():
    engine = playing({}, {}, PERSON)
    before = eyes(engine)
    middle, scale = np.array([3.2, 0.3, 0.05]), 0.25
    engine.put_effect("cube", AddedMesh(Pose(tuple(middle)), scale), read_mesh(room.cube_glb()))
    for old, new in zip(before, eyes(engine), strict=True):
        start, rays = room.directions(new.camera)
        cube = room.depth_of_box(start, rays, middle - scale, middle + scale)
        scene, _ = room.room(new.camera, **PERSON)
        shown = cube < scene
        assert 300 < shown.sum() < (cube < np.inf).sum() - 100  # some of it is behind the person
        inside, outside = cut(shown), cut(~shown)
        found = new.winner == ADDED
        assert found[inside].all()
        assert not found[outside].any()
        np.testing.assert_allclose(1 / new.disparity[inside], cube[inside], rtol=1e-3)
        np.testing.assert_array_equal(new.texture.y[outside], old.texture.y[outside])
        assert luma(new)[inside].std() > 30  # colours of corners go over into one another


def test_what_is_moved_is_elsewhere_in_the_next_picture_and_what_is_removed_leaves_no_trace():
    engine = playing({}, {}, PERSON)
    bare = eyes(engine)
    engine.put_effect("discs", PROJECTOR, room.discs())
    engine.put_effect("cube", AddedMesh(Pose((3.0, 0.9, 0.0)), 0.2), read_mesh(room.cube_glb()))
    first = eyes(engine)
    assert not same(first[0], bare[0])
    moved = shifted(PROJECTOR, 0.45, -0.2)
    engine.put_effect("discs", moved)
    engine.put_effect("cube", AddedMesh(Pose((3.0, -0.9, 0.0)), 0.2))
    second = eyes(engine)
    cubes = [np.argwhere(picture.winner == ADDED).mean(axis=0)[1] for picture in (first[0], second[0])]
    assert cubes[1] > cubes[0] + 60
    (u, v) = second[0].camera.project(room.on_the_wall(moved.pose, FOV, room.DISCS[:1]))[0][0]
    assert luma(second[0])[int(v), int(u)] > 900
    assert luma(first[0])[int(v), int(u)] < 600
    engine.remove_effect("discs")
    engine.remove_effect("cube")
    engine.remove_effect("cube")  # it is not there any more
    assert all(same(a, b) for a, b in zip(eyes(engine), bare, strict=True))


def test_effects_can_be_put_before_the_first_frame():
    cameras = camera_row(3, (160, 120))
    engine = Engine(cameras, Settings.preset("balanced"))
    engine.put_effect("white", WHOLE, room.white())
    engine.put_effect("cube", AddedMesh(Pose((3.0, 0.9, 0.0)), 0.2), read_mesh(room.cube_glb()))
    engine.update(room.frame(0, cameras), {"head": HEAD})
    left, _ = eyes(engine)
    assert luma(left)[90, 120] == pytest.approx(940, abs=1)
    assert (left.winner == ADDED).any()


def test_without_a_background_nothing_is_thrown_but_meshes_are_there():
    engine = playing({}, background=False)
    bare, _ = eyes(engine)
    engine.put_effect("white", WHOLE, room.white())
    assert same(eyes(engine)[0], bare)
    engine.put_effect("cube", AddedMesh(Pose((3.0, 0.0, 0.0)), 0.2), read_mesh(room.cube_glb()))
    assert (eyes(engine)[0].winner == ADDED).any()


def test_an_effect_that_is_refused_changes_nothing():
    engine = playing({}, {})
    engine.put_effect("white", WHOLE, room.white())
    before = eyes(engine)
    with pytest.raises(ValueError, match="camera: 'v9': expected one of v0, v1, v2"):
        engine.put_effect("white", dataclasses.replace(WHOLE, camera="v9"))
    assert all(same(a, b) for a, b in zip(eyes(engine), before, strict=True))


def test_effects_are_put_and_moved_while_frames_are_taken_and_pictures_drawn():
    cameras = camera_row(3, (96, 64))
    engine = playing({}, cameras=cameras)
    failures: list[BaseException] = []

    def keep(work, times):
        try:
            for k in range(times):
                work(k)
        except BaseException as error:
            failures.append(error)

    def put(k):
        moved = dataclasses.replace(WHOLE, pose=room.looking_at_the_wall(0.1 * (k % 5)))
        engine.put_effect("white", moved, room.white())
        engine.put_effect("cube", AddedMesh(Pose((3.0, 0.1 * (k % 7), 0.0)), 0.2), read_mesh(room.cube_glb()))
        if k % 4 == 3:
            engine.remove_effect("white")

    threads = [
        threading.Thread(target=keep, args=(put, 12)),
        threading.Thread(target=keep, args=(lambda k: eyes(engine), 12)),
    ]
    for thread in threads:
        thread.start()
    keep(lambda k: engine.update(room.frame(k + 1, cameras, person_y=0.05 * k), {"head": HEAD}), 12)
    for thread in threads:
        thread.join()
    assert failures == []
    assert (eyes(engine)[0].winner == ADDED).any()


def test_shadows_follow_the_background():
    """A person is there from the start and hides the wall from the projector; they leave, and leave no shadow."""
    cameras = camera_row(3, (160, 120))
    engine = playing({"person_y": 0.9}, cameras=cameras)
    engine.put_effect("white", shifted(WHOLE, 0.9), room.white())
    (u, v), _ = eyes(engine)[0].camera.project((WALL_X, 0.7, 0.0))
    here = int(v), int(u)
    assert luma(eyes(engine)[0])[here] < 900
    for index in range(1, 20):
        engine.update(room.frame(index, cameras), {"head": HEAD})
    assert (luma(eyes(engine)[0])[here[0] - 20 : here[0] + 20, here[1] - 20 : here[1] + 20] > 900).mean() > 0.99
