"""Checks of a sequence: every problem is found, one line each, without stopping at the first."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from ..rig.camera import Camera
from .file_names import entries, find_path, same_name
from .pose_trace import read_camera_poses
from .tmiv_json import Description, TmivError, find_json, read_json
from .video_files import Kind, depth_path, find_video, look_alikes, texture_path
from .yuv import PIXEL_FORMATS, RawVideo

__all__ = ["check_sequence"]


def check_sequence(path: Path | str) -> list[str]:
    """All problems of the JSON, the video files and the pose files of a sequence; an empty list if there are none."""
    try:
        file = find_json(Path(path))
        description, problems = read_json(file)
    except (TmivError, OSError) as error:
        return [str(error)]
    counts: dict[str, int] = {}
    for name in dict.fromkeys(description.source_names):
        if name in description.cameras:
            problems += _check_files(file.parent, description, description.cameras[name], counts)
        else:  # the camera's entry in the JSON could not be read: check the files that bear its name
            problems += _check_files_alone(file.parent, name, counts)
    problems += _check_counts(description, counts)
    problems += _check_poses(file.parent, description, max(counts.values(), default=0))
    return problems


def _check_files(folder: Path, description: Description, camera: Camera, counts: dict[str, int]) -> list[str]:
    problems = []
    kinds: tuple[tuple[Kind, int, str], ...] = (
        ("texture", camera.texture_bits, "BitDepthColor"), ("depth", camera.depth.bits, "BitDepthDepth"),
    )  # fmt: skip
    for kind, bits, key in kinds:
        try:
            video = find_video(folder, camera, kind, description.cameras)
        except ValueError as error:
            problems.append(f"camera {camera.name}: {kind}: {error}")
            continue
        if video is None:
            expected = (texture_path if kind == "texture" else depth_path)(folder, camera).name
            problems.append(f"camera {camera.name}: {kind}: missing: expected a file like {expected}")
            problems += look_alikes(folder, camera, kind)
            continue
        counts[video.path.name] = video.frame_count
        if video.format.bits != bits:
            problems.append(f"{video.path.name}: {video.format.bits} bits: expected {bits}, the JSON's {key}")
        problems += _check_size(video)
    return problems


def _check_files_alone(folder: Path, name: str, counts: dict[str, int]) -> list[str]:
    problems = []
    pattern = re.compile(re.escape(same_name(name)) + rf"_(texture|depth)_(\d+)x(\d+)_({PIXEL_FORMATS})\.yuv")
    found = set()
    for path in entries(folder):
        if (match := pattern.fullmatch(same_name(path.name))) and int(match[2]) and int(match[3]):
            video = RawVideo(path, int(match[2]), int(match[3]), match[4])
            counts[path.name] = video.frame_count
            problems += _check_size(video)
            found.add(match[1])
    missing = [kind for kind in ("texture", "depth") if kind not in found]
    return problems + [f"camera {name}: {kind}: missing" for kind in missing]


def _check_size(video: RawVideo) -> list[str]:
    if video.frame_count and not video.extra_bytes:
        return []
    size = video.frame_count * video.frame_bytes + video.extra_bytes
    return [
        f"{video.path.name}: {size} bytes: expected a multiple of {video.frame_bytes}, a frame "
        f"({video.frame_count} whole frames, the last one truncated at {video.extra_bytes} bytes)"
    ]


def _check_counts(description: Description, counts: dict[str, int]) -> list[str]:
    if not counts:
        return []
    usual = Counter(counts.values()).most_common(1)[0][0]
    problems = [
        f"{name}: {count} frames: expected {usual}, as most files have"
        for name, count in counts.items()
        if count != usual
    ]
    if description.frames_number not in (None, usual):
        problems.append(f"Frames_number: {description.frames_number}: the files have {usual}")
    shortest = min(counts.values())
    for most, start in description.frame_ranges:
        if start >= shortest:
            problems.append(
                f"frameRanges: startFrame {start} (up to {most} frames): a file has {shortest} frames"
            )
    return problems


def _check_poses(folder: Path, description: Description, frames: int) -> list[str]:
    problems = []
    for name, file in description.pose_files.items():
        try:
            is_source = name in description.source_names
            read = read_camera_poses(find_path(folder, file), description.fps if is_source else None)
        except (ValueError, OSError) as error:
            problems.append(f"camera {name}: Poses: {error}")
            continue
        if len(read.poses) < frames:
            problems.append(
                f"camera {name}: Poses: {file} has {len(read.poses)} rows: expected {frames}, a row a frame"
            )
        if read.faults:
            problems.append(f"camera {name}: Poses: {file}: {read.said()}")
    return problems
