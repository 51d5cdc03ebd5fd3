"""Coverage selection and the farther-only test: which parts of the first views become the S-PBS."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.coverage import Coverage, choose_views
from farside.engine.kernels.background.farther_only import BLOCK, mark_smooth
from farside.engine.rig.camera import Equirectangular, Pose
from farside.engine.rig.frame import View
from farside.engine.settings import Settings
from oracle import coverage as slow_coverage
from support.models import model_of
from support.rooms import CODING, WALL_X, camera_row, frame, see


def test_the_view_that_overlaps_least_comes_next():
    row = camera_row(3)
    back = dataclasses.replace(row[0], name="back", pose=Pose.from_euler((0, 0, 0), np.pi, 0, 0))
    views = [see(c) for c in row]
    behind = View(back, views[0].texture, views[0].codes)
    assert choose_views([*views, behind], 2) == [0, 3]
    assert choose_views([*views, behind], 3) == [0, 3, 2]
    assert sorted(choose_views([*views, behind], 9)) == [0, 1, 2, 3]


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("delta", [(0.08, 0.0), (0.01, 0.006)])
def test_only_farther_pixels_of_later_views_are_kept(wide, delta):
    cameras = camera_row(3)
    if wide:
        projection = Equirectangular(64, 48, (-0.9, 0.8), (-0.5, 0.5))
        cameras[1] = dataclasses.replace(cameras[1], projection=projection)
    views = [see(camera, box_y=0.1) for camera in cameras]
    if wide:  # the room's oracle is for perspective cameras, but any depth will do
        rng = np.random.default_rng(0)
        codes = CODING.codes(rng.uniform(2.0, 6.0, (48, 64)))
        codes[rng.random(codes.shape) < 0.1] = 0
        views[1] = View(cameras[1], see(camera_row(1, (64, 48))[0]).texture, codes)
    coverage, edge = Coverage(delta), 0.05
    assert coverage.keep_farther(views[0], edge).all()
    coverage.keep_farther(views[1], edge)
    expected = slow_coverage.farther_pixels(views[2], views[:2], delta, edge)
    np.testing.assert_array_equal(coverage.keep_farther(views[2], edge) != 0, expected)
    assert 0.02 < expected.mean() < 0.5


@pytest.mark.parametrize("size", [(64, 48), (61, 46), (8, 8), (9, 2), (1, 1)])
def test_blocks_are_smooth_whose_depths_lie_between_their_corners(size):
    w, h = size
    camera = camera_row(1, size)[0]
    rng = np.random.default_rng(0)
    codes = np.add.outer(30 * np.arange(h), 20 * np.arange(w)).astype(np.uint16) + np.uint16(9000)
    rough = rng.random(codes.shape) < 0.01
    codes[rough] += rng.integers(-9000, 200, rough.sum()).astype(np.uint16)
    smooth = np.empty((max(1, -(-(h - 1) // BLOCK)), max(1, -(-(w - 1) // BLOCK))), np.uint8)
    mark_smooth(codes, camera.depth.packed(), (0.08, 0.0), smooth)
    depth, step = camera.depth.depth(codes), camera.depth.step
    for row, column in np.ndindex(*smooth.shape):
        block = np.s_[BLOCK * row : BLOCK * row + BLOCK + 1, BLOCK * column : BLOCK * column + BLOCK + 1]
        part = codes[block].astype(float)
        y, x = (np.linspace(0, 1, n) for n in part.shape)
        corners = part[np.ix_([0, -1], [0, -1])]
        between = np.stack([1 - y, y], -1) @ corners @ np.stack([1 - x, x])
        limit = 0.25 * 0.08 / (depth[block][[0, 0, -1, -1], [0, -1, 0, -1]].max() ** 2 * step)
        assert smooth[row, column] == (corners.min() > 0 and np.abs(part - between).max() <= limit)
    assert size != (61, 46) or 0.2 < smooth.mean() < 0.8


def test_the_s_pbs_takes_from_later_views_only_what_earlier_ones_do_not_show():
    cameras = camera_row()
    first, count = frame(0, cameras), (96 - 1) * (64 - 1) * 2  # two triangles for each square of pixels
    sizes = {}
    for n_init in (1, 2, 3):
        settings = Settings(n_init=n_init, tolerance_px=0.0)
        sizes[n_init] = model_of(cameras, first, settings)[1].s_pbs
    assert sizes[1] == count
    # Each camera sees 0.4 m of the wall that its neighbour, 0.4 m away, does not see: seven of 96 columns.
    strip = 0.4 / (2 * WALL_X * np.tan(0.6)) * count
    assert sizes[2] - sizes[1] == pytest.approx(2 * strip, rel=0.2)  # the second is the view that overlaps least
    assert sizes[2] <= sizes[3] < sizes[2] + 0.02 * count  # the third sees nothing new, but for the border of a pixel
