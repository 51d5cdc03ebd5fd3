"""Choice of the views that render a picture."""

from __future__ import annotations

import math

import pytest
from farside.engine.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.depth import DepthCoding
from farside.engine.selection import select_views

CODING = DepthCoding(0.5, 20.0)
DEPTHS = (1.5, 4.0)
FLAT = Perspective.from_fov(64, 48, 1.3)
SPHERE = Equirectangular(64, 32, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))


def camera(x, y, z=0.0, yaw=0.0, projection=FLAT, name="v"):
    return Camera(name, projection, Pose.from_euler((x, y, z), yaw, 0.0, 0.0), CODING)


ROW = [camera(0.0, 0.3 * k, name=f"v{k}") for k in range(7)]


@pytest.mark.parametrize("at", range(7))
def test_the_camera_at_the_targets_pose_comes_first(at):
    assert select_views(ROW[at], ROW, 3, DEPTHS)[0] == at
    assert select_views(ROW[at], ROW[::-1], 3, DEPTHS)[0] == 6 - at


def test_neighbours_on_both_sides_come_before_far_cameras():
    chosen = select_views(camera(0.0, 0.95), ROW, 3, DEPTHS)
    assert chosen[0] == 3
    assert {2, 4} & set(chosen[1:])
    assert 0 not in chosen


def test_cameras_that_see_nothing_of_the_picture_are_left_out():
    away = camera(0.0, 0.0, yaw=math.pi)  # at the target's place, but it looks the other way
    beyond = camera(30.0, 0.0)
    assert select_views(ROW[0], [away, ROW[1], beyond, ROW[2]], 4, DEPTHS) == [1, 3]
    assert select_views(ROW[0], [away], 2, DEPTHS) == []


def test_where_the_pictures_rays_meet_nothing_what_the_cameras_see_counts():
    wide = camera(0.0, 0.5, projection=Perspective.from_fov(64, 48, 3.1))  # all that they see is within three pixels
    chosen = select_views(wide, [camera(0.0, 0.0, yaw=math.pi), *ROW], 3, DEPTHS)
    assert len(chosen) == 3
    assert 0 not in chosen
    assert select_views(ROW[0], [camera(30.0, 0.0)], 2, DEPTHS) == [0]  # far ahead, where no rays were sampled


@pytest.mark.parametrize("count", [1, 2, 5, 7, 20])
def test_the_count_is_kept_and_no_camera_stands_twice(count):
    chosen = select_views(camera(0.1, 0.8), ROW, count, DEPTHS)
    assert len(chosen) == len(set(chosen)) == min(count, len(ROW))
    assert all(0 <= k < len(ROW) for k in chosen)


def test_fewer_views_are_the_first_of_more():
    target = camera(0.2, 0.7, 0.1, yaw=0.2)
    chosen = [select_views(target, ROW, count, DEPTHS) for count in range(1, 8)]
    assert chosen == [chosen[-1][:count] for count in range(1, 8)]
    assert chosen == [select_views(target, ROW, count, DEPTHS) for count in range(1, 8)]


def test_half_of_a_sphere_is_covered_by_the_cameras_that_look_there():
    """Of a ball of cameras that look outwards, those on the side that the viewer looks at are taken."""
    half = Equirectangular(64, 64, (-math.pi / 2, math.pi / 2), (-math.pi / 2, math.pi / 2))
    ring = [
        camera(0.3 * math.cos(a), 0.3 * math.sin(a), yaw=a, projection=half)
        for a in (k * math.pi / 4 for k in range(8))
    ]
    assert set(select_views(camera(0.0, 0.0), ring, 3, DEPTHS)) <= {7, 0, 1}
    everywhere = select_views(camera(0.0, 0.0, projection=SPHERE), ring, 4, DEPTHS)
    assert max(min((a - b) % 8, (b - a) % 8) for a in everywhere for b in everywhere) >= 3  # spread round the ring
