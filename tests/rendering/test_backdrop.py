"""The backdrop behind the warped views: it fills holes, and is hidden where present views see past it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.base.view_table import EDGE, TOLERANCE, Views
from farside.engine.kernels.rendering.backdrop import lay_backdrop
from farside.engine.kernels.rendering.present import present_depth
from farside.engine.kernels.rendering.records import DepthBuffer
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import View
from oracle.backdrop import Seen, lay
from support.rooms import BOX_X, WALL_X, camera_row, see, texture_of

ORIGIN = np.zeros(3)
CODING = DepthCoding(0.5, 20.0, 16, has_invalid=True)
PROJECTION = Perspective.from_fov(32, 24, 1.2)
PUSH = 0.1
HERE = Camera("here", PROJECTION, Pose(), CODING)


def flat(depth, *, camera=HERE, luma=500):
    """A view of a wall across the view axis; `depth`, m, may be an array with a value for each pixel; nan: no depth."""
    shape = (camera.height, camera.width)
    codes = camera.depth.codes(np.broadcast_to(np.asarray(depth, float), shape))
    return PreparedView(View(camera, texture_of(np.full(shape, luma)), codes), TriangulationOptions(0.0, 0.2), ORIGIN)


def layered(live, backdrop, present, *, push=PUSH, curve=0.0):
    """A canvas with a live wall, if `live` is given, and a backdrop behind it."""
    canvas, target = Canvas(HERE.width, HERE.height), Target(HERE, ORIGIN)
    if live is not None:
        canvas.draw(flat(live).mesh(), target, 0, 0.01, 0.0)
    canvas.draw_backdrop(flat(backdrop), ViewTable([flat(present)]), [0], target, 0.01, (push, curve), (push, curve))
    return canvas


INNER = np.s_[1:-1, 1:-1]


def test_holes_are_filled_and_the_backdrop_is_pushed_back():
    canvas = layered(None, 3.0, np.nan)
    np.testing.assert_allclose(canvas.disparity[INNER], 1 / (3.0 + PUSH), rtol=1e-4)
    assert (canvas.winner[INNER] == 1).all()
    np.testing.assert_allclose(layered(None, 3.0, np.nan, push=0.0).disparity[INNER], 1 / 3.0, rtol=1e-4)


def test_without_present_views_only_depth_decides():
    """A surface is left out if a present view sees past it; without such views it hides the live wall."""
    canvases = [layered(4.0, 3.0, 4.0), Canvas(HERE.width, HERE.height)]
    target = Target(HERE, ORIGIN)
    canvases[1].draw(flat(4.0).mesh(), target, 0, 0.01, 0.0)
    canvases[1].draw_backdrop(flat(3.0), None, [0], target, 0.01, (PUSH, 0.0), (PUSH, 0.0))
    assert (canvases[0].winner[INNER] == 0).all()
    assert (canvases[1].winner[INNER] == 1).all()
    np.testing.assert_allclose(canvases[1].disparity[INNER], 1 / (3.0 + PUSH), rtol=1e-4)
    canvases[1].draw_backdrop(flat(3.5), None, [0], target, 0.01, (PUSH, 0.0), (PUSH, 0.0))
    np.testing.assert_allclose(canvases[1].disparity[INNER], 1 / (3.0 + PUSH), rtol=1e-4)


@pytest.mark.parametrize(("depth", "moved"), [(2.0, 0.1), (4.0, 0.32)])
def test_the_push_follows_depth(depth, moved):
    """The push is 0.1 m, or an error of disparity of 0.02 (1/m) where that is more."""
    canvas = layered(None, depth, np.nan, curve=0.02)
    np.testing.assert_allclose(canvas.disparity[INNER], 1 / (depth + moved), rtol=1e-4)


@pytest.mark.parametrize(("live", "hides"), [(7.5, False), (8.2, True)])
def test_far_away_only_what_is_nearer_by_delta_there_hides(live, hides):
    """A backdrop at 6 m is pushed by 0.72 m; to hide a surface it must then be nearer by another 0.9 m and 3 %."""
    canvas = layered(live, 6.0, 6.0, curve=0.02)
    assert (canvas.winner[INNER] == (1 if hides else 0)).all()


def test_holes_alone_are_filled():
    live = np.where(np.arange(32) < 16, 2.0, np.nan)
    canvas = layered(live, 3.0, np.nan)
    drawn = np.arange(32) < 16
    np.testing.assert_array_equal(canvas.winner[5, 1:-1], np.where(drawn, 0, 1)[1:-1])
    np.testing.assert_allclose(canvas.disparity[5, 1:-1], np.where(drawn, 0.5, 1 / (3 + PUSH))[1:-1], rtol=1e-4)


@pytest.mark.parametrize(
    ("present", "ghost"),
    [(6.0, True), (3.05, False), (3.0, False), (2.0, False), (np.nan, False), (3.4, True)],
    ids=["sees farther", "sees the same", "sees the surface", "is blocked", "sees nothing", "sees a little farther"],
)
def test_what_the_present_looks_through_is_a_ghost(present, ghost):
    canvas = layered(None, 3.0, present)
    assert (canvas.disparity[INNER] == 0).all() == ghost
    assert (canvas.disparity[INNER] > 0).all() == (not ghost)


def test_a_ghost_needs_all_texels_round_it():
    """Near a hole or an edge of the present view, nothing proves that the earlier surface is gone."""
    present = np.full((24, 32), 6.0)
    present[10:14, 10:14] = np.nan
    found = layered(None, 3.0, present).disparity > 0
    assert found[10:14, 10:14].all()
    assert not found[2:8, 2:-2].any()
    assert not found[17:-2, 2:-2].any()


def test_one_present_view_that_looks_through_is_enough():
    canvas, target = Canvas(HERE.width, HERE.height), Target(HERE, ORIGIN)
    present = ViewTable([flat(np.nan), flat(2.0), flat(6.0)])
    canvas.draw_backdrop(flat(3.0), present, range(3), target, 0.01, (PUSH, 0.0), (PUSH, 0.0))
    assert (canvas.disparity[INNER] == 0).all()


@pytest.mark.parametrize(
    ("backdrop", "hides"), [(2.0, True), (3.5, True), (3.85, False), (3.95, False), (4.0, False), (6.0, False)]
)
def test_a_clearly_nearer_backdrop_alone_hides_the_live_picture(backdrop, hides):
    canvas = layered(4.0, backdrop, np.nan)
    assert (canvas.winner[INNER] == hides).all()
    np.testing.assert_allclose(canvas.disparity[INNER], 1 / (backdrop + PUSH) if hides else 0.25, rtol=1e-4)


def test_an_empty_backdrop_changes_nothing():
    canvas = layered(4.0, np.nan, np.nan)
    np.testing.assert_allclose(canvas.disparity[INNER], 0.25, rtol=1e-4)
    assert (canvas.winner == 0).all()


def prepared(view):
    return PreparedView(view, TriangulationOptions(0.0, 0.05), ORIGIN)


@pytest.mark.parametrize("first", [WALL_X, 1.5 * WALL_X, BOX_X], ids=["from the wall", "from behind it", "at the box"])
def test_the_search_finds_what_a_view_has_on_a_ray(first):
    beside, eye = camera_row(2, (96, 64), spacing=0.2)
    view, truth = prepared(see(beside, box_y=0.0)), see(eye, box_y=0.0)
    depth = eye.depth.depth(truth.codes)
    found = np.zeros(depth.shape)
    for y, x in np.ndindex(*depth.shape):
        found[y, x] = present_depth(view.table_row, view.addresses()[0], eye.packed(), x, y, first)
    right = np.isclose(found, depth, rtol=0.01)
    # Only pixels at the box's outline are wrong, and those between it and the surface that the other camera sees there.
    assert np.mean((found > 0) & ~right) < 0.02
    assert np.mean(right) > 0.85
    around = np.lib.stride_tricks.sliding_window_view(np.pad(depth, 1, mode="edge"), (3, 3))
    inner = np.ptp(around, axis=(2, 3)) < 0.3
    on_box = depth < BOX_X + 0.1
    if first == BOX_X:
        assert right[inner & on_box].all()
    assert np.mean(right[on_box]) > 0.7


def behind_someone(present, drawn, *, live=None):
    """A canvas with a backdrop at 4 m; `present`: present views, of which those at the indices `drawn` were drawn."""
    canvas, target = Canvas(HERE.width, HERE.height), Target(HERE, ORIGIN)
    if live is not None:
        canvas.draw(flat(live).mesh(), target, 0, 0.01, 0.0)
    canvas.draw_backdrop(flat(4.0), ViewTable(present), drawn, target, 0.01, (PUSH, 0.0), (PUSH, 0.0))
    return canvas


def test_a_hole_shows_who_stands_there_now():
    near = dataclasses.replace(HERE, pose=Pose((0.0, 0.05, 0.0)))
    far = dataclasses.replace(HERE, pose=Pose((0.0, 0.1, 0.0)))
    canvas = behind_someone([flat(np.nan), flat(2.0, camera=far), flat(2.0, camera=near)], [0])
    middle = np.s_[1:-1, 2:-2]
    np.testing.assert_allclose(canvas.disparity[middle], 0.5, rtol=1e-4)
    assert (canvas.winner[middle] == 4).all()  # 1 is the backdrop, then the other views, nearest to the eye first


def test_a_hole_shows_the_backdrop_where_someone_hides_it_from_others_alone():
    aside = dataclasses.replace(HERE, pose=Pose((0.0, 0.9, 0.0)))
    present = np.where(np.arange(32) < 16, 2.0, np.nan)  # stands left of the eye's rays through the hole's right part
    canvas = behind_someone([flat(np.nan), flat(present, camera=aside)], [0])
    assert (canvas.winner[1:-1, 16:-1] == 1).all()
    np.testing.assert_allclose(canvas.disparity[1:-1, 16:-1], 1 / (4.0 + PUSH), rtol=1e-4)


def test_a_ghost_gives_way_to_what_is_there_now():
    canvas = behind_someone([flat(np.nan), flat(6.0)], [0])
    np.testing.assert_allclose(canvas.disparity[INNER], 1 / 6.0, rtol=1e-4)
    assert (canvas.winner[INNER] == 3).all()
    assert (behind_someone([flat(np.nan), flat(6.0)], [0, 1]).disparity[INNER] == 0).all()


@pytest.mark.parametrize(("other", "hides"), [(4.05, True), (2.0, False), (np.nan, False)])
def test_only_a_confirmed_backdrop_hides_what_was_drawn(other, hides):
    away = dataclasses.replace(HERE, pose=Pose((0.0, 50.0, 0.0)))
    canvas = behind_someone([flat(6.0, camera=away), flat(other)], [0], live=6.0)
    assert (canvas.winner[INNER] == (1 if hides else 0)).all()
    np.testing.assert_allclose(canvas.disparity[INNER], 1 / (4.0 + PUSH) if hides else 1 / 6.0, rtol=1e-4)


def test_more_views_than_numbers():
    """Views are numbered in a byte: of more views, the farthest are not used."""
    canvas = behind_someone([flat(np.nan)] * 300, [0, 1])
    assert (canvas.winner[INNER] == 2).all()


def scene(rng, projection):
    """A backdrop, what was drawn, and three views, of planes and steps with holes, so that all may happen."""
    eye = Camera("eye", projection, Pose.from_euler((-0.1, 0.03, 0.02), 0.02, -0.03, 0.05), CODING)
    h, w = eye.height, eye.width

    def surfaces(shape, depths, empty):
        """Patches of flat and slanted surfaces."""
        v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
        which = rng.choice(len(depths), (1 + shape[0] // 6, 1 + shape[1] // 7)).repeat(6, 0).repeat(7, 1)
        depth = np.asarray(depths)[which[: shape[0], : shape[1]]] * (1 + 1e-3 * u - 2e-3 * v)
        return np.where(rng.random(shape) < empty, np.nan, depth)

    backdrop = np.nan_to_num(1 / surfaces((h, w), (3.0, 3.5, 4.5), 0.1)).astype(np.float32)
    live = np.nan_to_num(1 / surfaces((h, w), (2.0, 3.6, 5.5, 8.0, 8.0, np.nan), 0.1)).astype(np.float32)
    cameras = [
        Camera(f"v{k}", PROJECTION, Pose.from_euler((0.0, y, 0.1 * k), -0.05 * y, 0.0, 0.1 * k), CODING)
        for k, y in enumerate((-0.4, 0.1, 0.5))
    ]
    present = [flat(surfaces((24, 32), (2.0, 3.1, 3.6, 4.5, 6.0), 0.02), camera=camera) for camera in cameras]
    return eye, backdrop, live, present


NARROW = Perspective.from_fov(11, 40, 0.4)  # narrower than sixteen pixels, which are looked at together
SPHERE = Equirectangular(37, 26, (-0.6, 0.65), (-0.45, 0.4))


@pytest.mark.parametrize("order", [(), (2, 1), (0, 1, 2)], ids=["all drawn", "two not drawn", "none drawn"])
@pytest.mark.parametrize("projection", [PROJECTION, SPHERE, NARROW], ids=["flat", "sphere", "narrow"])
@pytest.mark.parametrize("delta", [(0.1, 0.0), (0.02, 0.02)])
def test_every_pixel_is_that_of_the_slow_twin(projection, order, delta):
    eye, backdrop, live, present = scene(np.random.default_rng(0), projection)
    table, views = ViewTable(present), []
    for view, row in zip(present, table.rows, strict=True):
        views.append(Seen(view.view.camera, view.view.codes, row[EDGE], row[TOLERANCE]))
    drawn = live, np.where(live > 0, 1, 0).astype(np.uint8)
    number, push = 5, (0.5 * delta[0], 0.5 * delta[1])
    expected = [
        lay(eye, backdrop, drawn, views, order, push, (share * delta[0], share * delta[1]), number)
        for share in (1.0, 0.999, 1.001)
    ]
    sure = (expected[0][1] == expected[1][1]) & (expected[0][1] == expected[2][1])
    assert sure.mean() > 0.98
    found = DepthBuffer(*(plane.copy() for plane in drawn))
    lay_backdrop(
        backdrop.copy(), eye.packed(), Views(table.rows, table.addresses), np.array(order, np.int64), push, delta,
        number, found,
    )  # fmt: skip
    np.testing.assert_array_equal(found.winner[sure], expected[0][1][sure])
    np.testing.assert_allclose(found.disparity[sure], expected[0][0][sure], rtol=2e-5)
    if projection is not NARROW:  # which shows little
        holes = {0, number, *(number + 1 + k for k in order)}  # left; the backdrop; what stands there now
        assert set(found.winner[live == 0]) == holes
        assert set(found.winner[live > 0]) == {1, number}
