"""delta, margins and noise follow from the scene."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.background.tolerances import sampled_disparity, scene_tolerances, with_noise
from farside.engine.geometry.scene_scale import Scene
from farside.engine.rig.frame import Frame
from farside.engine.settings import Settings
from support.rooms import CODING, WALL_X, camera_row, frame, see


def test_delta_follows_from_the_scene_unless_it_is_set():
    views = frame(0, camera_row()).views
    found = scene_tolerances(views, Settings())
    assert found.delta_m == pytest.approx(0.02 * WALL_X, rel=0.01)
    assert found.delta_at(20.0) == pytest.approx(found.delta_m, rel=0.01)  # fine codes have much smaller steps
    coarse = dataclasses.replace(CODING, bits=8)
    camera = dataclasses.replace(camera_row(1)[0], depth=coarse)
    found = scene_tolerances([see(camera)], Settings())
    assert found.delta_m == pytest.approx(0.02 * WALL_X, rel=0.03)
    for depth in (WALL_X, 10.0):  # four steps of the codes at that depth
        assert found.delta_at(depth) == pytest.approx(4 * coarse.step * depth**2)
    empty = see(camera_row(1)[0], wall=False)
    with pytest.raises(ValueError, match="no view has a valid depth"):
        scene_tolerances([empty], Settings())


def test_the_papers_delta_is_one_length_whatever_codes_and_noise_are():
    camera = dataclasses.replace(camera_row(1)[0], depth=dataclasses.replace(CODING, bits=8))
    settings = Settings(delta_m=0.2)
    view = see(camera)
    found = scene_tolerances([view], settings)
    noisy = with_noise(found, [sampled_disparity(camera, view.codes) + 0.01], [view], settings)
    assert noisy.noise > 0.005
    for depth in (0.5, 4.0, 20.0):
        assert found.delta_at(depth) == noisy.delta_at(depth) == 0.2
    by_hand = scene_tolerances([view], Settings(delta_m=0.1, delta_disparity=0.05, margin_m=0.03))
    assert (by_hand.delta_at(1.0), by_hand.delta_at(4.0), by_hand.margin_m) == (0.1, 0.8, 0.03)
    depths = np.array([0.5, 1.0, 2.0, 4.0, 30.0])
    np.testing.assert_allclose(by_hand.before_delta(depths + by_hand.delta_at(depths)), depths)


@pytest.mark.parametrize("name", ["delta_m", "delta_disparity", "margin_m", "backdrop_m"])
def test_tolerances_that_make_no_sense_are_named(name):
    for value in (-0.1, math.nan):
        with pytest.raises(ValueError, match=f"{name}: {value}: expected at least 0"):
            Settings(**{name: value})


@pytest.mark.parametrize("scale", [0.01, 30.0])
def test_a_scene_of_another_size_has_tolerances_of_that_size(scale):
    """All distances are scaled by `scale`; codes and their errors are the same: lengths grow, disparities shrink."""
    rng = np.random.default_rng(1)
    cameras = camera_row()
    sized = [
        dataclasses.replace(
            c,
            pose=dataclasses.replace(c.pose, position=tuple(scale * p for p in c.pose.position)),
            depth=dataclasses.replace(c.depth, near=scale * c.depth.near, far=scale * c.depth.far),
        )
        for c in cameras
    ]
    first = frame(0, cameras, box_y=0.0)
    errors = [rng.integers(-40, 41, view.codes.shape) for view in first.views]
    found = []
    for rig in (cameras, sized):
        views = [dataclasses.replace(view, camera=camera) for view, camera in zip(first.views, rig, strict=True)]
        later = [
            dataclasses.replace(view, codes=(view.codes + error).astype(np.uint16))
            for view, error in zip(views, errors, strict=True)
        ]
        sampled = [sampled_disparity(view.camera, view.codes) for view in views]
        tolerances = with_noise(scene_tolerances(views, Settings()), sampled, later, Settings())
        options = Scene.of(rig, Settings(), Frame(0, tuple(views))).triangulation(rig[0], Settings())
        lengths = [tolerances.delta_m, tolerances.margin_m, tolerances.depth_m]
        disparities = [tolerances.delta_disparity, tolerances.noise, tolerances.margin_disparity(rig[0].depth)]
        found.append((lengths, [*disparities, options.edge, options.tolerance]))
    (lengths, disparities), (sized_lengths, sized_disparities) = found
    np.testing.assert_allclose(sized_lengths, np.multiply(scale, lengths))
    np.testing.assert_allclose(sized_disparities, np.divide(disparities, scale))
    assert min(lengths) > 0
    assert min(disparities) > 0


def test_more_noise_makes_a_larger_delta():
    view = see(camera_row(1)[0])
    known = scene_tolerances([view], Settings())
    sampled = sampled_disparity(view.camera, view.codes)
    rng = np.random.default_rng(0)
    errors = rng.normal(size=view.codes.shape)
    deltas = []
    for deviation in (20.0, 100.0, 500.0):  # codes
        codes = np.rint(view.codes + deviation * errors).astype(np.uint16)
        found = with_noise(known, [sampled], [dataclasses.replace(view, codes=codes)], Settings())
        # The difference of two frames that both had this noise would be sqrt(2) times what is expected here.
        expected = 1.0483 * 0.6745 * deviation * CODING.step
        assert found.noise == pytest.approx(expected, rel=0.1)
        deltas.append(found.delta_at(2 * WALL_X))
    assert deltas[0] < deltas[1] < deltas[2]
    assert deltas[2] == pytest.approx(8 * found.noise * (2 * WALL_X) ** 2)
