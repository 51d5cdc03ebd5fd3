"""Choice of the views that render a picture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.engine.background.exposure import LIKELY
from farside.engine.io.tmiv_json import parse_json
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.selection import likely_views, select_views
from farside.engine.synth.rigs import twin_cameras
from support.shared import SHARED

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
    """From a ball of cameras that look outwards, those on the side at which the viewer looks are selected."""
    half = Equirectangular(64, 64, (-math.pi / 2, math.pi / 2), (-math.pi / 2, math.pi / 2))
    ring = [
        camera(0.3 * math.cos(a), 0.3 * math.sin(a), yaw=a, projection=half)
        for a in (k * math.pi / 4 for k in range(8))
    ]
    assert set(select_views(camera(0.0, 0.0), ring, 3, DEPTHS)) <= {7, 0, 1}
    everywhere = select_views(camera(0.0, 0.0, projection=SPHERE), ring, 4, DEPTHS)
    assert max(min((a - b) % 8, (b - a) % 8) for a in everywhere for b in everywhere) >= 3  # spread round the ring


def half_sphere(directions, radius=0.3):
    """Cameras on a ball that look outwards, each with a field of view of half a sphere."""
    half = Equirectangular(64, 64, (-math.pi / 2, math.pi / 2), (-math.pi / 2, math.pi / 2))
    return [
        Camera(f"v{k}", half, Pose.from_euler(radius * d, math.atan2(d[1], d[0]), -math.asin(d[2]), 0.0), CODING)
        for k, d in enumerate(directions)
    ]


def spiral(count):
    """Directions spread evenly over the sphere."""
    z, turn = (np.arange(count) + 0.5) * 2 / count - 1, np.arange(count) * math.pi * (3 - math.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=-1)


def crowd(count):
    rng = np.random.default_rng(2)
    return [camera(*rng.uniform(-0.4, 0.4, 3), yaw=rng.uniform(-math.pi, math.pi)) for _ in range(count)]


def real_rigs():
    for file in sorted((SHARED / "tmiv" / "sequences").glob("*.json")):
        sequence, _problems = parse_json(file.read_text(), file.stem)
        yield sequence.name, list(sequence.cameras.values())


RIGS = {
    **{name: list(twin_cameras(name).cameras) for name in ("museum", "hijack", "painter", "frog", "gymnasium-a")},
    **dict(real_rigs()),
    "ball": half_sphere(spiral(64)),
    "dense ball": half_sphere(spiral(300)),
    "wall": [camera(0.0, 0.12 * (k % 8), 0.12 * (k // 8)) for k in range(64)],
    "arc": [camera(2 - 2 * math.cos(a), -2 * math.sin(a), yaw=a) for a in np.linspace(-1.5, 1.5, 64)],
    "crowd": crowd(64),
}


@pytest.mark.parametrize("rig", RIGS)
def test_a_first_cut_leaves_the_choice_as_it_is(rig):
    cameras = RIGS[rig]
    packed = np.stack([one.packed() for one in cameras])
    for k, target in list(enumerate(cameras))[:64]:
        likely = likely_views(target, packed, LIKELY + 1, DEPTHS)
        assert len(likely) == min(LIKELY + 1, len(cameras))
        others = ([i for i in some if i != k] for some in (range(len(cameras)), likely))
        every, cut = ([some[i] for i in select_views(target, [cameras[j] for j in some], 4, DEPTHS)] for some in others)
        assert every == cut
