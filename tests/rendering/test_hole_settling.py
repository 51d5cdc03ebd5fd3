"""Filled holes settle while the head is still, follow changes of the scene, and are forgotten when the head moves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.rendering.hole_settling import Settler
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding

HERE = Camera("eye", Perspective.from_fov(32, 24, 1.2), Pose((0.0, 0.0, 0.0)), DepthCoding(0.5, 20.0, 16))
HOLE = np.s_[8:12, 10:20]


def picture(luma, holes=HOLE):
    hole = np.zeros((24, 32), bool)
    hole[holes] = True
    planes = tuple(np.full((24, 32), value, np.float32) for value in (300.0, 500.0, 520.0))
    planes[0][holes] = luma
    return np.argwhere(hole).astype(np.int32), planes


def shown(settler, luma, camera=HERE, viewer="me", holes=HOLE):
    places, planes = picture(luma, holes)
    settler.settle(viewer, camera, 1.0, places, planes)
    return planes


def test_noise_in_a_hole_settles_and_nothing_else_changes():
    rng = np.random.default_rng(0)
    settler, seen = Settler(), []
    for _ in range(60):
        planes = shown(settler, 400 + 10 * rng.standard_normal((4, 10)))
        seen.append(planes[0][HOLE].copy())
        untouched = np.ones((24, 32), bool)
        untouched[HOLE] = False
        assert (planes[0][untouched] == 300).all()
        assert (planes[1] == 500).all()
    change = np.abs(np.diff(seen[20:], axis=0)).mean()
    # Of white noise s: between pictures sqrt(2 / pi) s sqrt(2) unsettled, and a part (1 - k) sqrt(2 / (1 + k)) of it.
    assert change < 1.2 * (1 - 0.85) * np.sqrt(2 / 1.85) * 10 * np.sqrt(2 / np.pi)
    assert abs(np.mean(seen[-10:]) - 400) < 2


def test_news_is_shown_at_once():
    settler = Settler()
    shown(settler, 400.0)
    assert (shown(settler, 700.0)[0][HOLE] == 700).all()


def test_the_first_picture_and_those_of_others_are_left_alone():
    settler = Settler()
    assert (shown(settler, 400.0)[0][HOLE] == 400).all()
    assert (shown(settler, 410.0, viewer="other")[0][HOLE] == 410).all()
    assert (shown(settler, 420.0)[0][HOLE] < 405).all()


@pytest.mark.parametrize(
    ("pose", "still"),
    [
        (Pose((0.0, 0.001, 0.0)), True),
        (Pose((0.0, 0.2, 0.0)), False),
        (Pose.from_euler((0.0, 0.0, 0.0), 0.001, 0.0, 0.0), True),
        (Pose.from_euler((0.0, 0.0, 0.0), 0.2, 0.0, 0.0), False),
    ],
    ids=["sways", "moves", "trembles", "turns"],
)
def test_a_head_that_moves_sees_new_holes(pose, still):
    settler = Settler()
    shown(settler, 400.0)
    luma = shown(settler, 420.0, dataclasses.replace(HERE, pose=pose))[0][HOLE]
    assert (luma == 403).all() if still else (luma == 420).all()


def test_only_pixels_that_were_holes_before_settle():
    settler = Settler()
    shown(settler, 400.0)
    wider = np.s_[8:14, 10:20]
    luma = shown(settler, 420.0, holes=wider)[0]
    assert (luma[HOLE] == 403).all()
    assert (luma[12:14, 10:20] == 420).all()
    assert (shown(settler, 400.0, holes=np.s_[0:0, 0:0])[0] == 300).all()  # no hole at all


def test_viewers_of_long_ago_are_forgotten():
    settler = Settler()
    shown(settler, 400.0, viewer="first")
    for k in range(40):
        shown(settler, 500.0, viewer=f"v{k}")
    assert (shown(settler, 420.0, viewer="first")[0][HOLE] == 420).all()
    assert (shown(settler, 520.0, viewer="v39")[0][HOLE] == 503).all()
