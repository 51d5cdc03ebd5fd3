"""Pose files: CSV with the columns X, Y, Z (metres), Yaw, Pitch, Roll (degrees), one row per frame."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path

from ..rig.camera import Camera, Pose
from .number_table import read_numbers

__all__ = ["euler_degrees", "read_pose_trace", "read_poses", "write_poses"]

COLUMNS = ("X", "Y", "Z", "Yaw", "Pitch", "Roll")


def read_poses(path: Path | str) -> list[Pose]:
    """Absolute poses, one per frame. Raises ValueError for a wrong header or cell, with its line and column.

    The file may be written by any program or spreadsheet that `read_numbers` can read.
    """
    rows = read_numbers(path, COLUMNS)
    if not rows:
        raise ValueError(f"{Path(path).name}: 0 rows: expected a row a frame")
    return [Pose.from_euler(row[:3], *map(math.radians, row[3:])) for row in rows]


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
