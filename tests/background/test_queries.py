"""Questions about the model: rays, the nearest place, spheres; from an exact room, and from rooms that cameras see."""

from __future__ import annotations

import dataclasses
import math
import threading

import numpy as np
import pytest
from farside.engine.background import queries
from farside.engine.background.model import BackgroundModel
from farside.engine.background.pbs import ProbableBackgroundSurface
from farside.engine.background.queries import ModelQueries
from farside.engine.background.sightings import Sightings
from farside.engine.geometry.mesh import Mesh
from farside.engine.geometry.scene_scale import Scene
from farside.engine.kernels.background.point_search import MOST_COUNTED
from farside.engine.rig.camera import Pose
from farside.engine.rig.questions import LARGEST, NoModelError
from support.models import SETTINGS, model_of, sheets
from support.rooms import BOX_X, WALL_X, camera_row, frame
from support.slow_tracer import SlowTracer

LOW, HIGH = np.array([-2.0, -3.0, -1.0]), np.array([4.0, 1.0, 1.5])  # corners of the exact room, metres
ORIGIN = np.array([1000.0, -2000.0, 30.0])  # of the scene in the world


def box_mesh(low, high):
    """The twelve triangles of a box, and the unit normals that point into it."""
    points, triangles, normals = [], [], []
    for axis in range(3):
        for side, at in enumerate((low, high)):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            square = np.tile(at, (4, 1))
            square[:, b], square[:, c] = [low[b], high[b], high[b], low[b]], [low[c], low[c], high[c], high[c]]
            first = len(points)
            triangles += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
            normals += 2 * [np.eye(3)[axis] * (1 - 2 * side)]
            points += list(square)
    points = np.array(points, np.float32)
    return Mesh(points, np.zeros((len(points), 2), np.float32), np.array(triangles, np.int32)), np.array(normals)


def asking(*meshes, tracer=None):
    """A model of meshes that can be asked, and its surfaces."""
    pbs, sightings = ProbableBackgroundSurface(len(meshes), tracer), Sightings()
    surfaces = [pbs.set_static(number, number, mesh) for number, mesh in enumerate(meshes)]
    pbs.commit()
    sightings.ready = True
    return ModelQueries(pbs, sightings, ORIGIN), surfaces


def some_rays(count, seed=0):
    rng = np.random.default_rng(seed)
    starts = rng.uniform(LOW + 0.05, HIGH - 0.05, (count, 3))
    return starts, rng.normal(size=(count, 3)) * rng.uniform(0.01, 50.0, (count, 1))


def exits(starts, ways):
    """Distance to the side of the room along each ray, and the axis of that side."""
    unit = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    distances = (np.where(unit > 0, HIGH, LOW) - starts) / unit
    return distances.min(axis=1), distances.argmin(axis=1), unit


@pytest.mark.parametrize("count", [1, 5000])
def test_rays_in_a_box_hit_its_sides_where_they_leave_it(count, monkeypatch):
    monkeypatch.setattr(queries, "_RAYS", 1500)
    room, _surfaces = asking(box_mesh(LOW, HIGH)[0])
    starts, ways = some_rays(count)
    hits = room.cast_rays(starts + ORIGIN, ways)
    distances, axes, unit = exits(starts, ways)
    assert hits.hit.all()
    np.testing.assert_allclose(hits.distances, distances, rtol=3e-6, atol=3e-6)
    np.testing.assert_allclose(hits.points, starts + ORIGIN + distances[:, None] * unit, rtol=0, atol=2e-5)
    expected = -np.sign(unit[np.arange(count), axes])[:, None] * np.eye(3)[axes]
    np.testing.assert_allclose(hits.normals, expected, atol=1e-6)
    assert (hits.ages == -1).all()
    assert hits.distances.dtype == hits.normals.dtype == np.float32


def test_rays_end_where_they_are_told_to():
    room, _surfaces = asking(box_mesh(LOW, HIGH)[0])
    starts, ways = some_rays(400)
    distances = exits(starts, ways)[0]
    far = distances + np.where(np.arange(400) % 2, 1e-3, -1e-3)
    for farthest in (False, True):
        hits = room.cast_rays(starts + ORIGIN, ways, far, farthest=farthest)
        np.testing.assert_array_equal(hits.hit, np.arange(400) % 2 == 1)
        assert np.isnan(hits.points[~hits.hit]).all()
        assert np.isnan(hits.normals[~hits.hit]).all()
    np.testing.assert_array_equal(room.are_free(starts + ORIGIN, ways, far), np.arange(400) % 2 == 0)


def test_the_farthest_hit_is_behind_the_nearest_one():
    inner, _normals = box_mesh(LOW + 1e-9, LOW + np.array([2.5, 2.0, 1.2]))
    room, _surfaces = asking(box_mesh(LOW, HIGH)[0], inner)
    starts, ways = some_rays(300, 1)
    np.testing.assert_allclose(
        room.cast_rays(starts + ORIGIN, ways, farthest=True).distances, exits(starts, ways)[0], rtol=1e-5, atol=1e-5
    )
    nearest = room.cast_rays(starts + ORIGIN, ways).distances
    assert (nearest < exits(starts, ways)[0] - 0.01).sum() > 20


def test_what_is_culled_is_not_there():
    room, (surface,) = asking(box_mesh(LOW, HIGH)[0])
    starts, ways = some_rays(300)
    distances, axes, unit = exits(starts, ways)
    surface.invalid[:2] = 1  # the side at the low end of x
    open_ = (axes == 0) & (unit[:, 0] < 0)
    assert 20 < open_.sum() < 280
    np.testing.assert_array_equal(room.cast_rays(starts + ORIGIN, ways).hit, ~open_)
    np.testing.assert_array_equal(room.are_free(starts + ORIGIN, ways), open_)
    nearest = room.closest_points(starts + ORIGIN)
    others = np.concatenate([starts - LOW, HIGH - starts], axis=1)[:, 1:]
    np.testing.assert_allclose(nearest.distances, others.min(axis=1), rtol=1e-5, atol=1e-5)
    assert (room.overlaps([LOW + ORIGIN + [0.0, 2.0, 1.0]], 0.1).counts == 0).all()
    assert distances.min() > 0


def test_the_nearest_place_in_a_box_is_the_foot_on_a_side():
    room, _surfaces = asking(box_mesh(LOW, HIGH)[0])
    starts, _ways = some_rays(500)
    foot = room.closest_points(starts + ORIGIN)
    gaps = np.concatenate([starts - LOW, HIGH - starts], axis=1)
    side = gaps.argmin(axis=1)
    np.testing.assert_allclose(foot.distances, gaps.min(axis=1), rtol=1e-5, atol=2e-6)
    expected = starts.copy()
    expected[np.arange(500), side % 3] = np.where(side < 3, LOW[side % 3], HIGH[side % 3])
    np.testing.assert_allclose(foot.points, expected + ORIGIN, rtol=0, atol=2e-5)
    np.testing.assert_allclose(foot.normals, np.where(side < 3, 1, -1)[:, None] * np.eye(3)[side % 3], atol=1e-6)
    limited = room.closest_points(starts + ORIGIN, gaps.min(axis=1) + np.where(np.arange(500) % 2, 1e-4, -1e-4))
    np.testing.assert_array_equal(limited.hit, np.arange(500) % 2 == 1)


def test_spheres_touch_the_triangles_that_they_reach():
    mesh, _normals = box_mesh(LOW, HIGH)
    room, _surfaces = asking(mesh)
    middle = 0.5 * (LOW + HIGH)
    assert room.overlaps([middle + ORIGIN], 1.2).counts.tolist() == [0]  # 1.25 m to floor and ceiling
    at_corner = room.overlaps([LOW + ORIGIN], 0.01, listed=16)
    assert at_corner.counts.tolist() == [6]  # both halves of three sides meet in this corner
    corners = at_corner.corners[0]
    assert np.isfinite(corners[:6]).all()
    assert np.isnan(corners[6:]).all()
    assert all(np.linalg.norm(triangle - (LOW + ORIGIN), axis=1).min() < 1e-4 for triangle in corners[:6])
    everything = room.overlaps([middle + ORIGIN], 10.0, listed=3)
    assert everything.counts.tolist() == [12]
    assert everything.corners.shape == (1, 3, 3, 3)
    known = {tuple(np.round(triangle.ravel(), 3)) for triangle in mesh.points[mesh.triangles] + ORIGIN}
    assert {tuple(np.round(triangle.ravel(), 3)) for triangle in everything.corners[0]} <= known


def test_a_count_ends_where_more_would_take_long():
    y, z = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60))
    k = np.arange(3600).reshape(60, 60)
    triangles = np.stack([k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:], k[:-1, 1:], k[1:, :-1]], -1).reshape(-1, 3)
    points = np.stack([np.ones(3600), y.ravel(), z.ravel()], -1).astype(np.float32)
    room, _surfaces = asking(Mesh(points, np.zeros((3600, 2), np.float32), triangles.astype(np.int32)))
    counts = room.overlaps(ORIGIN + np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), [10.0, 0.5]).counts
    assert counts[0] == MOST_COUNTED < len(triangles)
    assert 1000 < counts[1] < 2500


@pytest.mark.parametrize("seed", range(3))
def test_answers_are_those_of_the_slow_twin(seed):
    meshes, rng = sheets(seed), np.random.default_rng(seed)
    fast, flagged = asking(*meshes)
    slow, also = asking(*meshes, tracer=SlowTracer())
    for one, other in zip(flagged, also, strict=True):
        one.invalid[:] = other.invalid[:] = rng.random(len(one.invalid)) < 0.2
    starts = rng.uniform((-0.5, -1, -1), (3.5, 1, 1), (150, 3)) + ORIGIN
    ways = rng.normal((0.8, 0.0, 0.0), 1.0, (150, 3))
    reach = rng.uniform(0.3, 3.0, 150)
    pairs = [(room.cast_rays(starts, ways, reach, farthest=way)) for way in (False, True) for room in (fast, slow)]
    pairs += [room.closest_points(starts, reach) for room in (fast, slow)]
    for one, other in zip(pairs[::2], pairs[1::2], strict=True):
        assert 30 < other.hit.sum() < 150
        np.testing.assert_array_equal(one.hit, other.hit)
        np.testing.assert_allclose(one.distances, other.distances, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(one.points, other.points, rtol=0, atol=2e-4)
        same = np.isclose(one.normals, other.normals, atol=1e-4, equal_nan=True).all(axis=1)
        assert same.mean() > (0.97 if one is not pairs[-2] else 0.75)  # the nearest place may be of several triangles
    np.testing.assert_array_equal(*(room.are_free(starts, ways, reach) for room in (fast, slow)))
    counts, expected = (room.overlaps(starts, 0.4 * reach, listed=2) for room in (fast, slow))
    np.testing.assert_array_equal(counts.counts, expected.counts)
    assert counts.counts.max() > 3
    np.testing.assert_array_equal(np.isfinite(counts.corners), np.isfinite(expected.corners))


def test_a_model_of_views_knows_where_its_wall_is_and_when_it_was_seen():
    cameras = camera_row()
    model, _report = model_of(cameras, frame(0, cameras))
    ahead = ([[0.0, 0.0, 0.0]], [[2.0, 0.0, 0.0]])
    hits = model.queries.cast_rays(*ahead)
    np.testing.assert_allclose(hits.distances, WALL_X, atol=2e-3)
    np.testing.assert_allclose(hits.normals, [[-1.0, 0.0, 0.0]], atol=0.02)
    assert (hits.ages.tolist(), hits.frame) == ([0], 1)
    for index in (1, 2, 3):  # someone stands before the wall
        model.update(frame(index, cameras, box_y=0.0, half=0.6))
    hits = model.queries.cast_rays(*ahead)
    assert hits.distances[0] == pytest.approx(WALL_X, abs=2e-3)
    assert (hits.ages.tolist(), hits.frame) == ([3], 4)
    assert model.queries.closest_points([[WALL_X - 1.0, 0.0, 0.0]]).ages.tolist() == [3]
    model.update(frame(4, cameras))
    assert model.queries.cast_rays(*ahead).ages.tolist() == [0]


def test_only_what_stands_in_the_way_ages():
    cameras = camera_row(1)
    model, _report = model_of(cameras, frame(0, cameras))
    model.update(frame(1, cameras, box_y=0.0, half=0.5))
    at_box, beside = [1.0, 0.0, 0.0], [WALL_X, 1.6, 0.0]
    assert model.queries.cast_rays([[0.0, 0.0, 0.0]] * 2, [at_box, beside]).ages.tolist() == [1, 0]
    assert BOX_X < WALL_X


def test_in_a_large_rig_cameras_look_in_turn_and_all_of_them_in_the_first_frame():
    cameras = camera_row(14, spacing=0.1)
    model, _report = model_of(cameras, frame(0, cameras))
    ahead = [[0.0, y, 0.0] for y in np.linspace(-2.0, 2.0, 41)], [[1.0, 0.0, 0.0]] * 41
    assert (model.queries.cast_rays(*ahead).ages == 0).all()
    for index in range(1, 9):
        model.update(frame(index, cameras))
        ages = model.queries.cast_rays(*ahead).ages
        assert ages.min() >= 0
        assert ages.max() <= 2  # 14 cameras, of which 6 look in each frame


def test_a_model_that_is_continued_does_not_know_when_its_surfaces_were_seen():
    cameras = camera_row()
    model, _report = model_of(cameras, frame(0, cameras))
    again = BackgroundModel.from_state(model.state())
    ahead = ([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]])
    assert again.queries.cast_rays(*ahead).ages.tolist() == [-1]
    again.update(frame(1, cameras, box_y=0.0, half=0.6))
    assert again.queries.cast_rays(*ahead).ages.tolist() == [-1]
    again.update(frame(2, cameras))
    assert again.queries.cast_rays(*ahead).ages.tolist() == [0]


def test_what_a_camera_that_walked_on_has_left_is_as_old_as_its_capture_at_least():
    (camera,) = camera_row(1)
    model, _report = model_of([camera], frame(0, [camera]))
    for index in range(1, 7):
        model.update(frame(index, [dataclasses.replace(camera, pose=Pose((0.0, 1.0 * index, 0.0)))]))
    assert len(model.captures) > 1
    hits = model.queries.cast_rays([[0.0, -2.0, 0.0], [0.0, 6.0, 0.0]], [[1.0, 0.0, 0.0]] * 2)
    np.testing.assert_allclose(hits.distances, WALL_X, atol=0.05)
    assert hits.frame == 7
    assert hits.ages[0] == 6
    assert 0 < hits.ages[1] < 6  # the camera is there now, but has seen this first from elsewhere


def test_threads_may_ask_while_another_one_updates():
    cameras = camera_row()
    model, _report = model_of(cameras, frame(0, cameras))
    starts, ways = np.zeros((3000, 3)), np.tile([1.0, 0.0, 0.0], (3000, 1))
    ways[:, 1:] = np.random.default_rng(0).uniform(-0.3, 0.3, (3000, 2))
    wrong, ended = [], threading.Event()

    def ask():
        while not ended.is_set():
            hits = model.queries.cast_rays(starts, ways)
            near = model.queries.closest_points(starts[:50])
            x = hits.points[hits.hit, 0]
            if hits.hit.mean() < 0.99 or np.abs(x - WALL_X).max() > 0.1 or abs(near.distances[0] - WALL_X) > 0.1:
                wrong.append((hits.hit.mean(), x.min(), x.max()))

    asking = [threading.Thread(target=ask) for _ in range(2)]
    for thread in asking:
        thread.start()
    for index in range(1, 25):
        model.update(frame(index, cameras, box_y=-2.0 + 0.2 * index, half=0.2))
    ended.set()
    for thread in asking:
        thread.join()
    assert wrong == []


def test_nothing_is_asked_before_the_first_frame():
    cameras = camera_row()
    model = BackgroundModel(cameras, SETTINGS, Scene.of(cameras, SETTINGS, frame(0, cameras)))
    for ask in (
        lambda: model.queries.cast_rays([[0, 0, 0]], [[1, 0, 0]]),
        lambda: model.queries.closest_points([[0, 0, 0]]),
        lambda: model.queries.overlaps(np.empty((0, 3)), 1.0),
    ):
        with pytest.raises(NoModelError, match="model: there is none before the first frame"):
            ask()


def test_no_question_has_no_answers():
    room, _surfaces = asking(box_mesh(LOW, HIGH)[0])
    assert room.cast_rays([], []).hit.shape == (0,)
    assert room.are_free(np.empty((0, 3)), np.empty((0, 3))).shape == (0,)
    assert room.closest_points(np.empty((0, 3))).points.shape == (0, 3)
    assert room.overlaps([], [], listed=2).corners.shape == (0, 2, 3, 3)


START, WAY, NAN = [[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], math.nan


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda room: room.cast_rays([0.0, 0.0, 0.0], WAY), r"origins: \[3\]: expected \[n, 3\]"),
        (lambda room: room.cast_rays([[0.0, 0.0]], WAY), r"origins: \[1, 2\]: expected \[n, 3\]"),
        (lambda room: room.cast_rays("here", WAY), "origins: str: expected numbers"),
        (lambda room: room.cast_rays([[1.0], [1.0, 2.0]], WAY), "origins: list: expected numbers"),
        (lambda room: room.cast_rays([[NAN, 0.0, 0.0]], WAY), r"origins: \[0\] = \[nan, 0.0, 0.0\]: expected metres"),
        (lambda room: room.cast_rays([[0.0, 2 * LARGEST, 0.0]], WAY), r"origins: \[0\] = .*: expected metres from -1e"),
        (lambda room: room.cast_rays(START, WAY * 2), r"directions: \[2, 3\]: expected \[1, 3\]"),
        (lambda room: room.cast_rays(START, [[0.0, 0.0, 0.0]]), r"directions: \[0\] = .*: expected finite numbers"),
        (lambda room: room.are_free(START * 2, [*WAY, [0, NAN, 0]]), r"directions: \[1\] = .*: expected finite"),
        (lambda room: room.are_free(START, [[math.inf, 0, 0]]), r"directions: \[0\] = .*: expected finite"),
        (lambda room: room.cast_rays(START, WAY, 0.0), r"far: 0.0: expected metres above 0"),
        (lambda room: room.cast_rays(START, WAY, [1.0, 2.0]), r"far: \[2\]: expected one number or \[1\]"),
        (lambda room: room.cast_rays(START, WAY, NAN), "far: nan: expected metres above 0"),
        (lambda room: room.closest_points(START, -1.0), "within: -1.0: expected metres above 0"),
        (lambda room: room.closest_points([[0, 0, math.inf]]), r"points: \[0\] = .*: expected metres"),
        (lambda room: room.overlaps(START, math.inf), "radii: inf: expected metres above 0 and at most 1e"),
        (lambda room: room.overlaps(START, None), "radii: nan: expected metres above 0"),
        (lambda room: room.overlaps(START, 1.0, listed=65), "listed: 65: expected an integer from 0 to 64"),
        (lambda room: room.overlaps([[NAN] * 3], 1.0), r"centres: \[0\] = .*: expected metres"),
    ],
)
def test_what_cannot_be_asked_is_refused_by_name(ask, message):
    room, _surfaces = asking(box_mesh(LOW, HIGH)[0])
    with pytest.raises(ValueError, match=message):
        ask(room)
