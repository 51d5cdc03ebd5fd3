"""The preset `paper`: the steps of the published algorithm, by counts and pictures, and the commands that accept it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.model import BackgroundModel
from farside.engine.background.tolerances import Tolerances
from farside.engine.geometry.scene_scale import Scene
from farside.engine.live.governor import make_ladder
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, View
from farside.engine.settings import PRESETS, Settings
from farside.server.settings import ServerSettings
from support.rooms import CODING, FAR_X, NEAR_X, NEAR_Y, camera_row, frame, see, wall_with_window

PAPER = Settings.preset("paper")
W, H = 48, 32
QUADS = (W - 1) * (H - 1)


def first_report(cameras, settings, views=None):
    """The model of a first frame and its report; a wall where no views are given."""
    first = Frame(0, tuple(views)) if views else frame(0, cameras)
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    return model, model.update(first)


def test_its_constants_are_those_of_section_4_1():
    assert (PAPER.n_render, PAPER.n_init, PAPER.n_update) == (5, 6, 1)
    model, _ = first_report(camera_row(2, (W, H)), PAPER)
    assert model.tolerances.delta_m == model.tolerances.margin_m == 0.2
    assert model.tolerances.delta_disparity == model.tolerances.noise == 0.0
    assert model.tolerances.delta_at(100.0) == pytest.approx(0.2)


def test_it_draws_two_triangles_a_pixel_of_every_view():
    cameras = camera_row(3, (W, H))
    engine = Engine(cameras, PAPER)
    report = engine.update(frame(0, cameras), {"me": cameras[1]})
    assert report.triangles == 3 * 2 * QUADS
    assert engine.render_camera(cameras[1]).report.warped >= 2 * QUADS  # where one view covers all, no other is drawn
    default = Engine(cameras, Settings.preset("balanced"))
    assert default.update(frame(0, cameras), {"me": cameras[1]}).triangles < 2 * QUADS


def test_it_models_with_two_triangles_a_pixel_and_culls_those_across_depth_edges():
    (camera,) = camera_row(1, (W, H))
    model, report = first_report([camera], PAPER)
    assert report.s_pbs == report.s_pbs_valid == 2 * QUADS
    cameras = camera_row(3, (W, H))
    for model_rims in (False, True):
        settings = dataclasses.replace(PAPER, model_rims=model_rims, n_init=1)
        model, _ = first_report(cameras, settings, [see(camera, box_y=0.0) for camera in cameras])
        x = model.mesh().vertices[:, 0]
        assert np.isclose(x, 4.0, atol=0.01).sum() + np.isclose(x, 2.5, atol=0.01).sum() == len(x)
        triangles = model.mesh().triangles
        across = np.ptp(x[triangles], axis=1) > 0.5
        assert not across.any()
        assert (len(triangles) < 2 * QUADS - 40) != model_rims  # the box's outline is 40 pixels and more


def test_it_casts_two_rays_a_pixel_each_with_a_complementary_one():
    """The triangles of the outermost row and column of pixels would lie outside the picture."""
    (camera,) = camera_row(1, (W, H))
    rays = {}
    for delta in (0.2, 0.0):
        settings = dataclasses.replace(PAPER, delta_m=delta)
        _model, report = first_report([camera], settings)
        rays[delta] = report.rays
        assert report.culled == 0  # every triangle is found
    hits = 2 * QUADS
    assert hits <= rays[0.0] <= 2 * W * H
    assert rays[0.2] == rays[0.0] + hits


def test_a_complementary_ray_finds_the_surface_that_z_fights():
    """Two walls 0.1 m apart, of different cameras: the rays of both hit the farther one, and mark both."""
    cameras = camera_row(2, (W, H))
    wall = see(cameras[0])
    nearer = View(cameras[0], wall.texture, CODING.codes(np.full((H, W), 3.9)))
    kept = {}
    for delta in (0.3, 0.04):  # the first camera's triangles are there before it is known that others are farther
        settings = dataclasses.replace(PAPER, delta_m=delta)
        model, _ = first_report(cameras, settings, [nearer, see(cameras[1])])
        vertices = model.mesh().vertices
        kept[delta] = np.count_nonzero(np.abs(vertices[:, 0] - 3.9) < 0.02)
    assert kept[0.3] > 0.9 * W * H
    assert kept[0.04] < 0.5 * kept[0.3]


def test_only_cameras_of_the_s_pbs_cast_its_rays_and_what_they_miss_is_culled():
    cameras = camera_row(3, (W, H))
    _model, report = first_report(cameras, dataclasses.replace(PAPER, n_init=1))
    assert report.rays <= 4 * W * H
    box = [see(camera, box_y=0.0) for camera in cameras]
    _model, strict = first_report(cameras, PAPER, box)
    _model, kind = first_report(cameras, dataclasses.replace(PAPER, rays_by_triangle=True), box)
    assert strict.culled >= kind.culled
    assert strict.rays <= 3 * 4 * W * H < kind.rays + 3 * 4 * W * H
    with pytest.raises(ValueError, match="rays_by_triangle: False: expected True where culling_stride is 0"):
        Settings(rays_by_triangle=False)


def test_maximum_depth_images_change_only_where_something_farther_is_seen():
    (camera,) = camera_row(1, (W, H))
    first, tolerances = see(camera, box_y=0.0), Tolerances(0.2, 0.2)
    images = [MaximumDepthImage(first, tolerances, edge=0.05, refine=refine) for refine in (True, False)]
    assert images[0].flags.any()  # colours at the box's outline are provisional
    assert not images[1].flags.any()
    assert images[0].table_row()[-1] == images[1].table_row()[-1]  # both fetch colours by the same edges
    brighter = dataclasses.replace(first.texture, y=first.texture.y + np.uint16(40))
    again = View(camera, brighter, first.codes)
    for _ in range(20):
        images[1].update(again)
    np.testing.assert_array_equal(images[1].texture.y, first.texture.y)
    gone = see(camera)
    images[1].update(gone)
    farther = first.codes > gone.codes
    np.testing.assert_array_equal(images[1].texture.y[farther], gone.texture.y[farther])
    np.testing.assert_array_equal(images[1].texture.y[~farther], first.texture.y[~farther])


def test_noise_moves_no_tolerance():
    cameras = camera_row(2, (W, H))
    rng = np.random.default_rng(1)

    def noisy(index):
        views = frame(index, cameras).views
        codes = [view.codes + rng.integers(-60, 60, view.codes.shape) for view in views]
        pairs = zip(views, codes, strict=True)
        return Frame(index, tuple(View(view.camera, view.texture, c.astype(np.uint16)) for view, c in pairs))

    models = []
    for settings in (PAPER, Settings.preset("balanced")):
        first = noisy(0)
        model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
        model.update(first)
        model.update(noisy(1))
        models.append(model)
    assert models[0].tolerances.noise == 0.0 < models[1].tolerances.noise


def test_it_shows_the_farthest_surface_of_the_model():
    """Beside a post, which hides a strip of the near wall from the one view that has depth now."""
    cameras = camera_row(5, (192, 128), 0.6)
    eye = Camera("eye", Perspective.from_fov(80, 60, 0.8), Pose((0.0, 0.25, 0.0)), DepthCoding(0.5, 20.0))
    first = Frame(0, tuple(wall_with_window(camera) for camera in cameras))
    now = [View(view.camera, view.texture, np.zeros_like(view.codes)) for view in first.views]
    now[2] = wall_with_window(cameras[2], post=True)
    wall, far = wall_with_window(eye, post=True).texture.y == NEAR_Y, {}
    for backdrop in ("farthest", "standing"):
        settings = dataclasses.replace(PAPER, n_render=1, backdrop=backdrop, fill="none")
        engine = Engine(cameras, settings)
        engine.update(first)
        engine.update(Frame(1, tuple(now)), {"me": eye})
        picture = engine.render_camera(eye, "me")
        only = wall & picture.holes(warped=True) & ~picture.holes()
        assert only.sum() > 100
        far[backdrop] = np.mean(1.0 / picture.disparity[only] > 0.5 * (NEAR_X + FAR_X))
    assert PAPER.backdrop == "farthest"
    assert far["farthest"] > 0.4
    assert far["standing"] < 0.1


def test_holding_a_frame_rate_is_refused():
    with pytest.raises(ValueError, match=r"quality: 'paper': expected one of fast, balanced, best where a frame rate"):
        make_ladder("paper")
    settings = ServerSettings(quality="paper", target_fps=30.0)
    with pytest.raises(ValueError, match="quality: 'paper'"):
        settings.governor()
    assert ServerSettings(quality="paper").engine() == PAPER
    assert "paper" in PRESETS
