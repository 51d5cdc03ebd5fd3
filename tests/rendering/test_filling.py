"""Disocclusion filling: no hole is left, drawn pixels do not change, far surfaces continue behind near ones."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from farside.clients.bench import fill as command
from farside.engine.evaluation.filling import similarity
from farside.engine.evaluation.metrics import ssim
from farside.engine.kernels.rendering import structure
from farside.engine.kernels.rendering.records import Planes
from farside.engine.rendering.filling import fill, rise_per_pixel
from farside.engine.rendering.tiles import HoleMap
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture
from farside.engine.support.runtime import set_thread_count, thread_count
from farside.engine.synth import write_twin
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle.structure import continued

UNSEEN = -1e6  # a colour that must not leak into any pixel


def picture(disparity, luma):
    """Planes with the given luma where something was drawn; chroma follows luma so that mixing shows."""
    disparity = np.asarray(disparity, np.float32)
    luma = np.where(disparity > 0, np.broadcast_to(np.asarray(luma, np.float32), disparity.shape), UNSEEN)
    return disparity, tuple(np.ascontiguousarray(plane, np.float32) for plane in (luma, luma / 2, luma / 4))


def filled(disparity, luma, rise=0.01, *, structured=True):
    disparity, planes = picture(disparity, luma)
    fill(disparity, planes, rise, structured=structured)
    return planes


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(1, 37), st.integers(1, 37), st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.4, 0.95, 1]),
       st.sampled_from([0.0, 0.05, 1e9]), st.booleans())  # fmt: skip
def test_every_hole_gets_a_colour_of_the_picture_and_nothing_drawn_changes(h, w, seed, share, rise, structured):
    rng = np.random.default_rng(seed)
    disparity = np.where(rng.random((h, w)) < share, rng.uniform(0.1, 2.0, (h, w)), 0.0)
    disparity[rng.integers(h), rng.integers(w)] = 1.0
    disparity, planes = picture(disparity, rng.uniform(64, 940, (h, w)))
    before, drawn = [plane.copy() for plane in planes], disparity > 0
    unchanged = disparity.copy()
    fill(disparity, planes, rise, structured=structured)
    np.testing.assert_array_equal(disparity, unchanged)  # holes stay marked
    for plane, old in zip(planes, before, strict=True):
        np.testing.assert_array_equal(plane[drawn], old[drawn])
        assert plane.min() >= old[drawn].min() * (1 - 1e-5)
        assert plane.max() <= old[drawn].max() * (1 + 1e-5)


@pytest.mark.parametrize("structured", [False, True])
@pytest.mark.parametrize("shape", [(1, 1), (1, 17), (17, 1), (2, 3), (64, 64), (33, 5)])
def test_a_single_pixel_colours_everything(shape, structured):
    disparity = np.zeros(shape)
    disparity[shape[0] // 2, shape[1] // 3] = 0.7
    for plane, value in zip(filled(disparity, 600, structured=structured), (600, 300, 150), strict=True):
        np.testing.assert_allclose(plane, value, rtol=1e-5)


@pytest.mark.parametrize("width", [1, 4, 15])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("flip", [False, True])
def test_a_hole_between_near_and_far_takes_the_far_colour(width, axis, flip):
    column = np.arange(60)
    near, hole = column < 12, (column >= 12) & (column < 12 + width)
    disparity = np.broadcast_to(np.where(hole, 0.0, np.where(near, 2.0, 0.25)), (21, 60))
    luma = np.broadcast_to(np.where(near, 900, 200), (21, 60))
    if flip:
        disparity, luma, hole = disparity[:, ::-1], luma[:, ::-1], hole[::-1]
    if axis == 0:
        found = filled(disparity.T, luma.T)[0].T
    else:
        found = filled(disparity, luma)[0]
    np.testing.assert_allclose(found[:, hole], 200, atol=8)


def test_structure_goes_on_into_a_narrow_hole():
    """Stripes that run into a hole from both sides continue inside it."""
    luma = np.broadcast_to(np.where(np.arange(32) % 8 < 4, 200, 800)[:, None], (32, 32))
    disparity = np.full((32, 32), 0.5)
    disparity[:, 14:18] = 0.0
    found = filled(disparity, luma)[0]
    inner = np.arange(32) % 4 % 3 != 0  # not next to a stripe's rim
    assert np.abs(found[inner] - luma[inner])[:, 14:18].max() < 120


def behind_a_disc(angle, period, shift, radius=14, size=64):
    """Stripes at an angle behind a disc that has moved right by `shift`: returns disparity, luma and true luma."""
    y, x = np.mgrid[0:size, 0:size] - size / 2.0
    stripes = 350 + 100 * np.sin(2 * math.pi / period * (y * math.cos(angle) - x * math.sin(angle)))
    disc, hole = np.hypot(y, x - shift) <= radius, np.hypot(y, x) <= radius
    disparity = np.where(disc, 1.5, np.where(hole, 0.0, 0.3))
    return disparity, np.where(disc, 900, stripes), stripes


@pytest.mark.parametrize("degrees", [0, 20, 45, 70, 110, 160])
def test_stripes_behind_a_disc_go_on_at_their_slope(degrees):
    shift = 8
    disparity, luma, stripes = behind_a_disc(math.radians(degrees), 12, shift)
    hole, rise = disparity == 0, (1.5 - 0.3) / shift
    smooth, structured = (
        np.abs(filled(disparity, luma, rise, structured=flag)[0] - stripes)[hole].mean() for flag in (False, True)
    )
    assert structured < 0.65 * smooth


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("shift", [2, 5, 11])
def test_the_colour_of_what_hides_a_hole_never_gets_into_it(mixed, shift):
    disparity, luma, stripes = behind_a_disc(0.5, 12, shift)
    hole = disparity == 0
    if mixed:  # what was seen at the disc's edge is half of either
        beside = np.zeros_like(hole)
        beside[:, :-1] |= hole[:, 1:]
        luma = np.where(beside & (disparity == 0.3), 0.5 * (stripes + 900), luma)
    rise = (1.5 - 0.3) / (shift + 2)  # the hole has corners
    # Smooth colours deep inside contain a little of the rim's.
    assert filled(disparity, luma, rise)[0][hole].max() < (560 if mixed else 452)
    continued, layer = continue_everywhere(disparity, luma, rise, 40)
    assert np.all(layer[hole] > 0)
    assert continued[0][hole].max() < 453


def test_a_hole_at_the_border_is_continued_from_inside():
    luma = np.broadcast_to(np.where(np.arange(40) % 10 < 5, 200, 800)[:, None], (40, 60))
    disparity = np.full((40, 60), 0.5)
    disparity[:, 50:] = 0.0
    found = filled(disparity, luma)[0]
    inner = np.arange(40) % 5 == 2
    assert np.abs(found[inner] - luma[inner])[:, 50:53].max() < 60


def test_a_picture_without_holes_stays_as_it_is():
    rng = np.random.default_rng(0)
    disparity, planes = picture(rng.uniform(0.1, 1, (33, 47)), rng.uniform(64, 940, (33, 47)))
    before = [plane.copy() for plane in planes]
    fill(disparity, planes, 0.1)
    for plane, old in zip(planes, before, strict=True):
        np.testing.assert_array_equal(plane, old)


def continue_everywhere(disparity, luma, rise, layers):
    """Planes in which the kernels have coloured `layers` layers of the holes, and the layer of each pixel."""
    disparity, planes = picture(disparity, luma)
    holes = HoleMap.of(disparity)
    places, index = holes.listed(disparity)
    listed = structure.Holes(places, index, holes.rims(disparity, index))
    depths = np.empty((len(places), 2), np.float32)
    structure.spread_depths(disparity, listed, rise, depths)
    disc, layer = structure.disc_weights(2.5, 2.0), np.zeros(disparity.shape, np.int32)
    structure.continue_structure(disparity, listed, depths, layers, disc, layer, Planes(*planes))
    return planes, layer


@pytest.mark.parametrize(("seed", "rise"), [(0, 0.0), (1, 0.02), (2, 0.1), (3, 1e6)])
def test_structure_is_continued_as_the_slow_twin_does(seed, rise):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:30, 0:34]
    disparity = np.where(x + 3 * np.sin(y) < 12, 1.3, 0.3 + 0.004 * y)  # something near, and a slanted plane
    disparity[np.hypot(y - 14, x - 16) < 8] = 0.0
    disparity[25:, 28:] = 0.0
    disparity[rng.random(disparity.shape) < 0.05] = 0.0
    luma = 500 + 200 * np.sin(x / 2 + y / 3) + rng.uniform(-20, 20, y.shape)
    expected, layers = continued(*picture(disparity, luma), rise, 2.5, 2.0, 12)
    found, layer = continue_everywhere(disparity, luma, rise, 12)
    np.testing.assert_array_equal(layer, layers)
    assert layers.max() > 4
    for plane, twin in zip(found, expected, strict=True):
        np.testing.assert_allclose(plane, twin, rtol=1e-4)


def test_the_number_of_threads_changes_nothing():
    disparity, luma, _ = behind_a_disc(0.5, 9, 11, size=200)
    threads, results = thread_count(), []
    try:
        for count in (1, max(2, threads)):
            set_thread_count(min(count, threads))
            results.append(filled(disparity, luma))
    finally:
        set_thread_count(threads)
    for one, many in zip(*results, strict=True):
        np.testing.assert_array_equal(one, many)


def test_surfaces_part_by_as_many_pixels_as_the_rise_says():
    coding = DepthCoding(0.5, 20.0, 16)
    projection = Perspective.from_fov(400, 300, 1.0)
    source, target = (Camera("c", projection, Pose((0.0, y, 0.0)), coding) for y in (0.0, 0.2))
    near, far = (target.project([1.0 / q, 0.05, 0.0])[0][0] - source.project([1.0 / q, 0.05, 0.0])[0][0]
                 for q in (0.9, 0.4))  # fmt: skip
    other = Camera("o", projection, Pose((0.0, 0.3, 0.0)), coding)
    assert (0.9 - 0.4) / rise_per_pixel(target, [other, source]) == pytest.approx(abs(near - far))
    assert math.isfinite(rise_per_pixel(target, [target]))
    assert math.isfinite(rise_per_pixel(target, []))


def test_the_benchmark_compares_kinds_of_filling_inside_holes(tmp_path, capsys):
    write_twin("painter", tmp_path / "painter", 0.04, 1)
    command.command(tmp_path / "painter", ["t2"], quality="fast", background=False)
    found = re.search(r"t2 │ +([0-9.]+) │ +([0-9.]+) / ([0-9.]+) │ +([0-9.]+) / ([0-9.]+)", capsys.readouterr().out)
    assert found
    share, *figures = map(float, found.groups())
    assert 0.1 < share < 50
    assert 10 < figures[0] < 50
    assert 10 < figures[2] < 50
    assert all(0 < alike <= 1 for alike in figures[1::2])


def test_similarity_round_each_pixel_has_the_mean_that_the_metric_has():
    rng = np.random.default_rng(1)
    planes = [rng.integers(0, 1024, (30, 40)).astype(np.uint16) for _ in range(2)]
    textures = [Texture(plane, *[np.zeros((15, 20), np.uint16)] * 2) for plane in planes]
    assert similarity(*planes)[5:-5, 5:-5].mean() == pytest.approx(ssim(*textures))
    np.testing.assert_allclose(similarity(planes[0], planes[0]), 1.0)
