"""Stale foreground leaves the model as soon as a present view shows that it has gone, and nothing else does."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.model import BackgroundModel
from farside.engine.background.stale import Look, flag_stale
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.background.picture import Picture
from farside.engine.kernels.background.stale import find_gone, find_seen_past, find_shown
from farside.engine.kernels.background.surfaces import Triangles
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.frame import Fault, Frame, Texture, View
from farside.engine.settings import Settings
from oracle import standing as slow
from oracle.rays import delta_at
from support.models import model_of, near_points, pbi_of
from support.rooms import BOX_X, BOX_Y, CODING, camera_row, frame, see, texture_of

DELTA = (0.05, 0.004)
LENSES = {"flat": Perspective.from_fov(48, 36, 1.1), "sphere": Equirectangular(64, 40, (-1.5, 1.4), (-0.7, 0.8))}
SEEN_PAST = Settings(n_init=3, n_update=1, cull_stale=True)


def prepared(view):
    return PreparedView(view, TriangulationOptions(0.0, 0.2), np.zeros(3))


def random_case(lens, seed, size=0.1):
    """A view of flat patches with holes in its depth, and triangles before and behind them, some beside its picture."""
    rng = np.random.default_rng(seed)
    camera = Camera("v", LENSES[lens], Pose.from_euler((0.1, -0.2, 0.3), 0.2, 0.1, -0.1), CODING)
    shape = camera.height, camera.width
    depth = np.kron(rng.uniform(1.5, 6.0, (3, 4)), np.ones((14, 16)))[: shape[0], : shape[1]]
    depth[rng.random(shape) < 0.01] = np.nan
    view = View(camera, texture_of(np.full(shape, 500)), CODING.codes(depth))
    points = rng.uniform((-1.0, -5.0, -4.0), (7.0, 5.0, 4.0), (900, 1, 3)) + rng.normal(0, size, (900, 3, 3))
    mesh = Triangles(
        points.reshape(-1, 3).astype(np.float32), np.zeros((2700, 2), np.float32),
        np.arange(2700, dtype=np.int32).reshape(-1, 3),
    )  # fmt: skip
    return view, mesh, (rng.random(900) < 0.2).astype(np.uint8)


def pixels_round(uv, width, height):
    """Rows and columns of the pixels less than one pixel from a triangle; None if there are some beyond the picture."""
    low, high = uv.min(axis=0) - 1, uv.max(axis=0) + 1
    if (low < 0).any() or (high > [width, height]).any():
        return None
    sides = np.roll(uv, -1, axis=0) - uv
    turn = 1 if sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0] >= 0 else -1
    at = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1)[:, :, None] + 0.5
    across = turn * (sides[:, 0] * (at - uv)[..., 1] - sides[:, 1] * (at - uv)[..., 0]) / np.hypot(*sides.T)
    return np.nonzero((across >= -1).all(-1) & (at >= low).all((-2, -1)) & (at <= high).all((-2, -1)))


def sees_past(view, corners):
    """Whether a view's depths, in all pixels less than one pixel from a triangle's image, are farther than all of its
    corners by more than delta."""
    camera = view.camera
    image, depth = camera.project(corners)
    far = depth.max()
    where = pixels_round(image, camera.width, camera.height)
    if depth.min() <= delta_at(DELTA, far) or where is None:
        return False
    return bool((camera.depth.depth(view.codes[where]) > far + delta_at(DELTA, far)).all())  # nan: nothing known


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(("seed", "size", "first", "count"), [(0, 0.05, 0, 900), (1, 0.2, 40, 300), (2, 0.0, 0, 900)])
def test_triangles_are_seen_past_as_by_the_slow_twin(lens, seed, size, first, count):
    view, mesh, invalid = random_case(lens, seed, max(size, 1e-3))
    expected = []
    for i in range(first, first + count):
        corners = mesh.points[mesh.triangles[i]].astype(np.float64)
        middle = slow.looks_through(view.camera, view.codes, corners.mean(axis=0), DELTA)
        expected.append(bool(not invalid[i] and middle and sees_past(view, corners)))
    one, past = prepared(view), np.full(count, 7, np.uint8)
    codes = int(one.addresses(measured=True)[0])
    found = find_seen_past(one.table_row, codes, mesh, invalid, DELTA, first, past)
    np.testing.assert_array_equal(past, expected)
    assert found == sum(expected) > 1


@pytest.mark.parametrize("lens", LENSES)
def test_triangles_are_shown_as_by_the_slow_twin(lens):
    cases = [random_case(lens, seed) for seed in (3, 4)]
    mesh, which = cases[0][1], np.arange(5, 900, 3)
    mesh.uv[::2] = np.array([[0, 0], [4, 0], [0, 4]]).repeat(450, 0)[:1350]  # some are large in their own picture
    table = ViewTable([prepared(view) for view, _mesh, _invalid in cases])
    expected = []
    weights = [(1 / 3, 1 / 3), (0.8, 0.1), (0.1, 0.8), (0.1, 0.1), (0.45, 0.45), (0.45, 0.1), (0.1, 0.45)]
    for i in which:
        a, b, c = mesh.points[mesh.triangles[i]].astype(np.float64)
        large = np.ptp(mesh.uv[mesh.triangles[i]], axis=0).max() > 2.5
        points = [p * a + q * b + (1 - p - q) * c for p, q in weights[: 7 if large else 1]]
        views = [view for view, _mesh, _invalid in cases]
        edge = max(0.2 / CODING.step, 1.0)
        expected.append(any(slow.shows(v.camera, edge, v.codes, p, DELTA) for v in views for p in points))
    shown = np.full(len(which), 7, np.uint8)
    codes = np.ascontiguousarray(table.addresses[:, 0])
    assert find_shown(table.rows, codes, mesh, which, DELTA, shown) == sum(expected) > 5
    np.testing.assert_array_equal(shown, expected)


# In a room: the wall is behind everyone, or nothing is


def before_the_sky(index, cameras, box_y):
    return frame(index, cameras, box_y, wall=False)


@pytest.mark.parametrize("stale", [True, False])
def test_someone_before_the_sky_leaves_nothing_after_one_round(stale):
    cameras = camera_row()
    settings = dataclasses.replace(SEEN_PAST, cull_stale=stale)
    model, _first = model_of(cameras, before_the_sky(0, cameras, 0.0), settings)
    for index in range(1, 100):
        model.update(before_the_sky(index, cameras, 0.0))
    there = len(near_points(model))
    assert there > 30  # who stands there all the time stays
    reports = [model.update(before_the_sky(index, cameras, None)) for index in range(100, 103)]
    assert len(near_points(model)) == (0 if stale else there)
    assert (sum(report.culled for report in reports) > 0) == stale
    assert np.isnan(pbi_of(model, cameras[1])[0]).all() == stale


def test_what_only_loses_its_depth_stays():
    """Its colour is still there: shiny and dark things have no depth at times."""
    cameras = camera_row()
    model, _first = model_of(cameras, before_the_sky(0, cameras, 0.0), SEEN_PAST)
    there = len(near_points(model))
    for index in range(1, 7):
        views = before_the_sky(index, cameras, 0.0).views
        model.update(Frame(index, tuple(View(v.camera, v.texture, np.zeros_like(v.codes)) for v in views)))
    assert len(near_points(model)) == there > 30


@pytest.mark.parametrize("stale", [True, False])
def test_one_camera_that_sees_past_is_enough(stale):
    """The wall is known only where that camera saw someone before it: for the others, there is nothing behind them."""
    cameras = camera_row()
    # With a delta of its own: as all that is seen changes at once, it would be taken for noise.
    settings = dataclasses.replace(SEEN_PAST, cull_stale=stale, delta_m=0.1)
    model, _first = model_of(cameras, before_the_sky(0, cameras, 0.0), settings)
    wall, away = see(cameras[0]), Fault("missing")
    behind = see(cameras[0], 0.0).texture.y == BOX_Y
    wide = np.any([np.roll(behind, (y, x), (0, 1)) for y in range(-2, 3) for x in range(-2, 3)], axis=0)
    known = View(wall.camera, wall.texture, np.where(wide, wall.codes, 0))
    for index in range(1, 7):
        others = [dataclasses.replace(see(camera), fault=away) for camera in cameras[1:]]
        model.update(Frame(index, (known, *others)))
    assert (len(near_points(model, 3.0)) > 0) == (not stale)
    depth, _luma = pbi_of(model, cameras[0])
    assert (np.nanmin(depth) < 3.0) == (not stale)


def test_what_a_view_still_shows_stays_though_another_sees_past_it():
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras, 0.0, wall=False), SEEN_PAST)
    before = len(near_points(model))
    contradicting = Frame(1, (see(cameras[0], 0.0, wall=False), see(cameras[1]), see(cameras[2])))
    for index in range(1, 7):
        model.update(dataclasses.replace(contradicting, index=index))
    assert len(near_points(model)) == before > 30


def test_a_view_that_is_left_out_sees_past_nothing():
    cameras = camera_row()
    model, _first = model_of(cameras, before_the_sky(0, cameras, 0.0), SEEN_PAST)
    before = len(near_points(model, 3.0))
    for index in range(1, 7):
        views = [dataclasses.replace(see(c, wall=False), fault=Fault("missing")) for c in cameras[:2]]
        model.update(Frame(index, (*views, see(cameras[2], 0.0, wall=False))))
    assert len(near_points(model, 3.0)) == before > 30


@pytest.mark.parametrize("noise", [0.002, 0.01])
def test_noise_eats_no_wall(noise):
    """Depth flickers by up to four centimetres; in some pixels it is far off. Nothing that stands goes."""
    cameras = camera_row()

    def noisy(index, rng):
        views = []
        for view in frame(index, cameras, 0.0).views:
            depth = CODING.depth(view.codes) * (1 + noise * rng.standard_normal(view.codes.shape))
            depth[rng.random(depth.shape) < 0.05] = 15.0
            views.append(dataclasses.replace(view, codes=CODING.codes(depth)))
        return Frame(index, tuple(views))

    counts = []
    for seen_past in (False, True):
        rng = np.random.default_rng(0)
        settings = dataclasses.replace(SEEN_PAST, cull_stale=seen_past)
        model, _first = model_of(cameras, noisy(0, rng), settings)
        for index in range(1, 40):
            model.update(noisy(index, rng))
        depth, _luma = pbi_of(model, cameras[1])
        counts.append((np.isnan(depth).mean(), len(model.mesh().triangles)))
    (holes, triangles), (holes_seen_past, triangles_seen_past) = counts
    assert holes_seen_past <= holes + 1e-3
    assert triangles_seen_past > 0.9 * triangles


def test_each_camera_comes_to_look_at_all_triangles_of_the_others(monkeypatch):
    monkeypatch.setattr("farside.engine.background.stale._LOOKED_AT", 7)
    cameras = camera_row()
    first = before_the_sky(0, cameras, 0.0)
    model = BackgroundModel(cameras, SEEN_PAST, Scene.of(cameras, SEEN_PAST, first))
    model.update(first)
    pbs, delta = model._pbs, model.tolerances.delta
    parts = -(-sum(surface.valid_count for surface in pbs.surfaces()) // 7)
    others = sum(surface.valid_count for surface in pbs.surfaces() if surface.camera)
    assert parts > 3
    assert others > 30
    views = ViewTable([prepared(see(camera)) for camera in cameras])
    look = Look(views.views[0], np.array(IDENTITY), model._captures.current[0])
    flagged = [flag_stale(pbs, look, lambda: views, delta, turn, 3) for turn in range(0, 12 * parts, 3)]
    assert flagged[0] >= pbs.static[0].invalid.sum() > 30  # its own ones at once
    assert max(flagged[1:]) <= 7
    assert not any(surface.valid_count for surface in pbs.surfaces())  # one camera has seen past all


def test_large_parts_of_the_model_are_looked_at_over_some_rounds(monkeypatch):
    monkeypatch.setattr("farside.engine.background.stale._OWN", 50)
    monkeypatch.setattr("farside.engine.background.stale._LOOKED_AT", 1)
    cameras = camera_row()
    model, _first = model_of(cameras, before_the_sky(0, cameras, 0.0), SEEN_PAST)
    largest = max(surface.valid_count for surface in model._pbs.surfaces())
    rounds = -(-largest // 50)
    assert rounds > 2
    for index in range(1, 3 * rounds + 4):
        report = model.update(before_the_sky(index, cameras, None))
        assert report.culled <= 51
    assert len(near_points(model)) == 0


def test_the_published_algorithm_waits_for_a_farther_surface():
    assert not Settings.paper().cull_stale


def test_a_box_that_stays_is_shown_all_along():
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras, 0.0), SEEN_PAST)
    alone = dataclasses.replace(SEEN_PAST, cull_stale=False)
    plain, _first = model_of(cameras, frame(0, cameras, 0.0), alone)
    for index in range(1, 20):
        assert model.update(frame(index, cameras, 0.0)).culled == plain.update(frame(index, cameras, 0.0)).culled == 0
    assert (near_points(model)[:, 0] < BOX_X + 0.1).sum() == (near_points(plain)[:, 0] < BOX_X + 0.1).sum() > 0


def has_gone(new, known, gain, offset, uv, far):
    """What a view says of a triangle that stems from its picture: "past" if it is farther in all pixels less than one
    pixel from the triangle; "vanished" if there it is farther or has no depth, and most of those pixels are farther, or
    had a depth and have another colour, with luma or chroma that is off by more than 40 codes; else ""."""
    where = pixels_round(uv, new.camera.width, new.camera.height)
    if where is None:
        return ""
    farther = new.camera.depth.depth(new.codes[where]) > far + delta_at(DELTA, far)
    if not (farther | (new.codes[where] == 0)).all():
        return ""
    y, x = where
    a, b = new.texture, known.texture
    off = [np.abs(gain * a.y[y, x] + offset - b.y[y, x])]
    for now, old in ((a.cb, b.cb), (a.cr, b.cr)):
        off.append(np.abs(now[y // 2, x // 2].astype(int) - old[y // 2, x // 2]))
    counts = farther | (known.codes[where] > 0)
    other = farther | (np.max(off, axis=0) > 40)
    gone = (other & counts).sum() > (~other & counts).sum()
    return ("past" if farther.all() else "vanished") if gone else ""


@pytest.mark.parametrize("lens", LENSES)
def test_triangles_have_gone_from_their_own_picture_as_by_the_slow_twin(lens):
    rng = np.random.default_rng(5)
    camera = Camera("v", LENSES[lens], Pose.from_euler((0.1, -0.2, 0.3), 0.2, 0.1, -0.1), CODING)
    h, w = camera.height, camera.width

    def view(holes):
        depth = np.kron(rng.uniform(1.5, 6.0, (4, 5)), np.ones((10, 13)))[:h, :w]
        depth[np.kron(rng.random((4, 5)) < holes, np.ones((10, 13)))[:h, :w] > 0] = np.nan
        y, cb, cr = (np.kron(rng.choice([300, 330, 420], (9, 9)), np.ones((n, n))) for n in (8, 4, 4))
        planes = (y[:h, :w], cb[: h // 2, : w // 2], cr[: h // 2, : w // 2])
        return View(camera, Texture(*(np.ascontiguousarray(p, np.uint16) for p in planes)), CODING.codes(depth))

    new, known = view(0.4), view(0.2)
    uv = rng.uniform((-2, -2), (w + 2, h + 2), (900, 1, 2)) + rng.uniform(-4, 4, (900, 3, 2))
    points = camera.unproject(uv, rng.uniform(1.0, 7.0, (900, 1)) + rng.uniform(0, 0.1, (900, 3)))
    mesh = Triangles(
        points.reshape(-1, 3).astype(np.float32), uv.reshape(-1, 2).astype(np.float32),
        np.arange(2700, dtype=np.int32).reshape(-1, 3),
    )  # fmt: skip
    invalid, tone, kinds = (rng.random(900) < 0.2).astype(np.uint8), np.array([1.1, -20.0, *IDENTITY[2:]]), []
    for i, (corners, image) in enumerate(zip(points, uv.astype(np.float32).astype(float), strict=True)):
        (u, v), far = np.floor(image.mean(axis=0)).astype(int), camera.project(corners)[1]
        kind = ""
        if not invalid[i] and 0 <= u < w and 0 <= v < h:
            beyond = CODING.depth(new.codes[v, u]) > far.mean() + delta_at(DELTA, far.mean())
            if beyond or new.codes[v, u] == 0:
                kind = has_gone(new, known, 1.1, -20.0, image, far.max())
        kinds.append(kind)
    assert min(kinds.count(kind) for kind in ("past", "vanished", "")) > 20
    one, gone = prepared(new), np.full(700, 7, np.uint8)
    pictures = (Picture(v.codes, v.texture.y, v.texture.cb, v.texture.cr) for v in (new, known))
    codes = int(one.addresses(measured=True)[0])
    count = find_gone(one.table_row, codes, *pictures, tone, mesh, invalid, DELTA, 150, gone)
    np.testing.assert_array_equal(gone, [kind != "" for kind in kinds[150:850]])
    assert count == gone.sum()
