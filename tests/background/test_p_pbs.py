"""A camera's turn: surfaces that later frames uncover become part of the P-PBS."""

from __future__ import annotations

import dataclasses

import numpy as np
from farside.engine.kernels.background.p_pbs import paint_triangles
from farside.engine.kernels.background.surfaces import Triangles
from farside.engine.rig.frame import Frame
from support.models import model_of, pbi_of
from support.rooms import CODING, WALL_X, camera_row, frame, see


def test_a_lone_wrong_depth_is_not_background_and_a_region_is():
    cameras = camera_row(1)
    model, _first = model_of(cameras, frame(0, cameras, box_y=0.0))
    view = see(cameras[0], box_y=0.0)
    codes = view.codes.copy()
    far = CODING.codes(np.array(10.0))
    codes[5, 5] = codes[50, 60] = far
    report = model.update(Frame(1, (dataclasses.replace(view, codes=codes),)))
    assert (report.candidates, report.accepted, report.p_pbs) == (2, 0, 0)
    codes[50:52, 60:62] = far
    report = model.update(Frame(2, (dataclasses.replace(view, codes=codes),)))
    assert (report.candidates, report.accepted) == (5, 4)
    assert report.p_pbs > 0


def test_depth_that_was_missing_is_added_when_it_is_seen():
    cameras = camera_row(1)
    first = see(cameras[0])
    codes = first.codes.copy()
    codes[20:40, 30:50] = 0
    model, _report = model_of(cameras, Frame(0, (dataclasses.replace(first, codes=codes),)))
    assert np.isnan(pbi_of(model, cameras[0])[0][22:36, 32:46]).all()
    report = model.update(frame(1, cameras))
    assert report.accepted == 20 * 20
    assert report.p_pbs > 0
    np.testing.assert_allclose(pbi_of(model, cameras[0])[0], WALL_X, atol=0.02)


def test_a_pixel_that_several_triangles_touch_is_the_last_ones_every_time():
    grid = np.stack(np.meshgrid(np.arange(33) + 0.5, np.arange(33) + 0.5), axis=-1).reshape(-1, 2).astype(np.float32)
    corner = (np.arange(32)[:, None] * 33 + np.arange(32)).reshape(-1, 1)
    half = np.concatenate([corner + np.array([0, 33, 1]), corner + np.array([1, 33, 34])]).astype(np.int32)
    triangles = np.tile(half, (40, 1))  # corners lie on pixels' centres: each touches its neighbours' pixels
    mesh = Triangles(np.zeros((33 * 33, 3), np.float32), grid, triangles)
    numbers, invalid = np.full((33, 33), -1, np.int32), np.zeros(len(triangles), np.uint8)
    for _ in range(5):
        paint_triangles(mesh, invalid, False, False, numbers)
        expected = np.full(33 * 33, -1)
        for k in range(3):
            np.maximum.at(expected, triangles[:, k], np.arange(len(triangles)))
        np.testing.assert_array_equal(numbers, expected.reshape(33, 33))
    paint_triangles(mesh, invalid, False, True, numbers)
    assert (numbers == -1).all()
