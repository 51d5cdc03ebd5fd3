"""Which views show nothing, and how views that are left out are counted."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Fault, Frame, View
from farside.engine.rig.left_out import LeftOut, without_empty_views
from support.rooms import camera_row, texture_of

HOLES, FULL, SKY = DepthCoding(0.5, 20.0, 16, True), DepthCoding(0.5, 20.0, 16), DepthCoding(0.5, math.inf, 12)
BLACK, DIM = 64, 65


def view(camera, luma=300, code=9000):
    """A view of one luma with codes 0, except for one pixel in a corner with another luma and code."""
    shape = camera.height, camera.width
    lumas, codes = np.full(shape, min(luma, BLACK)), np.zeros(shape, np.uint16)
    lumas[-1, -1], codes[-1, -1] = luma, code
    return View(camera, texture_of(lumas), codes)


def reasons(coding, *shown):
    cameras = [dataclasses.replace(camera, depth=coding) for camera in camera_row(len(shown))]
    frame = Frame(3, tuple(view(camera, *given) for camera, given in zip(cameras, shown, strict=True)))
    judged = without_empty_views(frame)
    assert (judged is frame) == (not judged.faults)
    assert judged.index == 3
    assert judged.there == [c for c in range(len(shown)) if f"v{c}" not in judged.faults]
    for before, after in zip(frame.views, judged.views, strict=True):
        assert dataclasses.replace(after, fault=None) == before
    return [judged.faults[f"v{c}"].reason if f"v{c}" in judged.faults else "" for c in range(len(shown))]


@pytest.mark.parametrize("coding", [HOLES, FULL, SKY])
def test_one_pixel_is_enough_to_show_something(coding):
    assert reasons(coding, (DIM, 1), (DIM, 1)) == ["", ""]


def test_a_view_without_depth_shows_nothing():
    assert reasons(HOLES, (300, 0), (300, 1)) == ["no depth", ""]
    assert reasons(HOLES, (BLACK, 0), (300, 0)) == ["no depth", "no depth"]


@pytest.mark.parametrize("coding", [FULL, SKY])
def test_without_a_code_for_no_depth_all_may_be_far(coding):
    assert reasons(coding, (300, 0), (300, 1)) == ["", ""]
    assert reasons(coding, (BLACK, 0), (300, 1)) == ["no depth", ""]
    assert reasons(coding, (BLACK, 0), (BLACK, 0)) == ["no depth", "no depth"]


@pytest.mark.parametrize("coding", [HOLES, FULL, SKY])
def test_a_black_picture_is_left_out_if_another_one_is_not_black(coding):
    assert reasons(coding, (BLACK, 9), (DIM, 9), (BLACK, 9)) == ["black", "", "black"]


def test_pictures_in_the_dark_are_pictures():
    assert reasons(HOLES, (BLACK, 9), (BLACK, 9)) == ["", ""]
    assert reasons(HOLES, (BLACK, 9), (300, 0)) == ["", "no depth"]  # the bright one shows nothing either
    assert reasons(HOLES, (BLACK, 9)) == [""]


def test_a_view_that_is_left_out_already_is_not_judged():
    cameras = camera_row(3)
    missing = dataclasses.replace(view(cameras[0]), fault=Fault("missing"))
    frame = Frame(0, (missing, view(cameras[1], BLACK), view(cameras[2], BLACK)))
    assert without_empty_views(frame) is frame  # the others are in the dark
    frame = dataclasses.replace(frame, views=(missing, view(cameras[1], 300, 0), view(cameras[2])))
    assert {name: fault.reason for name, fault in without_empty_views(frame).faults.items()} == {
        "v0": "missing", "v1": "no depth",
    }  # fmt: skip


def test_views_are_counted_by_camera_and_reason():
    left_out = LeftOut()
    assert (left_out.counts(), str(left_out)) == ({}, "")
    pose, black = Fault("pose", "jumps"), Fault("black")
    assert left_out.add({"v1": pose}) == {"v1": pose}
    assert left_out.add({"v1": Fault("pose", "jumps again"), "v0": black}) == {"v0": black}
    assert left_out.add({"v1": black}) == {"v1": black}
    assert left_out.add({}) == {}
    assert left_out.counts() == {"v1": {"pose": 2, "black": 1}, "v0": {"black": 1}}
    assert str(left_out) == "v1 2x (pose), 1x (black); v0 1x (black)"
