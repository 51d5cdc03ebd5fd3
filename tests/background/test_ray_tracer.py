"""The model works the same with another ray tracer, which is slow and shares no code with the first."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.model import BackgroundModel
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.settings import Settings
from support.rooms import CODING, camera_row, frame
from support.slow_tracer import SlowTracer

EYE = Camera("eye", Perspective.from_fov(21, 15, 0.8), Pose.from_euler((-0.15, 0.07, 0.03), 0.03, 0.02, 0.1), CODING)


@pytest.mark.parametrize(
    "settings",
    [
        Settings(n_init=1),
        Settings(n_init=2, culling_stride=2),
        Settings(n_init=1, viewing_space=(0.0, 0.0, 0.0, 0.2)),
    ],
    ids=["by triangle", "by pixel", "viewing space"],
)
def test_a_model_over_another_tracer_is_the_same_model(settings):
    cameras = camera_row(2, (24, 16))
    first = frame(0, cameras, box_y=0.0)
    scene = Scene.of(cameras, settings, first)
    models = [BackgroundModel(cameras, settings, scene, tracer) for tracer in (None, SlowTracer())]
    reports = []
    for index, box_y in enumerate((0.0, 0.2, 0.4, None, None)):
        seen = frame(index, cameras, box_y=box_y)
        one, other = (dataclasses.replace(model.update(seen), rays=0, stages={}) for model in models)
        assert one == other
        reports.append(one)
        fast, slow = (model.state().surfaces for model in models)
        for a, b in zip(fast, slow, strict=True):
            np.testing.assert_array_equal(a.points, b.points)
            np.testing.assert_array_equal(a.invalid, b.invalid)
            np.testing.assert_array_equal(a.marks, b.marks)
        options = [scene.triangulation(camera, settings) for camera in cameras]
        prepared = zip(seen.views, options, strict=True)
        present = ViewTable([PreparedView(view, option, scene.origin) for view, option in prepared])
        for table in (None, present):
            views = [model.render_pbi(EYE, table, near=0.05, sparse=False).view for model in models]
            codes = np.array([view.codes.astype(int) for view in views])
            luma = np.array([view.texture.y.astype(int) for view in views])
            off = (np.ptp(codes, axis=0) > 1) | (np.ptp(luma, axis=0) > 1)
            assert off.mean() < 0.01  # rays through sides of triangles
            assert (codes > 0).mean() > 0.5
    assert sum(report.accepted for report in reports) > 0
    assert sum(report.culled for report in reports) > 0
