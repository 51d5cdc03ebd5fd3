"""The JSON that describes a TMIV sequence: parsing that collects every problem, and its inverse."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..rig.camera import Camera, Equirectangular, Perspective, Pose, Projection
from ..rig.depth import DepthCoding
from .pose_trace import euler_degrees
from .tmiv_fields import (
    BITS,
    BOOL,
    COUNT,
    DEPTH_RANGE,
    FRAME_RANGES,
    NAMES,
    OBJECTS,
    PAIR,
    POSITIVE,
    PROJECTION,
    RADIANS,
    SIZE,
    TEXT,
    VECTOR,
    Fields,
)

__all__ = ["Description", "TmivError", "find_json", "parse_json", "to_json"]


class TmivError(ValueError):
    """A problem of a sequence; it names the field, its value, and what was expected."""


@dataclass(slots=True)
class Description:
    """The content of the JSON; cameras are in its order."""

    name: str = ""
    fps: float = 30.0
    frames_number: int | None = None
    cameras: dict[str, Camera] = field(default_factory=dict)
    source_names: tuple[str, ...] = ()
    frame_ranges: tuple[tuple[int, int], ...] = ()  # (maxNumberOfFrames, startFrame)
    pose_files: dict[str, str] = field(default_factory=dict)  # of moving cameras: CSV files in the JSON's folder


def find_json(path: Path) -> Path:
    """The JSON of a folder: <folder name>.json, <Content_name>.json or the only one; or `path` itself if it is a file.

    Raises TmivError if there is none, or more than one and none of these names.
    """
    if path.is_file():
        return path
    if not path.is_dir():
        raise TmivError(f"sequence: {str(path)!r}: expected a folder or its JSON file")
    by_id = path / f"{path.resolve().name}.json"
    if by_id.is_file():
        return by_id
    found = sorted(path.glob("*.json"))
    named = [file for file in found if len(found) > 1 and _content_name(file) == file.stem]
    for choice in (named, found):
        if len(choice) == 1:
            return choice[0]
    raise TmivError(
        f"sequence: {str(path)!r}: {len(found)} JSON files: expected one, {by_id.name} or <Content_name>.json"
    )


def parse_json(text: str, stem: str) -> tuple[Description, list[str]]:
    """The JSON's text -> the parts that could be read, and every problem, one line each; `stem`: the default name."""
    problems: list[str] = []
    description = Description(stem)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        return description, [f"JSON: {error}"]
    if not isinstance(document, dict):
        return description, [f"JSON: {type(document).__name__}: expected an object"]
    top = Fields(document, "", problems)
    description.name = top.get("Content_name", TEXT, stem) or stem
    description.fps = top.get("Fps", POSITIVE) or 30.0
    description.frames_number = top.get("Frames_number", COUNT, None)
    description.frame_ranges = top.get("frameRanges", FRAME_RANGES, ()) or ()
    items = top.get("cameras", OBJECTS) or []
    for index, item in enumerate(items):
        _parse_camera(item, index, description, problems)
    names = [name for item in items if isinstance(name := item.get("Name"), str)]
    default = tuple(name for name in names if re.fullmatch("v[0-9]+", name))
    sources = top.get("sourceCameraNames", NAMES, default)
    if items and sources is not None:
        description.source_names = sources
        _check_sources(sources, names, problems)
    return description, problems


def to_json(description: Description) -> str:
    """The inverse of `parse_json`."""
    document: dict[str, Any] = {
        "Version": "2.0",
        "Content_name": description.name,
        "BoundingBox_center": [0, 0, 0],
        "Fps": description.fps,
        "lengthsInMeters": True,
        "sourceCameraNames": list(description.source_names),
    }
    if description.frames_number is not None:
        document["Frames_number"] = description.frames_number
    if description.frame_ranges:
        document["frameRanges"] = [
            {"maxNumberOfFrames": most, "startFrame": start} for most, start in description.frame_ranges
        ]
    document["cameras"] = [
        _camera_json(camera, description.pose_files.get(name)) for name, camera in description.cameras.items()
    ]
    return json.dumps(document, indent=1)


def _parse_camera(item: dict[str, Any], index: int, description: Description, problems: list[str]) -> None:
    name = Fields(item, f"cameras[{index}]: ", problems).get("Name", TEXT)
    name = name or f"cameras[{index}]"
    before = len(problems)
    fields = Fields(item, f"camera {name}: ", problems)
    if name in description.cameras:
        problems.append(f"camera {name}: Name: expected names that differ, this one occurs twice")
    position, rotation = fields.get("Position", VECTOR), fields.get("Rotation", VECTOR)
    projection, depth = _parse_projection(fields), _parse_depth(fields)
    texture_bits = fields.get("BitDepthColor", BITS, 10)
    poses = fields.get("Poses", TEXT, None)
    if len(problems) == before and position and rotation and projection and depth and texture_bits:
        pose = Pose.from_euler(position, *map(math.radians, rotation))
        description.cameras[name] = Camera(name, projection, pose, depth, texture_bits)
        if poses:
            description.pose_files[name] = poses


def _parse_projection(fields: Fields) -> Projection | None:
    size = fields.get("Resolution", SIZE)
    kind = fields.get("Projection", PROJECTION)
    try:
        if kind == "Perspective":
            focal, centre = fields.get("Focal", PAIR), fields.get("Principle_point", PAIR)
            return Perspective(*size, *focal, *centre) if size and focal and centre else None
        if kind == "Equirectangular":
            hor, ver = fields.get("Hor_range", RADIANS), fields.get("Ver_range", RADIANS)
            return Equirectangular(*size, hor, ver) if size and hor and ver else None
    except ValueError as error:
        fields.problems.append(f"{fields.where}{error}")
    return None


def _parse_depth(fields: Fields) -> DepthCoding | None:
    limits = fields.get("Depth_range", DEPTH_RANGE)
    bits = fields.get("BitDepthDepth", BITS, 16)
    has_invalid = fields.get("HasInvalidDepth", BOOL, False)
    if limits is None or bits is None or has_invalid is None:
        return None
    try:
        return DepthCoding(*limits, bits, has_invalid)
    except ValueError as error:
        fields.problems.append(f"{fields.where}Depth_range: {error}")
    return None


def _check_sources(sources: tuple[str, ...], names: list[str], problems: list[str]) -> None:
    if not sources:
        problems.append("sourceCameraNames: no source view: expected names, or cameras named v0, v1 ...")
    for name in dict.fromkeys(sources):
        if name not in names:
            problems.append(f"sourceCameraNames: {name!r}: no camera has this name")
        if sources.count(name) > 1:
            problems.append(f"sourceCameraNames: {name!r}: named {sources.count(name)} times: expected once")


def _camera_json(camera: Camera, poses: str | None) -> dict[str, Any]:
    p = camera.projection
    out: dict[str, Any] = {
        "Name": camera.name,
        "Position": list(camera.pose.position),
        "Rotation": list(euler_degrees(camera.pose)),
        "Depthmap": 1,
        "Background": 0,
        "Depth_range": [camera.depth.near, "inf" if math.isinf(camera.depth.far) else camera.depth.far],
        "Resolution": [p.width, p.height],
    }
    if isinstance(p, Perspective):
        out |= {"Projection": "Perspective", "Focal": [p.fx, p.fy], "Principle_point": [p.cx, p.cy]}
    else:
        out |= {
            "Projection": "Equirectangular",
            "Hor_range": [math.degrees(angle) for angle in p.hor_range],
            "Ver_range": [math.degrees(angle) for angle in p.ver_range],
        }
    out |= {
        "BitDepthColor": camera.texture_bits,
        "BitDepthDepth": camera.depth.bits,
        "HasInvalidDepth": camera.depth.has_invalid,
        "ColorSpace": "YUV420",
        "DepthColorSpace": "YUV420",
    }
    return out | ({"Poses": poses} if poses else {})


def _content_name(path: Path) -> str | None:
    try:
        document = json.loads(path.read_text("utf-8"))
    except ValueError:
        return None
    name = document.get("Content_name") if isinstance(document, dict) else None
    return name if isinstance(name, str) else None
