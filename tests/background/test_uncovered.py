"""The parts of a background image that are made: all that a nearby eye can see past the views, and little more."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from farside.engine.background.pbi import enlarged, uncovered_cells
from farside.engine.geometry.prepared_view import PreparedView
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.background.uncovered import CELL
from farside.engine.rendering.canvas import Canvas
from farside.engine.rendering.target import Target
from farside.engine.rig.camera import Equirectangular, Pose
from support.rooms import CODING, camera_row, see

ORIGIN = np.zeros(3)
REACH = 0.08
PROJECTIONS = {"perspective": None, "sphere": Equirectangular(330, 230, (-0.7, 0.7), (-0.5, 0.5))}


def prepared(camera, box_y, *, spoiled=False):
    view = see(camera, box_y)
    if spoiled:  # a patch without depth
        view.codes[70:100, 50:75] = 0
    return PreparedView(view, TriangulationOptions(0.0, 0.1), ORIGIN)


def drawn(views, camera):
    """Disparity [h, w] of the drawn views, 0 where nothing is drawn."""
    canvas = Canvas(camera.width, camera.height)
    for number, view in enumerate(views):
        canvas.draw(view.mesh(), Target(camera, ORIGIN), number, 0.01, 0.0)
    return canvas.disparity


@pytest.mark.parametrize("spoiled", [False, True])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_no_eye_near_by_sees_a_hole_elsewhere(projection, count, spoiled):
    cameras = camera_row(3, (320, 214))
    views = [prepared(camera, 0.1, spoiled=spoiled) for camera in cameras[:count]]
    head = Pose.from_euler((-0.1, 0.05, 0.03), 0.05, 0.03, 0.1)
    chosen = PROJECTIONS[projection] or cameras[0].projection
    camera = enlarged(dataclasses.replace(cameras[0], pose=head, projection=chosen), CODING)
    wanted = uncovered_cells(camera, views, REACH, ORIGIN)
    assert 0.1 < wanted.mean() < 0.8
    background = [prepared(cameras[0], None), prepared(cameras[2], None)]
    for step in itertools.product((-1, 1), repeat=3):
        eye = dataclasses.replace(camera, pose=head.translated(REACH * np.array(step) / np.sqrt(3)))
        behind = drawn(background, eye)
        hole = (drawn(views, eye) == 0) & (behind > 0)
        assert hole.any()
        v, u = np.nonzero(hole)
        points = eye.unproject(np.stack([u, v], -1) + 0.5, 1.0 / behind[hole])
        uv, depth = camera.project(points)
        inside = (depth > 0) & np.all((uv >= 0) & (uv < (camera.width, camera.height)), axis=-1)
        column, row = (uv[inside] // CELL).astype(int).T
        assert wanted[row, column].all()


def test_what_no_view_sees_is_wanted_and_a_wall_is_not():
    cameras = camera_row(3, (320, 214))
    view = prepared(cameras[1], None)
    assert uncovered_cells(cameras[1], [view], 0.05, ORIGIN)[8:-8, 8:-8].max() == 0
    away = dataclasses.replace(cameras[1], pose=Pose.from_euler((0, 0, 0), np.pi, 0, 0))
    assert uncovered_cells(away, [view], 0.05, ORIGIN).min() == 1
