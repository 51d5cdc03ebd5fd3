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
from farside.engine.kernels.geometry.cuts import BROKEN
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Equirectangular, Perspective, Pose
from farside.engine.rig.frame import View
from oracle.uncovered import uncovered
from support.rooms import CODING, camera_row, see, texture_of

ORIGIN = np.zeros(3)
REACH = 0.08
PROJECTIONS = {"perspective": None, "sphere": Equirectangular(330, 230, (-0.7, 0.7), (-0.5, 0.5))}


def prepared(camera, box_y, *, spoiled=False):
    view = see(camera, box_y)
    if spoiled:  # a patch without depth
        h, w = view.codes.shape
        view.codes[h // 3 : h // 2, w // 6 : w // 4] = 0
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


WALL_ROUND = Equirectangular(256, 128, (-np.pi, np.pi), (-np.pi / 2, np.pi / 2))
LENSES = {"large": (320, 214), "odd": (97, 67), "of two blocks": (33, 18), "of one": (12, 10)}


def room_round(camera):
    """A ball's inside with a step in it, as an all-round camera in its middle sees it: the picture has no side."""
    azimuth = np.pi - (np.arange(camera.width) + 0.5) / camera.width * 2 * np.pi
    depth = np.where(np.abs(azimuth - 2.9) < 0.1, 2.0, 4.0) * np.ones((camera.height, 1))
    luma = np.full(depth.shape, 500)
    return PreparedView(View(camera, texture_of(luma), CODING.codes(depth)), TriangulationOptions(0.0, 0.1), ORIGIN)


@pytest.mark.parametrize("reach", [0.0, 0.02, 0.1, 0.5])
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("lens", [*LENSES, "all round"])
def test_cells_are_those_of_the_slow_twin(lens, projection, reach):
    cameras = camera_row(3, LENSES.get(lens, (320, 214)))
    chosen = PROJECTIONS[projection] or Perspective.from_fov(150, 101, 1.2)
    if lens == "all round":
        round_about = dataclasses.replace(cameras[0], projection=WALL_ROUND, pose=Pose())
        views = [room_round(round_about)]
    else:
        views = [prepared(camera, 0.1, spoiled=lens in ("large", "odd")) for camera in cameras[:2]]
    if lens == "large":
        views[0].view.codes[40:60, 81:90] = 0  # a cut beside a block's last column
    head = Pose.from_euler((-0.1, 0.05, 0.03), 0.05 if lens != "all round" else np.pi, 0.03, 0.1)
    camera = enlarged(dataclasses.replace(cameras[0], pose=head, projection=chosen), CODING)
    broken = [view.cuts & BROKEN != 0 for view in views]
    expected = uncovered([view.view for view in views], broken, camera, reach)
    np.testing.assert_array_equal(uncovered_cells(camera, views, reach, ORIGIN), expected)
    if lens in ("large", "all round") and reach < 0.1:
        assert 0 < expected.mean() < 1
