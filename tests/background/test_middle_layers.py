"""What stands in the middle of a room stays in the model, and people who stood there and left do not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.kernels.background.middle_layers import find_never_seen_past, measure_pixels
from farside.engine.kernels.background.surfaces import Triangles
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.frame import View
from farside.engine.settings import Settings
from oracle import standing as slow
from support.models import model_of
from support.moments import (
    CAMERAS,
    LAYERS,
    PERSON_X,
    PERSON_Y,
    TABLE,
    TABLE_Y,
    look,
    moment,
    person,
    play,
    shown,
    triangles_at,
)
from support.rooms import BOX_X, CODING, WALL_X, WALL_Y, texture_of

DELTA = (0.05, 0.004)
NONE = dataclasses.replace(LAYERS, middle_layers=0)


@pytest.mark.parametrize("layers", [True, False])
def test_a_table_is_there_where_someone_who_walks_hides_it(layers):
    walk = [(TABLE, person(y)) for y in np.linspace(-0.9, 0.0, 12)]
    model = play(LAYERS if layers else NONE, [(TABLE,)] * 6 + walk)
    now, alone = moment(99, *walk[-1]), look(CAMERAS[2], TABLE)
    hidden = (look(CAMERAS[2], *walk[-1]).texture.y == PERSON_Y) & (alone.texture.y == TABLE_Y)
    depth, luma = shown(model, CAMERAS[2], now)
    table = np.isclose(depth, BOX_X, atol=0.02)[hidden[1:-1, 1:-1]]
    assert hidden.sum() > 100
    assert table.mean() > 0.95 if layers else table.mean() < 0.5
    if layers:
        assert (luma[hidden[1:-1, 1:-1]][table] == TABLE_Y).mean() > 0.95
    assert len(triangles_at(model, PERSON_X)) == 0  # who walks never becomes a layer


@pytest.mark.parametrize("settings", [LAYERS, NONE], ids=["layers", "none"])
@pytest.mark.parametrize("stays", [10, 300])
def test_who_stood_still_and_left_leaves_only_the_wall_after_one_round(settings, stays):
    there = person(0.15)
    model = play(settings, [(there,)] * stays)
    if settings is LAYERS:
        assert len(triangles_at(model, PERSON_X)) > 20
    for index in range(stays, stays + len(CAMERAS)):
        model.update(moment(index))
    assert len(triangles_at(model, PERSON_X)) == 0
    eyes = [*CAMERAS, dataclasses.replace(CAMERAS[2], pose=Pose((0.2, 0.3, 0.1)))]
    for camera in eyes:
        depth, luma = shown(model, camera, moment(999))
        there = ~np.isnan(depth)
        np.testing.assert_allclose(depth[there], WALL_X - camera.pose.position[0], atol=0.02)
        assert (luma[there] == WALL_Y).all()
        assert there.mean() > (0.999 if camera in CAMERAS else 0.9)


@pytest.mark.parametrize("settings", [LAYERS, NONE], ids=["layers", "none"])
def test_the_place_from_which_a_chair_was_carried_is_empty_after_one_round(settings):
    old, new = (BOX_X, -0.5, 0.25, TABLE_Y), (BOX_X, 0.6, 0.25, TABLE_Y)
    model = play(settings, [(old,)] * 10 + [(new,)] * len(CAMERAS))
    assert len(triangles_at(model, BOX_X)) == 0
    depth, _luma = shown(model, CAMERAS[2], moment(99, new))
    was = look(CAMERAS[2], old).texture.y[1:-1, 1:-1] == TABLE_Y
    np.testing.assert_allclose(depth[was], WALL_X, atol=0.02)


def test_without_layers_the_table_is_culled_by_cameras_that_know_the_wall_behind_it():
    assert len(triangles_at(play(NONE, [(TABLE,)] * 6), BOX_X)) < 0.2 * len(
        triangles_at(play(LAYERS, [(TABLE,)] * 6), BOX_X)
    )


def alone_marked(model):
    """Area in pixels of the triangles whose only mark is that of no camera, and of all triangles of their surfaces."""
    bit, kept, valid = np.uint64(1 << len(CAMERAS)), [], []
    for surface in model._pbs.surfaces():
        uv, there = surface.mesh.uv[surface.mesh.triangles].astype(float), surface.invalid == 0
        sides = uv[:, 1:] - uv[:, :1]
        area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
        only = (surface.marks == bit).all(axis=1)
        kept.append(area[only & there])
        valid.append(area[there])
    return np.concatenate(kept), np.concatenate(valid)


def test_beyond_the_budget_the_smallest_go_first():
    everything, _valid = alone_marked(play(LAYERS, [(TABLE,)] * 6))
    budget = len(everything) // 3
    assert budget > 10
    some, _valid = alone_marked(play(dataclasses.replace(LAYERS, middle_layers=budget), [(TABLE,)] * 6))
    assert len(some) == budget
    np.testing.assert_allclose(np.sort(some), np.sort(everything)[-budget:], rtol=1e-6)


def test_what_the_farthest_backdrop_never_shows_is_not_kept():
    model = play(dataclasses.replace(LAYERS, backdrop="farthest"), [(TABLE,)] * 6)
    assert len(alone_marked(model)[0]) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"middle_layers": -1}, "middle_layers: -1: expected at least 0"),
        ({"middle_layers": 5}, "middle_layers: 5: expected 0 where cull_stale is False"),
    ],
)
def test_settings_that_make_no_sense_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Settings(**changes)


def test_the_published_algorithm_keeps_the_farthest_surfaces_only():
    assert Settings.paper().middle_layers == 0


def test_triangles_were_never_seen_past_as_by_the_slow_twin():
    rng = np.random.default_rng(2)
    cameras = [
        Camera(f"v{k}", Perspective.from_fov(48, 36, 1.1), Pose.from_euler((0.1 * k, 0, 0), 0.1 * k, 0, 0), CODING)
        for k in range(3)
    ]
    views = []
    for camera in cameras:
        depth = np.kron(rng.uniform(1.0, 7.0, (3, 4)), np.ones((12, 12)))
        views.append(View(camera, texture_of(np.full((36, 48), 500)), CODING.codes(depth)))
    points = rng.uniform((1.0, -3.0, -2.0), (7.0, 3.0, 2.0), (600, 1, 3)) + rng.normal(0, 0.2, (600, 3, 3))
    uv = rng.uniform(0, 30, (600, 1, 2)) + rng.choice([0.2, 4.0], (600, 1, 1)) * [[0, 0], [1, 0], [0, 1]]
    mesh = Triangles(
        points.reshape(-1, 3).astype(np.float32), uv.reshape(-1, 2).astype(np.float32),
        np.arange(1800, dtype=np.int32).reshape(-1, 3),
    )  # fmt: skip
    weights = [(1 / 3, 1 / 3), (0.8, 0.1), (0.1, 0.8), (0.1, 0.1), (0.45, 0.45), (0.45, 0.1), (0.1, 0.45)]
    which, expected = np.arange(0, 600, 2), []
    for i in which:
        a, b, c = mesh.points[mesh.triangles[i]].astype(np.float64)
        samples = weights if np.ptp(uv[i], axis=0).max() > 2.5 else weights[:1]
        seen = [p * a + q * b + (1 - p - q) * c for p, q in samples]
        expected.append(not any(slow.looks_through(v.camera, v.codes, at, DELTA) for v in views for at in seen))
    settings, origin = Settings(), np.zeros(3)
    scene = model_of(CAMERAS, moment(0, TABLE), NONE)[0].state().scene.scene()
    table = ViewTable([PreparedView(v, scene.triangulation(v.camera, settings), origin) for v in views])
    never = np.full(len(which), 7, np.uint8)
    find_never_seen_past(table.rows, np.ascontiguousarray(table.addresses[:, 0]), mesh, which, DELTA, never)
    np.testing.assert_array_equal(never, expected)
    assert 0.1 < never.mean() < 0.9
    pixels = np.empty(len(which), np.float32)
    measure_pixels(mesh, which, pixels)
    sides = uv[which, 1:] - uv[which, :1]
    area = 0.5 * np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    np.testing.assert_allclose(pixels, area, rtol=1e-3, atol=1e-4)
