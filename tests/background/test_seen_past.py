"""Marks that are forgotten where a view sees past a triangle, next to a slow twin."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.geometry.prepared_view import PreparedView
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.background.seen_past import forget_seen_past
from farside.engine.kernels.background.surfaces import Triangles
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.frame import View
from oracle import standing as slow
from support.rooms import CODING, see, texture_of

DELTA = (0.05, 0.004)
LENSES = {"flat": Perspective.from_fov(48, 36, 1.1), "sphere": Equirectangular(64, 40, (-1.5, 1.4), (-0.7, 0.8))}


def random_case(lens, seed):
    """A view with holes in its depth, and triangles before and behind its surfaces, some of them beside its picture."""
    rng = np.random.default_rng(seed)
    camera = Camera("v", LENSES[lens], Pose.from_euler((0.1, -0.2, 0.3), 0.2, 0.1, -0.1), CODING)
    shape = camera.height, camera.width
    depth = np.kron(rng.uniform(1.5, 6.0, (6, 8)), np.ones((7, 8)))[: shape[0], : shape[1]]
    depth[rng.random(shape) < 0.03] = np.nan
    view = View(camera, texture_of(np.full(shape, 500)), CODING.codes(depth))
    points = rng.uniform((-1.0, -5.0, -4.0), (7.0, 5.0, 4.0), (900, 1, 3)) + rng.normal(0, 0.02, (900, 3, 3))
    corners = np.arange(2700, dtype=np.int32).reshape(-1, 3)
    mesh = Triangles(points.reshape(-1, 3).astype(np.float32), np.zeros((2700, 2), np.float32), corners)
    marks = rng.integers(0, 1 << 62, (900, 2)).astype(np.uint64)
    marks[rng.random((900, 2)) < 0.3] = 0
    return view, mesh, marks, (rng.random(900) < 0.2).astype(np.uint8)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(("seed", "first", "step"), [(0, 0, 1), (1, 2, 3), (2, 900, 1000)])
def test_marks_are_forgotten_where_a_view_sees_past_a_triangle(lens, seed, first, step):
    view, mesh, marks, invalid = random_case(lens, seed)
    bits = np.array([0b1011, 1 << 40], np.uint64)
    expected, forgotten = marks.copy(), 0
    for i, corners in enumerate(mesh.triangles):
        middle = mesh.points[corners].astype(np.float64).mean(axis=0)
        looked_at = i >= first and (i - first) % step == 0
        held = looked_at and not invalid[i] and (marks[i] & bits).any()
        if held and slow.looks_through(view.camera, view.codes, middle, DELTA):
            expected[i] &= ~bits
            forgotten += 1
    prepared = PreparedView(view, TriangulationOptions(0.0, 0.2), np.zeros(3))
    codes = prepared.addresses(measured=True)[0]
    found = forget_seen_past(prepared.table_row, codes, mesh, invalid, DELTA, bits, first, step, marks)
    assert found == forgotten
    assert (forgotten > 2) == (step < 900)
    np.testing.assert_array_equal(marks, expected)


def test_a_view_of_the_same_surface_forgets_nothing():
    camera = dataclasses.replace(see(Camera("v", LENSES["flat"], Pose(), CODING)).camera)
    view = see(camera)
    rng = np.random.default_rng(0)
    uv = rng.uniform(1, 35, (300, 2))
    points = camera.unproject(uv, np.full(300, 4.0)).astype(np.float32)
    mesh = Triangles(points, uv.astype(np.float32), np.arange(300, dtype=np.int32).reshape(-1, 3))
    marks = np.ones((100, 1), np.uint64)
    prepared = PreparedView(view, TriangulationOptions(0.0, 0.2), np.zeros(3))
    invalid = np.zeros(100, np.uint8)
    row, codes = prepared.table_row, prepared.addresses(measured=True)[0]
    assert forget_seen_past(row, codes, mesh, invalid, DELTA, np.ones(1, np.uint64), 0, 1, marks) == 0
