"""Reference cameras that move (section 4.2): what they add, what stays of it, and what that costs."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.capture import Remains
from farside.engine.background.model import BackgroundModel
from farside.engine.background.newly_visible import newly_visible
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.io.coloured_meshes import srgb_from_ycbcr
from farside.engine.kernels.background.flags import KEPT, UPDATED
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame, View
from farside.engine.settings import Settings
from oracle import coverage as slow_coverage
from support.models import SETTINGS, model_of, near_points, picture_of
from support.rooms import BOX_X, BOX_Y, WALL_X, WALL_Y, camera_row, frame, see, texture_of

LATER_Y = 700


def at(camera, y, z=0.0):
    return dataclasses.replace(camera, pose=Pose((0.0, y, z)))


def relit(view, luma):
    """A view whose wall has another colour."""
    return View(view.camera, texture_of(np.where(view.texture.y == WALL_Y, luma, view.texture.y)), view.codes)


def shown(model, camera, seen=None):
    """Depth in metres (nan: a hole) and luma of the background seen from a camera, without the outermost pixels."""
    present = None
    if seen is not None:
        scene, settings = model.state().scene.scene(), model.settings
        views = [PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in seen.views]
        present = ViewTable(views)
    view = model.render_pbi(camera, present).view
    return view.camera.depth.depth(view.codes)[1:-1, 1:-1], view.texture.y[1:-1, 1:-1]


def on_box(model):
    """Corners of valid triangles where the box was."""
    points = model.mesh().vertices
    return points[np.isclose(points[:, 0], BOX_X, atol=0.05) & (np.abs(points[:, 1]) < 0.35)]


def test_a_moving_camera_sees_behind_what_hides_the_wall_from_the_others():
    (fixed,) = camera_row(1)
    moving = dataclasses.replace(fixed, name="m")
    settings = Settings(n_init=2, n_update=1)
    begin = Frame(0, (see(fixed, 0.0), see(moving, 0.0)))
    model = BackgroundModel([fixed, moving], settings, Scene.of([fixed, moving], settings, begin))
    model.update(begin)
    reports = []
    for index in range(1, 11):
        place = at(moving, 0.18 * index)
        reports.append(model.update(Frame(index, (see(fixed, 0.0), relit(see(place, 0.0), LATER_Y)))))
    assert [report.group for report in reports[:3]] == [("v0",), ("m",), ("v0",)]
    assert sum(report.added for report in reports) > 0
    assert all(report.added == 0 for report in reports if report.group == ("v0",))
    depth, luma = shown(model, fixed)
    on_box = see(fixed, 0.0).texture.y[1:-1, 1:-1] == BOX_Y
    # Behind the box there is wall now, with the colours of the camera that has seen it.
    assert np.isclose(depth[on_box], WALL_X, atol=0.02).mean() > 0.9
    behind = on_box & np.isclose(depth, WALL_X, atol=0.02)
    assert (luma[behind] == LATER_Y).mean() > 0.95
    assert (luma[~on_box] == WALL_Y).mean() > 0.98  # and elsewhere what was there first


def test_what_a_moving_camera_has_seen_from_near_by_stays_when_it_looks_from_far_away():
    """As published, each camera's rays go through its pixels: from far away they miss most of the small triangles."""
    (fixed,) = camera_row(1)
    moving = dataclasses.replace(fixed, name="m")
    settings = Settings.preset("paper", n_init=2, n_update=1)
    begin = Frame(0, (see(fixed, 0.0), see(moving, 0.0)))
    model = BackgroundModel([fixed, moving], settings, Scene.of([fixed, moving], settings, begin))
    model.update(begin)
    places = [(0.25 * k, 0.3 * k) for k in range(1, 7)] + [(1.5 - 0.5 * k, 1.8) for k in range(1, 12)]
    for index, (x, y) in enumerate(places):
        place = dataclasses.replace(moving, pose=Pose((x, y, 0.0)))
        for turn in range(2):
            model.update(Frame(2 * index + turn + 1, (see(fixed, 0.0), see(place, 0.0))))
    depth, _luma = shown(model, fixed)
    on_box = see(fixed, 0.0).texture.y[1:-1, 1:-1] == BOX_Y
    assert np.isclose(depth[on_box], WALL_X, atol=0.05).mean() > 0.9


def test_what_the_capture_before_shows_is_no_candidate():
    """Only the border that comes into view, what is uncovered, and what waited for its turn."""
    camera = camera_row(1)[0]
    model, _first = model_of([camera], frame(0, [camera], 0.3), Settings(n_init=1))
    before, moved = model.captures[0], at(camera, 0.1)
    before.image.flags[10:14, 20:26] |= UPDATED
    after = model.recapture(0, see(moved, 0.3), np.array(IDENTITY))
    new = newly_visible(after, before, model.tolerances.delta) != 0
    step = camera.depth.step
    first = see(camera, 0.3)
    waits = before.image.flags & UPDATED != 0
    known = View(camera, first.texture, np.where(waits, np.uint16(0), first.codes))
    expected = slow_coverage.farther_pixels(see(moved, 0.3), [known], model.tolerances.delta, before.image.edge * step)
    np.testing.assert_array_equal(new, expected)
    assert expected[:, :1].all()  # the border
    assert 0.02 < new.mean() < 0.2
    assert new[9:15, 18:28].any()


def test_a_capture_that_adds_little_is_not_kept_until_there_is_more():
    camera = camera_row(1)[0]
    begin = see(camera)
    gap = begin.codes.copy()
    gap[20:23, 30:33] = 0  # nine pixels without depth
    begin = Frame(0, (View(camera, begin.texture, gap),))
    settings = Settings(n_init=1)
    model = BackgroundModel([camera], settings, Scene.of([camera], settings, begin))
    model.update(begin)
    # Pixels beyond the border are seen for the first time: as wide as the camera has moved.
    report = model.update(Frame(1, (see(at(camera, 1e-4)),)))
    assert report.candidates > 0
    assert model.captures[-1].image.flags.max() <= KEPT | UPDATED
    for index in range(2, 30):
        report = model.update(Frame(index, (see(at(camera, 0.02 * index)),)))
    assert model.counts()["p_pbs"] > 0
    depth, _luma = shown(model, at(camera, 0.3))
    np.testing.assert_allclose(depth, WALL_X, atol=0.02)


def test_a_walk_with_one_camera_leaves_a_model_of_all_that_it_saw():
    camera = camera_row(1)[0]
    settings = Settings(n_init=1)
    model, _first = model_of([camera], frame(0, [camera], 0.0), settings)
    path = np.linspace(0.0, 6.0, 61)
    for index, y in enumerate(path[1:], 1):
        model.update(frame(index, [at(camera, y)], 0.0))
    now = frame(61, [at(camera, path[-1])], 0.0)
    for y in (0.0, 1.5, 3.0, 4.5, 6.0):  # a viewer anywhere behind it
        depth, luma = shown(model, at(camera, y), now)
        view = see(at(camera, y), 0.0)
        truth = camera.depth.depth(view.codes)[1:-1, 1:-1]
        there = ~np.isnan(depth)
        assert there.mean() > 0.97
        assert np.isclose(depth, truth, atol=0.05)[there].mean() > 0.97
        assert (luma == view.texture.y[1:-1, 1:-1])[there].mean() > 0.95
    # The box is still there: nobody has seen past it.
    assert np.isclose(model.mesh().vertices[:, 0], BOX_X, atol=0.02).any()


def test_what_was_seen_past_leaves_the_model():
    """Someone who stood there when the camera passed has gone when it looks again."""
    camera = camera_row(1)[0]
    model, _first = model_of([camera], frame(0, [camera], 0.0), Settings(n_init=1))
    for index in range(1, 8):
        model.update(frame(index, [at(camera, 0.05 * index)], 0.0))
    assert len(on_box(model)) > 0
    away = dataclasses.replace(camera, pose=Pose.from_euler((0.0, 0.4, 0.0), 1.5, 0.0, 0.0))
    side = Frame(8, (dataclasses.replace(see(camera), camera=away),))  # a wall somewhere else
    model.update(side)
    assert len(on_box(model)) > 0  # unseen, it stays
    reports = [model.update(frame(index, [at(camera, 0.4 - 0.05 * (index - 8))])) for index in range(9, 13)]
    assert sum(report.culled for report in reports) > 0
    assert len(on_box(model)) == 0


def test_a_fixed_camera_sees_past_what_a_moving_one_has_added():
    fixed, moving = camera_row(2)
    model, _first = model_of([fixed, moving], frame(0, [fixed, moving]), SETTINGS)
    codes = see(fixed).codes.copy()
    codes[:] = 0  # it sees nothing for a while
    blind = View(fixed, see(fixed).texture, codes)
    for index in range(1, 9):  # the other one goes to where nobody was, and sees a box
        model.update(Frame(index, (blind, see(at(moving, 2.0 + 0.05 * index), 2.9, 0.35))))
    before = len(near_points(model))
    assert before > 30
    wide = at(fixed, 2.2)  # the fixed one is carried there: it sees the wall where the box was
    for index in range(9, 14):
        model.update(Frame(index, (see(wide), View(at(moving, 2.4), see(moving).texture, np.zeros_like(codes)))))
    assert len(near_points(model)) < 0.1 * before


def test_captures_and_memory_are_bounded_by_what_is_there():
    """To and fro along a wall: the second time adds nothing, and the number of captures stays small."""
    camera = camera_row(1)[0]
    model, _first = model_of([camera], frame(0, [camera]), Settings(n_init=1))
    there = np.linspace(0.0, 4.0, 81)[1:]
    for index, y in enumerate(there, 1):
        model.update(frame(index, [at(camera, y)]))
    first, number = model.memory, len(model.captures)
    remains = [capture for capture in model.captures if isinstance(capture, Remains)]
    assert 0 < len(remains) < 16
    full = model.captures[0].memory
    # Each of 80 captures has added a strip of a pixel or two; with the pixels round it, that is a tenth of a picture.
    assert sum(capture.memory for capture in remains) < 80 * 0.12 * full
    surfaces = sum(len(part) for part in (model._pbs.static, model._pbs.progressive))
    for index, y in enumerate(there[::-1], 81):
        report = model.update(frame(index, [at(camera, y)]))
        assert report.added == 0
    assert len(model.captures) <= number
    assert sum(len(part) for part in (model._pbs.static, model._pbs.progressive)) <= surfaces
    assert model.memory["surfaces"] <= 1.05 * first["surfaces"]  # the last capture was condensed meanwhile
    assert model.memory["images"] <= 1.05 * first["images"]


def test_an_exported_model_has_the_colours_of_all_captures():
    """Each strip of the wall has the colour of the capture that saw it first, also in textures."""
    camera = camera_row(1)[0]
    model, _first = model_of([camera], frame(0, [camera]), Settings(n_init=1))
    for index in range(1, 41):
        model.update(Frame(index, (relit(see(at(camera, 0.1 * index)), 300 + 10 * index),)))
    assert sum(isinstance(capture, Remains) for capture in model.captures) > 1
    plain, textured = model.mesh(), model.textured_mesh()
    assert sum(len(part.triangles) for part in textured.parts) == len(plain.triangles)
    reach = camera.unproject((0.5, 32.0), 4.0)[1]  # how far to the left the first picture reaches
    off = []
    for part in textured.parts:
        page = picture_of(part.picture)
        middles = part.vertices[part.triangles].mean(axis=1)
        u, v = np.floor(part.uv[part.triangles].mean(axis=1)).astype(int).T
        capture = np.ceil(np.clip((middles[:, 1] - reach) / 0.1, 0, None))  # which has seen it first
        luma = 300 + 10 * np.minimum(capture, 40)
        ycbcr = np.stack([luma, luma // 2, luma // 2 + 1], -1).astype(np.float32)
        expected = 255 * srgb_from_ycbcr(ycbcr)
        off.append(np.abs(page[v, u] - expected).max(axis=1))
    assert np.mean(np.concatenate(off) < 12) > 0.97


def test_numbers_of_captures_are_used_again():
    camera = camera_row(1)[0]
    model, _first = model_of([camera], frame(0, [camera]), Settings(n_init=1))
    for index in range(1, 100):
        model.update(frame(index, [at(camera, 0.001 * index)]))
    assert max(capture.number for capture in model.captures) < 12
    assert len(model._captures.table) < 12


@pytest.mark.parametrize("quality", ["balanced", "paper"])
def test_the_published_algorithm_follows_a_moving_camera_as_well(quality):
    camera = camera_row(1)[0]
    settings = Settings.preset(quality, n_init=1, n_update=1)
    model, _first = model_of([camera], frame(0, [camera]), settings)
    for index in range(1, 11):
        model.update(frame(index, [at(camera, 0.2 * index)]))
    for y in (0.0, 1.0, 2.0):
        depth, _luma = shown(model, at(camera, y))
        assert np.isclose(depth, WALL_X, atol=0.05).mean() > 0.95
