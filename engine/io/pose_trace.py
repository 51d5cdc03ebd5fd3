"""Pose files: CSV with the columns X, Y, Z (metres), Yaw, Pitch, Roll (degrees), one row per frame."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from ..rig.camera import Camera, Pose
from ..rig.frame import Fault
from ..rig.pose_watch import PoseWatch, not_a_pose
from .number_table import read_numbers

__all__ = [
    "CameraPoses",
    "believed_poses",
    "euler_degrees",
    "read_camera_poses",
    "read_pose_trace",
    "read_poses",
    "write_poses",
]

COLUMNS = ("X", "Y", "Z", "Yaw", "Pitch", "Roll")


def read_poses(path: Path | str) -> list[Pose]:
    """Absolute poses, one per frame. Raises ValueError for a wrong header or cell, with its line and column.

    The file may be written by any program or spreadsheet that `read_numbers` can read.
    """
    rows = read_numbers(path, COLUMNS)
    if not rows:
        raise ValueError(f"{Path(path).name}: 0 rows: expected a row a frame")
    return [_pose(row) for row in rows]


class CameraPoses(NamedTuple):
    """The poses of a moving camera, one per frame, and why some frames have none. In place of such a pose is the last
    one before, or at the start the first."""

    poses: list[Pose]
    faults: dict[int, Fault]  # by frame

    def said(self) -> str:
        """How many frames have no pose, for people; "" if all have one."""
        if not self.faults:
            return ""
        frame, fault = next(iter(self.faults.items()))
        some = f"{len(self.faults)} of {len(self.poses)} rows are no pose of the camera"
        return f"{some}, which is left out of those frames (the first is of frame {frame}: {fault.detail})"


def read_camera_poses(path: Path | str, fps: float | None = None) -> CameraPoses:
    """As `read_poses`, but a row may hold no pose: its numbers are not finite, or cells are empty. fps: frames a
    second, if a pose to which a camera cannot have moved (`rig.pose_watch`) counts as none too. Raises ValueError if no
    row holds a pose."""
    rows = read_numbers(path, COLUMNS, gaps=True)
    found = [_pose(row) if all(map(math.isfinite, row)) else not_a_pose(row) for row in rows]
    try:
        return believed_poses(found, fps)
    except ValueError as error:
        raise ValueError(f"{Path(path).name}: {error}") from error


def believed_poses(found: Sequence[Pose | Fault], fps: float | None) -> CameraPoses:
    """The poses of a camera, of which some frames have none; fps as in `read_camera_poses`. Raises ValueError if no
    frame has one."""
    faults: dict[int, Fault] = {}
    watch = None if fps is None else PoseWatch(fps)
    for frame, pose in enumerate(found):
        fault = pose if isinstance(pose, Fault) else watch.jump(frame, pose) if watch else None
        if fault is not None:
            faults[frame] = fault
    poses = [None if frame in faults or isinstance(pose, Fault) else pose for frame, pose in enumerate(found)]
    last = next((pose for pose in poses if pose is not None), None)
    if last is None:
        raise ValueError(f"{len(found)} rows, none with a pose: expected a row a frame")
    return CameraPoses([last := pose or last for pose in poses], faults)


def _pose(row: tuple[float, ...]) -> Pose:
    return Pose.from_euler(row[:3], *map(math.radians, row[3:]))


def read_pose_trace(path: Path | str, viewport: Camera) -> list[Pose]:
    """Head poses of a trace, in the world: positions in the file are offsets from the viewport's, rotations absolute.

    Raises ValueError as `read_poses` does.
    """
    x, y, z = viewport.pose.position
    return [
        dataclasses.replace(pose, position=(x + pose.position[0], y + pose.position[1], z + pose.position[2]))
        for pose in read_poses(path)
    ]


def write_poses(path: Path | str, poses: Iterable[Pose]) -> None:
    """Write absolute poses as `read_poses` reads them."""
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([*pose.position, *euler_degrees(pose)] for pose in poses)


def euler_degrees(pose: Pose) -> tuple[float, float, float]:
    """Yaw, pitch and roll in degrees, R = Rz(yaw) Ry(pitch) Rx(roll); roll is 0 straight up and down."""
    r = pose.rotation()
    level = math.hypot(r[2, 1], r[2, 2])
    pitch = math.atan2(-r[2, 0], level)
    roll = math.atan2(r[2, 1], r[2, 2]) if level > 1e-14 else 0.0
    # Nearly straight up or down, the roll is inaccurate. The yaw is computed from the rotation that remains after the
    # roll, so it makes up for the error.
    c, s = math.cos(roll), math.sin(roll)
    yaw = math.atan2(s * r[0, 2] - c * r[0, 1], c * r[1, 1] - s * r[1, 2])
    return math.degrees(yaw), math.degrees(pitch), math.degrees(roll)
