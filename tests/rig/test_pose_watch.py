"""Poses that jump are left out, and cameras that are elsewhere, or fast, are believed."""

from __future__ import annotations

import math

import pytest
from farside.engine.rig.camera import Pose
from farside.engine.rig.pose_watch import PoseWatch

FPS = 30.0


def at(x, yaw=0.0):
    return Pose.from_euler((x, 0.0, 1.5), yaw, 0.0, 0.0)


def left_out(poses, fps=FPS, frames=None):
    """The numbers of the frames whose poses are not believed."""
    watch = PoseWatch(fps)
    numbers = range(len(poses)) if frames is None else frames
    return [frame for frame, pose in zip(numbers, poses, strict=True) if watch.jump(frame, pose) is not None]


@pytest.mark.parametrize("step", [0.0, 0.05, 1.5])
def test_a_camera_that_moves_is_believed(step):
    assert left_out([at(step * k, 0.1 * step * k) for k in range(40)]) == []


@pytest.mark.parametrize("glitch", [at(0.5 + 2.0), at(-1e6), at(0.5, 2.0), at(0.5, math.pi)])
def test_a_jump_for_one_frame_is_left_out_and_the_next_pose_is_believed(glitch):
    poses = [at(0.01 * k) for k in range(100)]
    poses[50] = glitch
    assert left_out(poses) == [50]


def test_the_same_orientation_with_the_other_sign_is_no_jump():
    there = at(0.0, 1.0)
    other = Pose(there.position, tuple(-c for c in there.orientation))
    assert left_out([there, other, there]) == []


def test_a_camera_that_was_put_elsewhere_is_left_out_of_one_frame():
    assert left_out([at(0.0)] * 5 + [at(7.0)] * 5) == [5]


def test_a_first_pose_that_was_wrong_costs_one_frame():
    assert left_out([at(50.0)] + [at(0.0)] * 5) == [1]


def test_a_camera_that_always_moves_so_fast_is_believed_after_three_frames():
    assert left_out([at(5.0 * k) for k in range(50)]) == [1, 2, 3]


def test_frames_that_were_skipped_give_it_time():
    there, elsewhere = [at(0.0)] * 3, [at(7.0)] * 2
    assert left_out(there + elsewhere, frames=[0, 1, 2, 8, 9]) == []
    assert left_out(there + elsewhere, frames=[0, 1, 2, 4, 5]) == [4]


def test_a_slow_video_gives_it_time():
    assert left_out([at(0.0), at(7.0), at(0.0)], fps=5.0) == []
    assert left_out([at(0.0), at(7.0), at(0.0)]) == [1]


def test_the_fault_says_how_far():
    watch = PoseWatch(FPS)
    watch.jump(0, at(0.0))
    assert str(watch.jump(1, at(30.0, math.pi / 2))) == "pose: jumps by 30 m and 90 degrees"


def test_no_camera_is_believed_to_be_far_from_its_rig_however_often_it_says_so() -> None:
    far = Pose((1e12, 0.0, 0.0))
    watch = PoseWatch(FPS, Pose((3.0, 0.0, 0.0)))
    for frame in range(0, 40, 2):
        fault = watch.jump(frame, Pose((-1e9 * frame - 2e5, 0.0, 0.0)))
        assert fault is not None
        assert str(fault).startswith("pose: is ")
        assert watch.jump(frame + 1, Pose((3.0 + 0.1 * frame, 0.0, 0.0))) is None
    assert str(watch.jump(50, far)) == (
        "pose: is 1e+12 m from where the camera was announced: expected at most 100000 m"
    )
    assert PoseWatch(FPS).jump(0, far) is None  # what is not announced begins anywhere
