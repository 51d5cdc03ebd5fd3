"""Fast paths against slow twins in double precision, over cameras and parameters of all sizes."""

from __future__ import annotations

import math

import numba
import numpy as np
from farside.engine.background.pbs import ProbableBackgroundSurface
from farside.engine.geometry.mesh import Mesh
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.base import view_table
from farside.engine.kernels.base.memory import load, store
from farside.engine.kernels.base.project import project_point, unproject_point
from farside.engine.kernels.base.simd import LANES
from farside.engine.kernels.evaluation.leaks import farthest_distances
from farside.engine.kernels.rendering import fill as fill_kernels
from farside.engine.kernels.rendering.lens import LENS_SIZE, OUTSIDE, aim, make_lens
from farside.engine.kernels.rendering.look import look
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture, View
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from oracle import look as slow_look
from oracle import projection as slow
from oracle import pyramid as slow_pyramid
from oracle.rays import hit_distances, pixel_ray
from oracle.zbuffer import zbuffer

quick = settings(max_examples=40, deadline=None, derandomize=True)
few = settings(max_examples=12, deadline=None, derandomize=True)
ROUNDED = 2.0**-24  # relative rounding error of single precision


def numbers(low, high):
    return st.floats(low, high, allow_nan=False)


@st.composite
def projections(draw, size=4096, spheres=True):
    """Telescopes to almost 180 degrees, sometimes mirrored or off centre; whole and partial spheres."""
    w, h = draw(st.integers(4, size)), draw(st.integers(4, size))
    if spheres and draw(st.booleans()):
        wide, high = draw(numbers(0.01, 2 * math.pi)), draw(numbers(0.01, math.pi))
        left, bottom = draw(numbers(-4, 4)), draw(numbers(-math.pi / 2, math.pi / 2 - high))
        return Equirectangular(w, h, (left, left + wide), (bottom, bottom + high))
    fx, fy = (side * draw(numbers(0.005, 60)) * draw(st.sampled_from([1, -1])) for side in (w, h))
    return Perspective(w, h, fx, fy, w * draw(numbers(-1, 2)), h * draw(numbers(-1, 2)))


angles = numbers(-math.pi, math.pi)
turns = st.builds(lambda a, b, c: Pose.from_euler((0, 0, 0), a, b, c).orientation, angles, angles, angles)
scales = st.sampled_from([1e-3, 1e-1, 1.0, 1e2, 1e5])
shares = numbers(0.0, 1.0)


@quick
@given(projections(), turns, st.tuples(*[numbers(-1e7, 1e7)] * 3), shares, shares, scales, numbers(0.1, 50))
def test_projection_both_ways_is_the_slow_twins(projection, orientation, place, s, t, scale, depth):
    camera = Camera("c", projection, Pose(place, orientation), DepthCoding(0.1, 100))
    u, v, depth = s * projection.width, t * projection.height, scale * depth
    expected = slow.unproject(camera, u, v, depth)
    length = float(np.linalg.norm(expected - place)) + depth
    # World positions are rounded; a kernel's sines are exact to 1e-11, its angles to 4e-8.
    world = 4 * float(np.spacing(max(map(abs, (*place, *expected)))))
    origin = np.asarray(place) + scale * np.array([0.5, -0.2, 1.0])
    packed = camera.packed(origin)
    near = unproject_point(packed, u, v, depth)
    assert np.abs(near + origin - expected).max() <= world + 2e-11 * length
    assert np.abs(camera.unproject([u, v], depth) - expected).max() <= world + 2.0**-50 * length
    finer = max(abs(projection.fx), abs(projection.fy)) if isinstance(projection, Perspective) else max(
        projection.width / np.ptp(projection.hor_range), projection.height / np.ptp(projection.ver_range)
    )  # fmt: skip
    ray = slow.turn(np.array(orientation) * (1, -1, -1, -1), expected - place)
    stretch = (length / max(abs(ray[0]), 1e-300)) ** 2  # of a perspective picture, far from its axis
    if isinstance(projection, Equirectangular):
        stretch = length / max(math.hypot(ray[0], ray[1]), 1e-300)
    for found in (project_point(packed, *near), slow.project(camera, expected)):
        off = 4e-8 + 4e-11 + 4 * world / depth
        pixel = finer * stretch * off + 1e-9 * projection.width
        turn = projection.width * 2 * math.pi / np.ptp(getattr(projection, "hor_range", (0.0, 1.0)))
        du = found[0] - u
        if isinstance(projection, Equirectangular):
            du = math.remainder(du, turn)  # a full turn makes no difference
        assert abs(du) <= min(pixel, turn)
        assert abs(found[1] - v) <= pixel
        assert abs(found[2] - depth) <= 2 * world + 4e-11 * length


@quick
@given(
    st.floats(-6, 6).map(lambda e: 10.0**e), st.one_of(st.just(math.inf), numbers(1.001, 1e6)), st.integers(8, 16),
    st.booleans(), st.integers(0, 65535),
)  # fmt: skip
def test_codes_and_depths_are_the_slow_twins(near, ratio, bits, has_invalid, number):
    coding = DepthCoding(near, near * ratio, bits, has_invalid)
    code = max(number % (coding.max_code + 1), coding.min_code)
    depth = coding.depth(np.array([code], np.uint16))[0]
    expected = slow.depth_of_code(near, near * ratio, bits, code)
    assert abs(depth - expected) <= 8 * 2.0**-52 * expected * (1 + expected / near / coding.max_code)
    every = slow.depth_of_code(near, near * ratio, bits, np.arange(coding.min_code, coding.max_code + 1).astype(float))
    between = 1.0 / (1.0 / expected + 0.3 * coding.step)
    assert coding.codes(np.array([between]))[0] == coding.min_code + np.abs(1.0 / every - 1.0 / between).argmin()


def meshes(seed, count, size, scale):
    """Triangles within a ball of radius 4 around the origin, with both windings, some of them slivers."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-2.5, 2.5, (count, 1, 3))
    corners = middles + size * rng.standard_normal((count, 3, 3)) * np.where(rng.random((count, 1, 1)) < 0.2, 1e-3, 1)
    points = (scale * corners).reshape(-1, 3).astype(np.float32)
    return Mesh(points, np.zeros((3 * count, 2), np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3))


@few
@given(projections(24), turns, st.integers(0, 99), scales, numbers(0.1, 1.5))
def test_farthest_hits_are_the_slow_twins(projection, orientation, seed, scale, size):
    """Compared where the oracle's slightly shifted rays hit the same triangle: elsewhere float32 may miss it."""
    mesh = meshes(seed, 40, size, scale)
    camera = Camera("c", projection, Pose((0.3 * scale, 0.2 * scale, -0.1 * scale), orientation), DepthCoding(0.1, 9))
    pbs = ProbableBackgroundSurface(1)
    pbs.set_static(0, 0, mesh)
    pbs.commit()
    found = np.empty((camera.height, camera.width))
    farthest_distances(pbs.tracer.packed, camera.packed(), found)
    extent = float(np.ptp(pbs.tracer.packed.bounds, axis=0).max())
    for y, x in np.ndindex(found.shape):
        start, along = pixel_ray(camera, x + 0.5, y + 0.5)
        t = hit_distances(start, along, mesh.points, mesh.triangles)
        aside = np.cross(along, along[[1, 2, 0]] * (1, -1, 1) + (0.1, 0.2, 0.3))
        aside *= 1e-5 / np.linalg.norm(aside)
        beside = [
            np.isfinite(hit_distances(start, along + turned, mesh.points, mesh.triangles))
            for turned in (aside, -aside, np.cross(along, aside), -np.cross(along, aside))
        ]
        if any((other != np.isfinite(t)).any() for other in beside) or np.isnan(t).all():
            continue
        expected, k = np.nanmax(t), int(np.nanargmax(t))
        a, b, c = mesh.points[mesh.triangles[k]].astype(float)
        normal = np.cross(b - a, c - a)
        slant = np.linalg.norm(normal) / abs(normal @ along)
        # Rounding of each coordinate of origin, direction and distance, and of Embree's own products.
        assert abs(found[y, x] - expected) <= 16 * ROUNDED * 2 * extent * slant


@few
@given(projections(24), turns, st.integers(0, 99), scales, numbers(0.2, 1.0))
def test_the_z_buffer_is_the_slow_twins(projection, orientation, seed, scale, size):
    """Disparity and coverage, compared where rays a few thousandths of a pixel away hit the same triangle."""
    mesh = meshes(seed, 40, size, scale)
    camera = Camera("c", projection, Pose((0.3 * scale, 0.2 * scale, -0.1 * scale), orientation), DepthCoding(0.1, 9))
    near = 0.02 * scale
    expected = zbuffer(camera, mesh.points, mesh.triangles, near if isinstance(projection, Perspective) else 0.0)
    canvas = Canvas(camera.width, camera.height)
    canvas.draw(mesh, Target(camera, np.zeros(3)), 0, near, 0.0)
    sure = expected.sure_of_triangle
    np.testing.assert_array_equal((canvas.disparity > 0)[sure], (expected.triangle >= 0)[sure])
    same = sure & (expected.triangle >= 0)
    # Corners are rounded relative to the scene's size, which can be much more than the depth; and so are a
    # triangle's two slopes on the screen, each computed from four of them.
    rounding = 8 * ROUNDED * float(np.ptp(mesh.points, axis=0).max()) / near
    np.testing.assert_allclose(canvas.disparity[same], expected.disparity[same], rtol=rounding)


@numba.njit
def look_at(lens, addresses, pixels, out):
    q, dx, dy, dz = load(pixels, 0), load(pixels, LANES), load(pixels, 2 * LANES), load(pixels, 3 * LANES)
    u, v, code, clean, mixed = aim(lens, q, dx, dy, dz, False)
    share, luma, _u, _v, _manner = look(
        lens, addresses, (code > np.float32(OUTSIDE)) & (q > 0.0), u, v, code, clean, mixed, False, False
    )
    store(out, 0, share)
    store(out, LANES, luma)


@quick
@given(
    projections(32), turns, st.integers(0, 9), scales, numbers(0.0, 0.3), numbers(0.01, 0.5), st.integers(8, 16),
    st.booleans(),
)  # fmt: skip
def test_what_a_view_shows_is_the_slow_twins(projection, orientation, seed, scale, away, edge, bits, has_invalid):
    rng = np.random.default_rng(seed)
    coding = DepthCoding(0.5 * scale, 10 * scale, bits, has_invalid)
    camera = Camera("v", projection, Pose((0, 0, 0), orientation), coding)
    h, w = camera.height, camera.width
    depth = scale * (2.0 + rng.random() * np.linspace(0, 1, w) + (np.indices((h, w)).sum(0) > 0.5 * (h + w)))
    codes = np.where(rng.random((h, w)) < 0.05, 0, coding.codes(depth)).astype(np.uint16)
    half = np.full(((h + 1) // 2, (w + 1) // 2), 512, np.uint16)
    view = View(camera, Texture(rng.integers(64, 940, (h, w)).astype(np.uint16), half, half), codes)
    prepared = PreparedView(view, TriangulationOptions(0.0, edge / scale), np.zeros(3))
    table = ViewTable([prepared], drawn=1)
    eye_pose = Pose(tuple(away * scale * rng.uniform(-1, 1, 3)), orientation)
    eye = Camera("eye", projection, eye_pose, coding)
    lens, out = np.empty(LENS_SIZE + LANES, np.float32), np.empty(2 * LANES, np.float32)
    make_lens(table.rows[0], eye.packed(), lens)
    uv = rng.uniform((0, 0), (w, h), (LANES, 2))
    q = 1.0 / (rng.choice(depth.ravel(), LANES) * rng.uniform(0.99, 1.01, LANES))
    q = q.astype(np.float32)
    rays = projection.directions(uv).astype(np.float32)
    pixels = np.concatenate([q, *rays.T]).astype(np.float32)
    look_at(lens.ctypes.data, table.addresses.ctypes.data, pixels.ctypes.data, out.ctypes.data)
    row = table.rows[0]
    for i in range(LANES):
        share, luma, (u, v), margin = slow_look.look(
            view, prepared.cuts, row[view_table.EDGE], row[view_table.TOLERANCE], eye, uv[i], float(q[i])
        )
        # Angles are exact to 3e-7, lengths to single precision, both times the picture's magnification.
        finer = max(abs(projection.fx), abs(projection.fy)) if isinstance(projection, Perspective) else max(
            w / np.ptp(projection.hor_range), h / np.ptp(projection.ver_range)
        )  # fmt: skip
        point = slow.turn(np.array(orientation) * (1, -1, -1, -1), eye.unproject(uv[i], 1.0 / float(q[i])))
        ahead = point[0] if isinstance(projection, Perspective) else math.hypot(point[0], point[1])
        stretch = (np.linalg.norm(point) / max(abs(ahead), 1e-30)) ** 2
        off = (6e-7 + 32 * ROUNDED) * finer * stretch * (1 + away) + 8 * ROUNDED * (abs(u) + abs(v))
        border = min(abs(u), abs(v), abs(w - u), abs(h - v))
        unsure = 2 * off * 65535 + 64 * ROUNDED * coding.max_code * 4
        if not np.isfinite(off) or off > 0.05 or border < 2 * off or margin < unsure or near_texel(u, v, off):
            continue
        assert abs(out[i] - share) <= 4 * off + 8 * ROUNDED
        if share > 0.05:
            assert abs(out[LANES + i] - luma) <= 940 * (8 * off + 16 * ROUNDED) / share


def near_texel(u, v, off):
    """Whether rounding by `off` may select other texels around (u, v)."""
    return any(abs((c - 0.5) - round(c - 0.5)) < 2 * off for c in (u, v))


@quick
@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 999), st.sampled_from([1e-5, 1.0, 1e3]))
def test_filling_weighs_as_the_slow_twin_does(h, w, seed, scale):
    """Two levels of the pyramid, coarser and finer again, at disparities of all magnitudes."""
    rng = np.random.default_rng(seed)
    fine = rng.random((h, w, 5)).astype(np.float32)
    fine[..., 0] *= rng.random((h, w)) < 0.6
    fine[..., 1] = np.where(fine[..., 0] > 0, scale * (0.1 + fine[..., 1]), np.inf)
    fine[..., 2:] = np.where(fine[..., :1] > 0, 64 + 876 * fine[..., 2:], 0)
    assume((fine[..., 0] > 0).any())
    level = np.empty(((h + 1) // 2, (w + 1) // 2, 5), np.float32)
    fill_kernels.next_level(fine, level)
    expected = slow_pyramid.coarser(fine)
    # An eighth power in single precision and sums of four values: 32 roundings, of colours up to 1023.
    np.testing.assert_allclose(level[..., 0], expected[..., 0], rtol=32 * ROUNDED)
    np.testing.assert_array_equal(level[..., 1], expected[..., 1].astype(np.float32))
    np.testing.assert_allclose(level[..., 2:], expected[..., 2:], atol=1023 * 32 * ROUNDED)
    known = level[..., 0] > 0
    level[~known] = (1.0, scale, 512, 512, 512)
    colours = slow_pyramid.refined(level, fine)
    level[..., 0] = 1.0
    fill_kernels.refine_level(level, fine)
    np.testing.assert_allclose(fine[..., 2:], colours, atol=1023 * 64 * ROUNDED)
