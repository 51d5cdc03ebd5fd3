"""Triangulation against its slow twin: error bound, tiling, depth edges, masks, rims, winding, points."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.geometry.triangulation import TriangulationOptions, depth_cuts, triangulate
from farside.engine.geometry.triangulator import Triangulator
from farside.engine.kernels.geometry import changes
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle.triangulation import Quads, barycentric, covered

POSE = Pose.from_euler((1.0, -2.0, 0.5), 0.4, -0.2, 0.1)
ORIGIN = (0.9, -1.8, 0.4)
WRAPPING, PARTIAL, FLAT = "wrapping", "partial", "perspective"


def make_camera(kind, w, h, *, has_invalid):
    if kind == FLAT:
        projection = Perspective(w, h, 20.0, 21.0, w / 2, h / 2)
    else:
        half = math.pi if kind == WRAPPING else 1.0
        projection = Equirectangular(w, h, (-half, half), (-1.2, 1.2))
    return Camera("v0", projection, POSE, DepthCoding(0.5, 20.0, 16, has_invalid))


def make_codes(rng, w, h, *, noise, steps, invalid, wraps=False):
    """A bent plane with steps, noise and missing pixels; only missing pixels have code 0."""
    v, u = np.mgrid[0:h, 0:w].astype(float)
    if wraps:
        u = 8 * np.sin(2 * np.pi * u / w)
    codes = 20_000 + rng.uniform(-60, 60) * u + rng.uniform(-60, 60) * v + rng.uniform(-2, 2) * (u - v) ** 2
    for _ in range(steps):
        x, y = rng.integers(0, w), rng.integers(0, h)
        codes[y : y + rng.integers(1, h + 1), x : x + rng.integers(1, w + 1)] += rng.uniform(-8000, 8000)
    codes += noise * rng.standard_normal((h, w))
    codes = np.clip(np.rint(codes), 1, 65535).astype(np.uint16)
    codes[rng.random((h, w)) < invalid] = 0
    return codes


@st.composite
def maps(draw, *, cuts=True):
    """(camera, codes, edge in codes, rng) of small views in both projections."""
    kind = draw(st.sampled_from([FLAT, PARTIAL, WRAPPING]))
    w, h = draw(st.integers(2, 40)), draw(st.integers(2, 21))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    noise = draw(st.sampled_from([0.0, 3.0, 400.0]))
    invalid = draw(st.sampled_from([0.0, 0.02, 0.3])) if cuts else 0.0
    camera = make_camera(kind, w, h, has_invalid=invalid > 0)
    steps = draw(st.integers(0, 3))
    codes = make_codes(rng, w, h, noise=noise, steps=steps, invalid=invalid, wraps=kind == WRAPPING)
    return camera, codes, (600.0 if cuts else 1e9), rng


blocks = st.sampled_from([2, 4, 8, 16, 32])
quick = settings(max_examples=20, deadline=None, derandomize=True)


def options(camera, edge, tolerance=0.0, block=32, **more):
    step = camera.depth.step
    return TriangulationOptions(tolerance * step, edge * step, block, **more)


def quads(camera, codes, edge, keep=None):
    return Quads(codes, edge, camera.depth.has_invalid, wraps(camera), keep)


def wraps(camera):
    return getattr(camera.projection, "wraps", False)


def corners(mesh):
    """Triangles [m, 3, 2] in pixels from the first pixel's centre."""
    return (mesh.uv.astype(float) - 0.5)[mesh.triangles]


def areas(mesh):
    """Signed areas [m] on the picture, u right and v down."""
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def coverage(mesh, q):
    return covered(corners(mesh), q.rows, q.columns)


def pixels_under(triangle, width):
    """Pixels (x, y) under a triangle, its sides included, and their barycentric coordinates."""
    low, high = triangle.min(0).astype(int), triangle.max(0).astype(int)
    points = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True))), -1)
    weights = barycentric(triangle, points)
    inside = (weights > -1e-9).all(-1)
    return points[inside] % (width, 1 << 20), weights[inside]


@quick
@given(maps(), blocks, st.sampled_from([1.0, 7.0, 60.0]))
def test_no_pixel_is_farther_than_the_tolerance_from_its_triangle(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block))
    for triangle in corners(mesh)[np.abs(areas(mesh)) > 0.5]:
        at, weights = pixels_under(triangle, camera.width)
        vertices = triangle.astype(int) % (camera.width, 1 << 20)
        plane = weights @ codes[vertices[:, 1], vertices[:, 0]].astype(float)
        assert np.abs(codes[at[:, 1], at[:, 0]] - plane).max() <= tolerance + 1e-6


@quick
@given(maps(), blocks, st.sampled_from([0.0, 7.0, 60.0]))
def test_merging_changes_nothing_of_what_is_covered(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block))
    q = quads(camera, codes, edge)
    np.testing.assert_array_equal(coverage(mesh, q), q.surface())
    assert (areas(mesh) < 0).all()  # all have the same winding


@quick
@given(maps(cuts=False), blocks, st.sampled_from([0.0, 7.0, 60.0]))
def test_without_depth_edges_triangles_tile_the_picture(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block))
    assert -areas(mesh).sum() == (camera.width - (not wraps(camera))) * (camera.height - 1)
    assert (coverage(mesh, quads(camera, codes, edge)) == 1).all()


def inner_points(mesh):
    """Pixel centres strictly inside a triangle's side."""
    for triangle in corners(mesh).astype(int):
        for k in range(3):
            step = triangle[k] - triangle[k - 1]
            n = int(np.gcd(*np.abs(step)))
            for i in range(1, n):
                yield tuple(triangle[k - 1] + step // n * i)


@quick
@given(maps(), blocks, st.sampled_from([1.0, 60.0, 1e5]))
def test_no_vertex_lies_inside_a_side(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block))
    period = camera.width if wraps(camera) and camera.width % block == 0 else 1 << 20
    vertices = {(x % period, y) for x, y in corners(mesh).reshape(-1, 2).astype(int)}
    assert not any((x % period, y) in vertices for x, y in inner_points(mesh))


def test_a_plane_becomes_few_triangles():
    camera = make_camera(FLAT, 65, 65, has_invalid=False)
    v, u = np.mgrid[0:65, 0:65]
    mesh = triangulate(camera, (1000 + 30 * u + 20 * v).astype(np.uint16), options(camera, 600, 1.0, 32))
    assert len(mesh.triangles) == 8  # two for each of 2 x 2 blocks


@quick
@given(maps(), blocks)
def test_tolerance_zero_gives_the_plain_triangulation(case, block):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, 0.0, block))
    found = [frozenset(map(tuple, triangle)) for triangle in corners(mesh).astype(int).tolist()]
    assert len(found) == len(set(found))
    assert set(found) == set(quads(camera, codes, edge).triangles())


@quick
@given(maps(), blocks, st.sampled_from([1.0, 60.0]))
def test_no_merged_triangle_spans_a_depth_edge_or_a_missing_pixel(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block))
    q = quads(camera, codes, edge)
    for triangle in corners(mesh):
        at = {tuple(p) for p in pixels_under(triangle, camera.width)[0].tolist()}
        assert all(q.valid[y, x] for x, y in at)
        if len(at) > 3:
            for x, y in at:
                right, below = ((x + 1) % camera.width, y), (x, y + 1)
                assert not (right in at and (x + 1 < camera.width or wraps(camera)) and q.right[y, x])
                assert not (below in at and q.down[y, x])


@quick
@given(maps(), blocks, st.sampled_from([0.0, 7.0, 1e5]), st.sampled_from([0.02, 0.5, 0.98]))
def test_kept_pixels_alone_are_triangulated(case, block, tolerance, share):
    camera, codes, edge, rng = case
    keep = (rng.random(codes.shape) < share).astype(np.uint8)
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block), keep=keep)
    q = quads(camera, codes, edge, keep)
    np.testing.assert_array_equal(coverage(mesh, q), q.surface())
    for triangle in corners(mesh):
        at, _ = pixels_under(triangle, camera.width)
        kept = keep[at[:, 1], at[:, 0]]
        assert kept.any()
        assert len(at) == 3 or kept.all()


@pytest.mark.parametrize("kind", [FLAT, WRAPPING])
@pytest.mark.parametrize("w", [193, 200, 224])
def test_of_a_large_view_of_which_little_is_kept_only_that_is_triangulated(kind, w):
    rng = np.random.default_rng(w)
    camera = make_camera(kind, w, 130, has_invalid=True)
    codes = make_codes(rng, w, 130, noise=3.0, steps=3, invalid=0.01, wraps=kind == WRAPPING)
    keep = np.zeros_like(codes, np.uint8)
    for y, x in [(0, 0), (40, w - 1), (64, 63), (95, 32), (129, 96)]:
        keep[max(y - 3, 0) : y + 4, max(x - 4, 0) : x + 3] = 1
    for extend in (False, True):
        bounds = options(camera, 600.0, 7.0, extend_edges=extend)
        mesh = triangulate(camera, codes, bounds, keep=keep)
        whole = triangulate(camera, codes, bounds, keep=keep, cuts=depth_cuts(camera, codes, bounds, keep))
        q = quads(camera, codes, 600.0, keep)
        np.testing.assert_array_equal(coverage(mesh, q), coverage(whole, q))
        assert coverage(mesh, q).any()
        assert len(mesh.triangles) <= len(whole.triangles)


@quick
@given(maps(), blocks, st.sampled_from([0.0, 7.0]))
def test_rims_are_the_quarters_of_cut_quads(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block), rims=True)
    q = quads(camera, codes, edge)
    np.testing.assert_array_equal(coverage(mesh, q), q.rims())
    assert (areas(mesh) < 0).all()


@quick
@given(maps(), blocks, st.sampled_from([0.0, 7.0]))
def test_surface_and_rims_together_leave_nothing_out(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block, extend_edges=True))
    q = quads(camera, codes, edge)
    found, cut = coverage(mesh, q), q.cut().astype(bool)
    np.testing.assert_array_equal(found[~cut], q.surface()[~cut])
    assert (found[cut] >= q.rims()[cut]).all()
    if tolerance == 0.0:  # no merged triangle reaches half way into a cut quad
        np.testing.assert_array_equal(found[cut], q.rims()[cut])
    assert (areas(mesh) < 0).all()


@quick
@given(maps(), blocks, st.sampled_from([0.0, 7.0]))
def test_points_are_the_unprojected_pixels(case, block, tolerance):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, tolerance, block), origin=ORIGIN)
    at = (mesh.uv - 0.5).astype(int) % (camera.width, 1 << 20)
    depth = camera.depth.depth(codes[at[:, 1], at[:, 0]])
    expected = camera.unproject(mesh.uv, depth) - ORIGIN
    np.testing.assert_allclose(mesh.points, expected, rtol=0, atol=1e-5 * (1 + depth.max(initial=0)))


@quick
@given(maps(), blocks)
def test_rims_lie_on_their_pixel_or_half_way_to_a_neighbour(case, block):
    camera, codes, edge, _ = case
    mesh = triangulate(camera, codes, options(camera, edge, 7.0, block), rims=True)
    q = quads(camera, codes, edge)
    uv, depth = camera.project(mesh.points.astype(float))
    off = (uv - mesh.uv + camera.width / 2) % camera.width - camera.width / 2 if wraps(camera) else uv - mesh.uv
    np.testing.assert_allclose(off, 0, atol=2e-3)
    found = (1 / depth - camera.depth.offset) / camera.depth.step
    for quarter in range(0, len(mesh.uv), 4):  # a pixel's centre, followed by the quarter's other corners
        x, y = (mesh.uv[quarter] - 0.5).astype(int)
        dx, dy = np.sign(mesh.uv[quarter + 3] - mesh.uv[quarter]).astype(int)
        own = int(codes[y, x % camera.width])
        beside = own if q.between((x, y), (x + dx, y)) else int(codes[y, (x + dx) % camera.width])
        under = own if q.between((x, y), (x, y + dy)) else int(codes[y + dy, x % camera.width])
        corner = under if q.between((x, y), (x + dx, y)) else beside
        expected = [own, (own + beside) / 2, (own + under) / 2, (own + corner) / 2]
        np.testing.assert_allclose(found[quarter : quarter + 4], expected, atol=0.05)


@pytest.mark.parametrize(("w", "h"), [(1, 1), (1, 9), (9, 1)])
def test_a_single_row_or_column_has_no_triangles(w, h):
    camera = make_camera(FLAT, w, h, has_invalid=True)
    for rims in (False, True):
        mesh = triangulate(camera, np.full((h, w), 100, np.uint16), options(camera, 600, 5.0), rims=rims)
        assert len(mesh.triangles) == len(mesh.points) == len(mesh.uv) == 0


@pytest.mark.parametrize(
    ("field", "arguments"),
    [
        ("codes", {"codes": np.zeros((7, 9), np.uint16)}),
        ("codes", {"codes": np.zeros((8, 9), np.int64)}),
        ("codes", {"codes": np.zeros((8, 18), np.uint16)[:, ::2]}),
        ("codes", {"codes": np.zeros((7, 9), np.uint16), "cuts": np.zeros((8, 9), np.uint8)}),
        ("keep", {"keep": np.zeros((8, 8), np.uint8)}),
        ("keep", {"keep": np.zeros((9, 8), np.uint8).T}),
        ("cuts", {"cuts": np.zeros((8, 8), np.uint8)}),
        ("cuts", {"cuts": np.zeros((8, 12), np.uint8)[:, :9]}),
    ],
)
def test_bad_arrays_are_named(field, arguments):
    camera = make_camera(FLAT, 9, 8, has_invalid=True)
    codes = arguments.pop("codes", np.zeros((8, 9), np.uint16))
    with pytest.raises(ValueError, match=f"^{field}: .*: expected "):
        triangulate(camera, codes, options(camera, 600, 5.0), **arguments)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("tolerance", -1.0), ("tolerance", math.nan), ("edge", -0.1), ("edge", math.nan),
        ("max_block", 0), ("max_block", 6), ("max_block", 64),
    ],
)
def test_bad_options_are_named(field, value):
    good = {"tolerance": 0.1, "edge": 0.2, "max_block": 8}
    with pytest.raises(ValueError, match=f"^{field}: .*: expected "):
        TriangulationOptions(**good | {field: value})


def changed_somewhere(rng, codes):
    """The codes with some of them changed: a rectangle, a few pixels, or nothing."""
    codes, (h, w) = codes.copy(), codes.shape
    for _ in range(rng.integers(0, 3)):
        y, x = rng.integers(0, h), rng.integers(0, w)
        part = codes[y : y + rng.integers(1, 12), x : x + rng.integers(1, 12)]
        part[:] = rng.integers(1, 65536) if rng.random() < 0.5 else np.maximum(part, 21) - rng.integers(0, 20)
    return codes


def assert_same(mesh, fresh):
    for name in ("points", "triangles", "starts", "spheres"):
        np.testing.assert_array_equal(getattr(mesh, name), getattr(fresh, name))
    assert mesh.uv.shape == (0, 2)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    st.sampled_from([FLAT, PARTIAL, WRAPPING]),
    st.sampled_from([(33, 34), (100, 70), (96, 65), (130, 40), (65, 161), (97, 129)]),
    blocks,
    st.sampled_from([0.0, 3.0, 60.0]),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_a_sequence_is_triangulated_as_its_frames_are(kind, size, block, tolerance, extend, seed):
    rng = np.random.default_rng(seed)
    camera = make_camera(kind, *size, has_invalid=bool(seed % 2))
    codes = make_codes(rng, *size, noise=seed % 3, steps=2, invalid=0.01 * (seed % 2), wraps=kind == WRAPPING)
    triangulator = Triangulator()
    chosen = options(camera, 600.0, tolerance, block, extend_edges=extend)
    handed_out = []
    for frame in range(5):
        if frame == 3:  # the camera has moved
            camera = dataclasses.replace(camera, pose=Pose.from_euler((0.0, 1.0, 0.5), 0.1, 0.0, 0.0))
        mesh, flags = triangulator.triangulate(camera, codes, chosen, ORIGIN)
        fresh = triangulate(camera, codes, chosen, origin=ORIGIN)
        assert_same(mesh, fresh)
        np.testing.assert_array_equal(flags, depth_cuts(camera, codes, chosen))
        if frame != 1:  # rims are not always asked for
            assert_same(triangulator.rims(flags), triangulate(camera, codes, chosen, origin=ORIGIN, rims=True))
        if handed_out:
            assert (triangulator.rims(handed_out[-1][2]) is None) == (handed_out[-1][2] is not flags)
        handed_out.append((mesh, fresh, flags, flags.copy()))
        codes = changed_somewhere(rng, codes)
    for mesh, fresh, flags, then in handed_out:  # they have not changed since
        np.testing.assert_array_equal(mesh.points, fresh.points)
        np.testing.assert_array_equal(mesh.triangles, fresh.triangles)
        np.testing.assert_array_equal(flags, then)


def test_an_unchanged_frame_is_not_looked_at_again(monkeypatch):
    camera = make_camera(WRAPPING, 128, 65, has_invalid=False)
    codes = make_codes(np.random.default_rng(1), 128, 65, noise=1.0, steps=1, invalid=0.0, wraps=True)
    triangulator, chosen = Triangulator(), options(camera, 600.0, 7.0)
    first, flags = triangulator.triangulate(camera, codes, chosen)
    changed = []
    remade = changes.remade_blocks
    monkeypatch.setattr(changes, "remade_blocks", lambda *args: (remade(*args), changed.append(args[-1].copy())))
    again, same_flags = triangulator.triangulate(camera, codes.copy(), chosen)
    assert again is first
    assert same_flags is flags
    codes[40, 3] += 1  # too far from the seam to count beyond it
    codes[20, 80] += 1
    triangulator.triangulate(camera, codes, chosen)
    assert [blocks.tolist() for blocks in changed] == [[[0, 0, 1, 0], [1, 0, 0, 0]]]
