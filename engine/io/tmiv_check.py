"""Checks of a sequence: every problem is found, one line each, without stopping at the first."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from ..rig.camera import Camera
from .pose_trace import read_poses
from .tmiv import depth_path, find_video, texture_path
from .tmiv_json import Description, TmivError, find_json, parse_json
from .yuv import PIXEL_FORMATS, RawVideo

__all__ = ["check_sequence"]


def check_sequence(path: Path | str) -> list[str]:
    """All problems of the JSON, the video files and the pose files of a sequence; an empty list if there are none."""
    try:
        file = find_json(Path(path))
        description, problems = parse_json(file.read_text("utf-8"), file.stem)
    except (TmivError, OSError, UnicodeDecodeError) as error:
        return [str(error)]
    problems = [f"{file.name}: {line}" for line in problems]
    counts: dict[str, int] = {}
    for name in dict.fromkeys(description.source_names):
        if name in description.cameras:
            problems += _check_files(file.parent, description.cameras[name], counts)
        else:  # the camera's entry in the JSON could not be read: check the files that bear its name
            problems += _check_files_alone(file.parent, name, counts)
    problems += _check_counts(description, counts)
    problems += _check_poses(file.parent, description, max(counts.values(), default=0))
    return problems


def _check_files(folder: Path, camera: Camera, counts: dict[str, int]) -> list[str]:
    problems = []
    for kind, bits, key, name_file in (
        ("texture", camera.texture_bits, "BitDepthColor", texture_path),
        ("depth", camera.depth.bits, "BitDepthDepth", depth_path),
    ):
        video = find_video(folder, camera, "texture" if kind == "texture" else "depth")
        if video is None:
            expected = name_file(folder, camera).name
            problems.append(f"camera {camera.name}: {kind}: missing: expected a file like {expected}")
            problems += _misnamed(folder, camera, kind)
            continue
        counts[video.path.name] = video.frame_count
        if video.format.bits != bits:
            problems.append(f"{video.path.name}: {video.format.bits} bits: expected {bits}, the JSON's {key}")
        problems += _check_size(video)
    return problems


def _check_files_alone(folder: Path, name: str, counts: dict[str, int]) -> list[str]:
    problems = []
    pattern = re.compile(re.escape(name) + rf"_(texture|depth)_(\d+)x(\d+)_({PIXEL_FORMATS})\.yuv")
    matches = [match for path in sorted(folder.iterdir()) if (match := pattern.fullmatch(path.name))]
    for match in matches:
        if int(match[2]) and int(match[3]):
            video = RawVideo(folder / match[0], int(match[2]), int(match[3]), match[4])
            counts[match[0]] = video.frame_count
            problems += _check_size(video)
    found = {match[1] for match in matches}
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


def _misnamed(folder: Path, camera: Camera, kind: str) -> list[str]:
    """Files of the camera with another resolution or an unknown format."""
    pattern = re.compile(re.escape(f"{camera.name}_{kind}_") + r"(\d+x\d+)_.*\.yuv")
    size = f"{camera.width}x{camera.height}"
    problems = []
    for path in sorted(folder.iterdir()):
        if match := pattern.fullmatch(path.name):
            expected = f"{size}, the JSON's Resolution" if match[1] != size else "a known pixel format"
            problems.append(f"{path.name}: expected {expected}")
    return problems


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
            rows = len(read_poses(folder / file))
        except (ValueError, OSError) as error:
            problems.append(f"camera {name}: Poses: {error}")
            continue
        if rows < frames:
            problems.append(f"camera {name}: Poses: {file} has {rows} rows: expected {frames}, a row a frame")
    return problems
