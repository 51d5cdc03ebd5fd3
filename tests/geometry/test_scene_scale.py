"""Bounds of triangulations that follow from where cameras and viewers are."""

from __future__ import annotations

import dataclasses

import pytest
from farside.engine.geometry.scene_scale import Scene
from farside.engine.rig.camera import Pose
from farside.engine.settings import Settings
from support.rooms import camera_row, frame


def bounds(camera, cameras, settings, **options):
    return Scene.of(cameras, settings, frame(0, cameras)).triangulation(camera, settings, **options)


@pytest.mark.parametrize("settings", [Settings(), Settings(edge_px=3.0)])
def test_depth_edges_of_a_camera_far_away_are_those_that_viewers_see_in_the_middle_of_the_rig(settings):
    cameras = camera_row(5)  # the baseline is 0.4 m
    usual = bounds(cameras[0], cameras, settings)
    for away in (0.8, 1.59, 1.61, 6.0):
        far = dataclasses.replace(cameras[0], pose=Pose((0.0, 0.0, away)))
        found = bounds(far, cameras, settings, afar=True)
        expected = usual.edge * (1.0 if away < 1.6 else 0.4 / away)
        if settings.edge_px is None and away > 1.6:
            assert found.edge < usual.edge
        else:
            assert found.edge == pytest.approx(expected)
        assert (found.tolerance, found.max_block) == (usual.tolerance, usual.max_block)
        assert bounds(far, cameras, settings) == usual  # viewers may be near it


def test_an_edge_of_a_far_camera_is_a_number_of_pixels_as_the_middle_sees_it():
    cameras = camera_row(5)
    far = dataclasses.replace(cameras[0], pose=Pose((0.0, 0.0, 8.0)))
    scene = Scene.of(cameras, Settings(), frame(0, cameras))
    near_by = dataclasses.replace(scene, baseline=8.0)
    assert scene.triangulation(far, Settings(), afar=True).edge == near_by.triangulation(far, Settings()).edge
