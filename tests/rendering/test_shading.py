"""Shading: the reference's own colours, analytic colours of a plane, other depths and edges that do not bleed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture, View

ORIGIN = np.zeros(3)
CODING = DepthCoding(0.5, 20.0, 16, has_invalid=True)
FLAT = Perspective.from_fov(64, 48, 1.2)
SPHERE = Equirectangular(64, 32, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))
OPTIONS = TriangulationOptions(0.0, 0.1)


def camera_at(y=0.0, projection=FLAT, name="v"):
    return Camera(name, projection, Pose((0.0, y, 0.0)), CODING)


def rays(camera):
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    return camera.unproject(np.stack([u, v], -1), np.ones_like(u)) - camera.pose.position


def prepared(camera, depth, luma, options=OPTIONS):
    """A view with the given depth and luma; Cb is an eighth of the luma of its first pixel, and Cr that plus 9."""
    luma = np.broadcast_to(np.rint(luma), (camera.height, camera.width)).astype(np.uint16)
    chroma = np.ascontiguousarray(luma[::2, ::2] // 8)
    codes = camera.depth.codes(np.broadcast_to(np.asarray(depth, float), luma.shape))
    return PreparedView(View(camera, Texture(luma.copy(), chroma, chroma + np.uint16(9)), codes), options, ORIGIN)


def shaded(camera, views, *, blend=1, backdrops=0, cubic=False):
    """A canvas with all views drawn and shaded; the last `backdrops` of them are backdrops."""
    canvas, target = Canvas(camera.width, camera.height), Target(camera, ORIGIN)
    canvas.clear()
    canvas.grey()
    for number, view in enumerate(views):
        canvas.draw(view.mesh(), target, number, 0.01, 1e-3)
    n_views = len(views) - backdrops
    table = ViewTable(views, drawn=n_views)
    canvas.shade(target, table, n_views, blend, cubic=cubic)
    return canvas


def wall(camera, luma, distance=4.0):
    """A wall across the x axis whose luma is a function of its points' y and z."""
    start, along = np.array(camera.pose.position), rays(camera)
    depth = (distance - start[0]) / along[..., 0]
    at = start + depth[..., None] * along
    return prepared(camera, depth, luma(at[..., 1], at[..., 2]))


@pytest.mark.parametrize("projection", [FLAT, SPHERE], ids=["perspective", "sphere"])
def test_a_reference_camera_gets_its_own_luma_back(projection):
    rng = np.random.default_rng(0)
    camera = camera_at(projection=projection)
    depth = 3.0 + 0.3 * np.sin(rays(camera)[..., 1])
    luma = rng.integers(64, 940, depth.shape)
    canvas = shaded(camera, [prepared(camera, depth, luma)])
    drawn = canvas.disparity > 0
    assert drawn[1:-1, 1:-1].all()
    assert np.abs(canvas.planes[0] - luma)[drawn].max() < 0.5
    np.testing.assert_array_equal(canvas.texture().y[drawn], luma[drawn])


def pattern(y, z):
    return 500 + 60 * y + 80 * z


@pytest.mark.parametrize("blend", [1, 2, 3])
def test_a_plane_has_its_analytic_colour_from_any_place(blend):
    views = [wall(camera_at(y, name=f"v{k}"), pattern) for k, y in enumerate((-0.4, 0.0, 0.5))]
    for projection in (FLAT, Equirectangular(50, 40, (-0.4, 0.4), (-0.3, 0.3))):
        camera = camera_at(0.2, projection)
        canvas = shaded(camera, views, blend=blend)
        along = rays(camera)
        at = np.array(camera.pose.position) + along * (4.0 / along[..., :1])
        expected = pattern(at[..., 1], at[..., 2])
        inside = canvas.disparity > 0
        assert inside.mean() > 0.9
        # A bilinear fetch of a linear pattern is exact but for the rounding of codes, and for half a texel at a border.
        off = np.abs(canvas.planes[0] - expected)[inside]
        assert np.percentile(off, 95) < 0.8
        assert off.max() < 0.5 * 80 * 4.0 / FLAT.fx + 0.8


def test_chroma_is_that_of_the_texels():
    camera = camera_at()
    canvas = shaded(camera, [prepared(camera, 3.0, 800)])
    inner = np.s_[1:-1, 1:-1]
    np.testing.assert_allclose(canvas.planes[1][inner], 100, atol=1e-3)
    np.testing.assert_allclose(canvas.planes[2][inner], 109, atol=1e-3)


def test_a_view_that_sees_another_depth_contributes_nothing():
    camera = camera_at()
    for other, weight in ((6.0, 0.0), (2.0, None), (3.0, 1.0)):
        views = [prepared(camera_at(0.01), 3.0, 300), prepared(camera_at(-0.01), other, 900)]
        luma = shaded(camera, views, blend=5).planes[0][10:-10, 10:-10]
        if weight == 0.0:
            np.testing.assert_allclose(luma, 300, atol=1e-2)
        elif weight is None:
            np.testing.assert_allclose(luma, 900, atol=1e-2)  # it hides the other view's surface
        else:
            np.testing.assert_allclose(luma, 600, atol=5)  # the mean of both, at equal angles


def test_no_more_views_than_asked_for_contribute():
    camera = camera_at()
    views = [prepared(camera_at(0.0), 3.0, luma) for luma in (300, 500, 1000)]
    for blend, expected in ((1, 300), (2, 400), (3, 600), (9, 600)):
        luma = shaded(camera, views, blend=blend).planes[0][10:-10, 10:-10]
        np.testing.assert_allclose(luma, expected, atol=0.1)


@pytest.mark.parametrize("y", [-0.13, 0.0, 0.07, 0.2])
def test_colours_do_not_bleed_over_a_depth_edge(y):
    """In every view near surfaces are bright and far ones dark: no colour between them may appear."""
    column = np.arange(64)
    near = (column > 20) & (column < 40)
    depth, luma = np.where(near, 1.5, 5.0), np.where(near, 900, 100)
    canvas = shaded(camera_at(y), [prepared(camera_at(), depth, luma)], blend=3)
    drawn = canvas.disparity > 0
    expected = np.where(canvas.disparity > 1 / 3, 900, 100)
    assert len(np.unique(expected[drawn])) == 2
    np.testing.assert_allclose(canvas.planes[0][drawn], expected[drawn], atol=0.1)


def test_a_wrapping_picture_is_fetched_across_its_seam():
    source = camera_at(projection=SPHERE)
    azimuth = math.pi - (np.arange(64) + 0.5) / 64 * 2 * math.pi
    view = prepared(source, 3.0, 500 + 300 * np.cos(azimuth)[None, :])
    back = Pose.from_euler((0.0, 0.0, 0.0), math.pi, 0.0, 0.0)
    camera = Camera("back", Perspective.from_fov(65, 9, 0.5), back, CODING)
    canvas = shaded(camera, [view])
    assert (canvas.disparity > 0).all()
    along = rays(camera)
    expected = 500 + 300 * np.cos(np.arctan2(along[..., 1], along[..., 0]))
    assert np.abs(canvas.planes[0] - expected).max() < 3  # a bilinear fetch of a cosine


def test_backdrops_colour_only_what_they_won():
    camera = camera_at()
    live = prepared(camera, np.where(np.arange(64) < 32, 3.0, np.nan), 300)
    canvas = shaded(camera, [live, prepared(camera, 3.0, 900)], blend=5, backdrops=1)
    won = canvas.winner == 1
    assert won[5, 40]
    assert not won[5, 20]
    drawn = canvas.disparity > 0
    np.testing.assert_allclose(canvas.planes[0][drawn & won], 900, atol=0.1)
    np.testing.assert_allclose(canvas.planes[0][drawn & ~won], 300, atol=0.1)


def test_what_was_not_drawn_is_left_alone():
    camera = camera_at()
    canvas = shaded(camera, [prepared(camera, np.nan, 300)])
    assert canvas.disparity.max() == 0
    assert (canvas.planes[0] == 512).all()
    assert (canvas.texture().y == 512).all()


@pytest.mark.parametrize("size", [(33, 31), (31, 25), (35, 24), (64, 35)])
def test_pictures_of_odd_size_have_the_views_chroma_to_their_last_pixel(size):
    """Beyond the last column and row there are no directions, and a view's colours have no place there."""
    rng = np.random.default_rng(3)
    camera = camera_at()
    chroma = np.full((24, 32), 700, np.uint16)
    luma = rng.integers(64, 940, (48, 64)).astype(np.uint16)
    view = View(camera, Texture(luma, chroma, chroma), camera.depth.codes(np.full((48, 64), 4.0)))
    target = dataclasses.replace(camera, projection=Perspective.from_fov(*size, 0.8))
    canvas = shaded(target, [PreparedView(view, OPTIONS, ORIGIN)], cubic=True)
    assert (canvas.disparity > 0).all()
    for plane in canvas.planes[1:]:
        np.testing.assert_allclose(plane, 700, rtol=1e-4)


@pytest.mark.parametrize("size", [(5, 3), (1, 1), (7, 2)])
def test_odd_pictures_pack_into_half_chroma(size):
    w, h = size
    target = dataclasses.replace(camera_at(), projection=Perspective(w, h, 50.0, 50.0, w / 2, h / 2))
    texture = shaded(target, [prepared(camera_at(), 3.0, 800)]).texture()
    assert texture.y.shape == (h, w)
    assert texture.cb.shape == texture.cr.shape == ((h + 1) // 2, (w + 1) // 2)
    assert (texture.y == 800).all()
    assert (texture.cb == 100).all()
    assert (texture.cr == 109).all()


def keys(plane, u, v):
    """Cubic convolution (Keys 1981, a = -1/2) of a plane at pixel coordinates, sample by sample."""

    def kernel(s):
        s = abs(s)
        return 1.5 * s**3 - 2.5 * s**2 + 1 if s <= 1 else -0.5 * s**3 + 2.5 * s**2 - 4 * s + 2 if s < 2 else 0.0

    x, y = u - 0.5, v - 0.5
    j, i = math.floor(y), math.floor(x)
    return sum(
        kernel(y - b) * kernel(x - a) * float(plane[b, a]) for b in range(j - 1, j + 3) for a in range(i - 1, i + 3)
    )


def test_cubic_interpolation_is_keys():
    rng = np.random.default_rng(3)
    camera, depth = camera_at(), 4.0
    luma = rng.integers(64, 940, (camera.height, camera.width))
    view = prepared(camera, depth, luma)
    target = camera_at(0.3 * depth / FLAT.fx)  # 0.3 pixels to the left: its pixel x shows the view's x - 0.3
    canvas = shaded(target, [view], cubic=True)
    for y, x in ((10, 20), (11, 31), (30, 40)):
        shift = (target.pose.position[1] - camera.pose.position[1]) * FLAT.fx / depth
        u, v = x + 0.5 - shift, y + 0.5
        assert abs(canvas.planes[0][y, x] - np.clip(keys(luma, u, v), 0, 1023)) < 0.5
        chroma, middle = view.view.texture.cb, (x // 2 * 2 + 1 - shift, y // 2 * 2 + 1)  # of its block of pixels
        assert abs(canvas.planes[1][y, x] - keys(chroma, 0.5 * middle[0], 0.5 * middle[1])) < 0.5


def test_cubic_interpolation_stays_within_the_codes():
    luma = np.where(np.arange(FLAT.width) % 8 < 4, 0, 1023) * np.ones((FLAT.height, 1))
    canvas = shaded(camera_at(0.02), [prepared(camera_at(), 4.0, luma)], cubic=True)
    assert canvas.planes[0].min() == 0
    assert canvas.planes[0].max() == 1023
    assert canvas.texture().y.max() == 1023  # did not wrap


def test_mixed_texels_are_left_to_views_that_have_clean_ones():
    """A wall behind a post whose outline pixels mix post and wall; another view sees only the wall there."""
    wall_luma, post_luma, mixed = 600, 100, 350
    depth = np.full((FLAT.height, FLAT.width), 4.0)
    depth[:, 28:36] = 2.0
    luma = np.where(depth < 3, post_luma, wall_luma)
    luma[:, [27, 28, 35, 36]] = mixed
    first, second = prepared(camera_at(), depth, luma), prepared(camera_at(0.5, name="second"), 4.0, wall_luma)
    canvas = shaded(camera_at(0.01), [first, second], blend=2)
    beside = canvas.planes[0][:, 38:42]  # the wall next to the post
    assert np.abs(beside - wall_luma).max() < 0.1 * (wall_luma - mixed)
    # A single view keeps its own colours.
    alone = shaded(camera_at(), [first], blend=2).planes[0]
    np.testing.assert_allclose(alone[5:-5, [27, 36]], mixed, atol=1)


def surrounded(plane, value):
    """The same plane between rows that hold a value."""
    room = np.full((plane.shape[0] + 8, plane.shape[1]), value, plane.dtype)
    room[4:-4] = plane
    return room[4:-4]


def test_blocks_at_a_views_upper_border_read_nothing_above_it():
    """A block of pixels may be rough a few rows inside a view, while its middle is too near the border for a cubic."""
    camera = camera_at()
    luma = np.full((camera.height, camera.width), 500)
    luma[3:5, ::2] = 900  # between smooth rows
    view = prepared(camera, 4.0, luma).view
    planes = view.texture.y, view.texture.cb, view.texture.cr
    for rows_off in np.linspace(-1.0, 1.0, 21):
        projection = Perspective(64, 48, 0.6 * FLAT.fx, 0.6 * FLAT.fy, FLAT.cx, 0.6 * FLAT.cy + 10.0 + rows_off)
        target, chroma = camera_at(projection=projection), []
        for beyond in (0, 60000):
            texture = Texture(*(surrounded(plane, beyond) for plane in planes))
            other = PreparedView(dataclasses.replace(view, texture=texture), OPTIONS, ORIGIN)
            chroma.append(shaded(target, [other], cubic=True).planes[1])
        np.testing.assert_array_equal(*chroma)


@pytest.mark.parametrize("cubic", [False, True])
@pytest.mark.parametrize("blend", [1, 3])
@pytest.mark.parametrize("size", [(1, 1), (1, 24), (2, 23), (3, 7), (32, 1), (15, 3), (17, 2)])
def test_pictures_narrower_than_what_is_shaded_together(size, blend, cubic):
    """Of a wall with a slope of luma: cells are of several pixels both ways, vectors of sixteen."""

    def luma(y, z):
        return 500 + 200 * y - 100 * z

    w, h = size
    lens = Perspective(w, h, FLAT.fx, FLAT.fy, 0.5 * w, 0.5 * h)
    camera = camera_at(0.03, lens, "eye")
    canvas = shaded(camera, [wall(camera_at(), luma), wall(camera_at(0.1, name="w"), luma)], blend=blend, cubic=cubic)
    assert (canvas.disparity > 0).all()
    along = rays(camera)
    at = np.array(camera.pose.position) + 4.0 / along[..., :1] * along
    # Half a code is lost where texels were rounded; cubic convolution exaggerates it by at most a quarter.
    np.testing.assert_allclose(canvas.planes[0], luma(at[..., 1], at[..., 2]), atol=0.625 if cubic else 0.501)
    np.testing.assert_allclose(canvas.planes[2] - canvas.planes[1], 9, atol=1e-3)
