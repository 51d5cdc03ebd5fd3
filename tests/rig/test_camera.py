"""Cameras: projection both ways, poses, and the packed form that kernels read."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from farside.engine.kernels.base.project import arc_tangent, cosine_sine, project_point, unproject_point
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose, Projection
from farside.engine.rig.depth import DepthCoding
from farside.engine.support.packed import POSITION_SLICE
from hypothesis import given, settings
from hypothesis import strategies as st

CODING = DepthCoding(0.1, 100.0)
FULL = Equirectangular(64, 32, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))
quick = settings(max_examples=60, deadline=None, derandomize=True)


def numbers(low: float, high: float) -> Any:
    return st.floats(low, high, allow_nan=False)


focals = st.one_of(numbers(20, 4000), numbers(-4000, -20))
sizes, centres = st.integers(1, 4096), numbers(-500, 5000)
perspectives = st.builds(Perspective, sizes, sizes, focals, focals, centres, centres)


@st.composite
def equirectangulars(draw: Any) -> Equirectangular:
    def span(widest: float, low: float, high: float) -> tuple[float, float]:
        width = draw(numbers(0.05, widest))
        start = draw(numbers(low, high - min(width, high - low)))
        return start, start + width

    hor, ver = span(2 * math.pi, -4.0, 4.0), span(math.pi, -math.pi / 2, math.pi / 2)
    return Equirectangular(draw(st.integers(1, 8192)), draw(st.integers(1, 4096)), hor, ver)


projections = st.one_of(perspectives, equirectangulars())
angles = numbers(-7.0, 7.0)
positions = st.tuples(*[numbers(-1e6, 1e6)] * 3)
poses = st.builds(Pose.from_euler, positions, angles, angles, angles)
fractions = numbers(0.02, 0.98)


def axis_matrix(axis: int, angle: float) -> Any:
    """Right-handed rotation about one axis, written out."""
    c, s = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    m = np.eye(3)
    m[i, i], m[i, j], m[j, i], m[j, j] = c, -s, s, c
    return m


@quick
@given(projections, poses, fractions, fractions, numbers(0.2, 50.0))
def test_unproject_inverts_project(
    projection: Projection, pose: Pose, s: float, t: float, depth: float
) -> None:
    camera = Camera("v", projection, Pose(orientation=pose.orientation), CODING)
    uv = np.array([s * projection.width, t * projection.height])
    again, distance = camera.project(camera.unproject(uv, np.float64(depth)))
    np.testing.assert_allclose(again, uv, atol=1e-6)
    np.testing.assert_allclose(distance, depth, rtol=1e-9)


def bound_px(projection: Projection) -> float:
    """The largest error of a kernel's pixel coordinates, whose angles are exact to 4e-8 rad."""
    if isinstance(projection, Perspective):
        return 0.0
    (left, right), (low, high) = projection.hor_range, projection.ver_range
    return 4e-8 * max(projection.width / (right - left), projection.height / (high - low))


@quick
@given(projections, poses, fractions, fractions, numbers(0.2, 50.0))
def test_kernels_agree_with_cameras(
    projection: Projection, pose: Pose, s: float, t: float, depth: float
) -> None:
    camera = Camera("v", projection, pose, CODING)
    origin = np.asarray(pose.position) + np.array([0.5, -0.25, 1.0])  # the kernels' origin
    packed = camera.packed(origin)
    u, v = s * projection.width, t * projection.height
    near = unproject_point(packed, u, v, depth)
    np.testing.assert_allclose(near + origin, camera.unproject([u, v], depth), atol=1e-8)
    ku, kv, kd = project_point(packed, *near)
    np.testing.assert_allclose((ku, kv), (u, v), atol=1e-5 + bound_px(projection))
    np.testing.assert_allclose(kd, depth, rtol=1e-6)


@quick
@given(numbers(-3.0, 3.0), numbers(-3.0, 3.0), numbers(-3.0, 3.0), equirectangulars())
def test_kernel_wraps_the_azimuth_as_the_camera_does(
    x: float, y: float, z: float, projection: Equirectangular
) -> None:
    if math.hypot(x, y) < 0.1:
        return
    (u, v), depth = projection.project([x, y, z])
    ku, kv, kd = project_point(Camera("v", projection, Pose(), CODING).packed(), x, y, z)
    turn = 2 * math.pi / (projection.hor_range[1] - projection.hor_range[0]) * projection.width
    # For points opposite the picture's middle, both ends of the picture are right.
    assert abs(math.remainder(ku - u, turn)) < 1e-6 + bound_px(projection)
    np.testing.assert_allclose(kv, v, atol=1e-6 + bound_px(projection))
    np.testing.assert_allclose(kd, depth, atol=1e-6)


@quick
@given(positions, angles, angles, angles)
def test_euler_angles(position: tuple[float, float, float], yaw: float, pitch: float, roll: float) -> None:
    pose = Pose.from_euler(position, yaw, pitch, roll)
    expected = axis_matrix(2, yaw) @ axis_matrix(1, pitch) @ axis_matrix(0, roll)
    np.testing.assert_allclose(pose.rotation(), expected, atol=1e-12)
    matrix = np.column_stack([expected, position])
    again = Pose.from_matrix(matrix)
    np.testing.assert_allclose(again.rotation(), expected, atol=1e-12)
    assert again.position == pose.position


def test_directions_of_the_angles() -> None:
    ahead = np.array([1.0, 0.0, 0.0])
    left = Pose.from_euler((0, 0, 0), 0.5, 0, 0).rotation() @ ahead
    down = Pose.from_euler((0, 0, 0), 0, 0.5, 0).rotation() @ ahead
    assert left[1] > 0.4
    assert down[2] < -0.4


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_from_matrix_at_half_turns(axis: int) -> None:
    matrix = axis_matrix(axis, math.pi)
    np.testing.assert_allclose(
        Pose.from_matrix(np.column_stack([matrix, np.zeros(3)])).rotation(), matrix, atol=1e-12
    )


def test_perspective_by_hand() -> None:
    p = Perspective(640, 480, 500.0, 400.0, 320.0, 240.0)
    uv, depth = p.project([2.0, 0.5, -0.25])  # ahead, left, below
    np.testing.assert_allclose(uv, [320 - 125, 240 + 50])
    assert depth == 2.0
    turned = Perspective(640, 480, -500.0, -400.0, 320.0, 240.0)
    np.testing.assert_allclose(turned.project([2.0, 0.5, -0.25])[0], [320 + 125, 240 - 50])
    assert np.isnan(p.project([-2.0, 0.5, 0.0])[0]).all()


def test_seam_of_a_full_panorama() -> None:
    assert FULL.wraps
    just_left, just_right = FULL.project([[-1.0, 1e-9, 0.0], [-1.0, -1e-9, 0.0]])[0]
    assert just_left[0] == pytest.approx(0.0, abs=1e-6)
    assert just_right[0] == pytest.approx(64.0, abs=1e-6)
    middle = FULL.project([1.0, 0.0, 0.0])[0]
    np.testing.assert_allclose(middle, [32.0, 16.0], atol=1e-12)
    np.testing.assert_allclose(FULL.directions([0.0, 16.0]), FULL.directions([64.0, 16.0]), atol=1e-12)


def test_azimuth_follows_a_range_beyond_half_a_turn() -> None:
    back = Equirectangular(90, 90, (math.radians(100), math.radians(280)), (-1.0, 1.0))
    assert not back.wraps
    for azimuth in (110, 180, 190, 270):
        point = [math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth)), 0.0]
        assert back.project(point)[0][0] == pytest.approx((280 - azimuth) / 2)


@pytest.mark.parametrize(("v", "z"), [(0.0, 1.0), (32.0, -1.0)])
def test_poles(v: float, z: float) -> None:
    (_, row), distance = FULL.project([0.0, 0.0, 3.0 * z])
    assert row == pytest.approx(v)
    assert distance == 3.0
    for u in (0.0, 17.3, 64.0):
        np.testing.assert_allclose(FULL.directions([u, v]), [0, 0, z], atol=1e-12)
    packed = Camera("v", FULL, Pose(), CODING).packed()
    assert project_point(packed, 0.0, 0.0, 3.0 * z)[1:] == pytest.approx((v, 3.0))


def test_from_tangents_and_field_of_view() -> None:
    p = Perspective.from_tangents(100, 80, 1.5, 0.5, 0.7, 0.9)
    for point, expected in (([1, 1.5, 0.7], (0, 0)), ([1, -0.5, -0.9], (100, 80))):
        np.testing.assert_allclose(p.project(point)[0], expected, atol=1e-9)
    square = Perspective.from_fov(100, 50, math.pi / 2)
    np.testing.assert_allclose(square.project([1.0, 1.0, 0.5])[0], [0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("projection", [Perspective(100, 60, 90.0, 80.0, 40.0, 33.0), FULL])
def test_scaled_sees_the_same(projection: Projection) -> None:
    small = projection.scaled(0.5)
    assert (small.width, small.height) == (projection.width // 2, projection.height // 2)
    point = [1.0, 0.2, -0.1]
    np.testing.assert_allclose(small.project(point)[0] * 2, projection.project(point)[0])


def test_translated_moves_along_own_axes() -> None:
    pose = Pose.from_euler((1.0, 2.0, 3.0), math.pi / 2, 0, 0)  # looks along +y: its left is -x
    np.testing.assert_allclose(pose.translated((0, 0.5, 0)).position, (0.5, 2.0, 3.0), atol=1e-12)


def test_far_from_the_origin_kernels_keep_their_precision() -> None:
    camera = Camera("v", FULL, Pose((1e6, -1e6, 5.0)), CODING)
    packed = camera.packed((1e6, -1e6, 0.0))
    np.testing.assert_array_equal(packed[POSITION_SLICE], (0.0, 0.0, 5.0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Perspective(0, 5, 1, 1, 0, 0), "resolution"),
        (lambda: Perspective(5, 5, 0, 1, 0, 0), "fx: 0"),
        (lambda: Perspective(5, 5, 1, math.nan, 0, 0), "fy: nan"),
        (lambda: Perspective(5, 5, 1, 1, math.inf, 0), "cx: inf"),
        (lambda: Perspective.from_tangents(5, 5, -1, 1, 1, 1), "tangents"),
        (lambda: Perspective.from_fov(5, 5, math.pi), "field of view"),
        (lambda: Equirectangular(5, 5, (1, 1), (0, 1)), "hor_range"),
        (lambda: Equirectangular(5, 5, (0, 7), (0, 1)), "hor_range"),
        (lambda: Equirectangular(5, 5, (0, 1), (-2, 2)), "ver_range"),
        (lambda: Pose((0, 0, math.nan)), "position"),
        (lambda: Pose(orientation=(1, 1, 0, 0)), "orientation"),
        (lambda: Pose(orientation=(math.nan, 0, 0, 0)), "orientation"),
        (lambda: Pose.from_matrix(np.eye(4) * 2), "world_from_camera"),
        (lambda: Pose.from_matrix(np.diag([1.0, 1.0, -1.0, 1.0])), "world_from_camera"),
    ],
)
def test_bad_values_are_named(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@quick
@given(numbers(-40, 40), numbers(1e-6, 1e6))
def test_angles_are_those_of_the_library(angle: float, length: float) -> None:
    np.testing.assert_allclose(cosine_sine(angle), (math.cos(angle), math.sin(angle)), atol=1e-11)
    y, x = length * math.sin(angle), length * math.cos(angle)
    assert arc_tangent(y, x) == pytest.approx(math.atan2(y, x), abs=5e-8)


def test_angles_on_the_axes() -> None:
    for y, x in ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (0.0, 0.0)):
        assert arc_tangent(y, x) == pytest.approx(math.atan2(y, x), abs=5e-8)
