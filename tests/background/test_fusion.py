"""Flickering depth is averaged, frame by frame, and neither grows the model nor paints people on walls."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.rig.frame import Frame
from support.models import model_of, near_points, pbi_of
from support.rooms import BOX_X, BOX_Y, CODING, WALL_X, WALL_Y, camera_row, frame, see


def flickering(cameras, rng, index, box_y=None, share=0.004):
    """A frame whose depths have random relative errors of `share`."""
    views = []
    for view in frame(index, cameras, box_y).views:
        depth = CODING.depth(view.codes) * (1 + share * rng.standard_normal(view.codes.shape))
        views.append(dataclasses.replace(view, codes=CODING.codes(depth)))
    return Frame(index, tuple(views))


def test_noisy_depth_does_not_make_the_model_grow_and_is_averaged_away():
    cameras, rng = camera_row(), np.random.default_rng(0)
    model, first = model_of(cameras, flickering(cameras, rng, 0))
    off = {0: pbi_of(model, cameras[1])[0] - WALL_X}
    reports = {}
    for index in range(1, 257):
        reports[index] = model.update(flickering(cameras, rng, index))
        if index in (16, 64, 256):
            off[index] = pbi_of(model, cameras[1])[0] - WALL_X
    assert model.delta == pytest.approx(8 * 0.004 * WALL_X, rel=0.1)
    assert max(report.p_pbs for report in reports.values()) < 0.002 * 2 * 3 * 96 * 64  # of two triangles a pixel
    assert reports[256].s_pbs_valid <= first.s_pbs_valid
    assert np.nanmax(np.abs(off[256])) < 0.1
    rms = {index: np.sqrt(np.nanmean(values**2)) for index, values in off.items()}
    assert rms[0] > rms[16] > rms[64] > rms[256]
    # As many views as rounds, plus one; each surface is put into the tracer after 2, 4, 8, 16 and 32 of them.
    assert rms[64] < 1.3 * rms[0] / np.sqrt(5)
    assert rms[256] < 1.3 * rms[0] / np.sqrt(17)


def test_who_stood_there_for_a_while_is_not_averaged_into_the_wall():
    cameras, rng = camera_row(), np.random.default_rng(0)
    model, _first = model_of(cameras, flickering(cameras, rng, 0, box_y=0.0))
    for index in range(1, 20):
        model.update(flickering(cameras, rng, index, box_y=0.0))
    seen = see(cameras[1], box_y=0.0).texture.y[1:-1, 1:-1] == BOX_Y
    assert np.mean(pbi_of(model, cameras[1])[0][seen] < BOX_X + 0.2) > 0.2
    for index in range(20, 26):
        model.update(flickering(cameras, rng, index))
    assert len(near_points(model, BOX_X + 0.2)) == 0
    for index in range(26, 90):
        model.update(flickering(cameras, rng, index))
    depth, luma = pbi_of(model, cameras[1])
    assert np.nanmax(np.abs(depth - WALL_X)) < 0.1
    assert np.sqrt(np.nanmean((depth - WALL_X)[seen] ** 2)) < 0.5 * 0.004 * WALL_X
    assert np.mean(np.abs(luma.astype(int) - WALL_Y) > 2) < 0.005


def test_without_noise_nothing_is_fused():
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras, box_y=0.0))
    before = model.mesh().vertices
    for index in range(1, 40):
        assert model.update(frame(index, cameras, box_y=0.0)).rays == 0
    np.testing.assert_array_equal(model.mesh().vertices, before)
