"""The JSON that describes a TMIV sequence: parsing that collects every problem, and its inverse."""

from __future__ import annotations

import json
import math
import re
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..rig.camera import Camera, Equirectangular, Perspective, Pose, Projection
from ..rig.depth import DepthCoding
from .file_names import entries, find_entry, same_name
from .pose_trace import euler_degrees
from .text import read_text
from .tmiv_fields import (
    BITS,
    BOOL,
    COUNT,
    DEPTH_RANGE,
    FILE,
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

__all__ = ["Description", "TmivError", "find_json", "parse_json", "read_json", "to_json"]

_SHOWN = 30  # characters of the JSON in a message


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
    pose_files: dict[str, str] = field(default_factory=dict)  # of moving cameras: CSV files below the JSON's folder
    lengths_in_metres: bool = True


def find_json(path: Path) -> Path:
    """The JSON of a folder: <folder name>.json, <Content_name>.json or the only one; or `path` itself if it is a file.

    Names may differ in letter case and composition (`file_names.find_entry`), and companions of other files are passed
    over. Raises TmivError if there is none, or more than one and none of these names.
    """
    try:
        place = path if path.exists() else find_entry(path.parent, path.name)
        if place is None or place.name.startswith("._") or not (place.is_file() or place.is_dir()):
            what = "a companion of macOS" if place and place.name.startswith("._") else "missing"
            raise TmivError(f"sequence: {str(path)!r}: {what}: expected a folder or its JSON file")
        return place if place.is_file() else _json_of_folder(place)
    except TmivError:
        raise
    except ValueError as error:
        raise TmivError(f"sequence: {error}") from error


def _json_of_folder(folder: Path) -> Path:
    by_id = f"{folder.resolve().name}.json"
    if found := find_entry(folder, by_id):
        return found
    files = [file for file in entries(folder) if file.suffix.casefold() == ".json" and file.is_file()]
    named = [file for file in files if len(files) > 1 and same_name(_content_name(file) or "") == same_name(file.stem)]
    for choice in (named, files):
        if len(choice) == 1:
            return choice[0]
    names = "".join(f" {file.name}," for file in files[:10])
    raise TmivError(
        f"sequence: {str(folder)!r}: {len(files)} JSON files:{names} expected one, {by_id} or <Content_name>.json"
    )


def read_json(file: Path) -> tuple[Description, list[str]]:
    """As `parse_json`, of a file, in any encoding that `read_text` reads; every problem begins with the file's name.

    Raises OSError if the file cannot be read.
    """
    try:
        text = read_text(file)
    except ValueError as error:
        return Description(file.stem), [str(error)]
    description, problems = parse_json(text, file.stem)
    return description, [f"{file.name}: {problem}" for problem in problems]


def parse_json(text: str, stem: str) -> tuple[Description, list[str]]:
    """The JSON's text -> the parts that could be read, and every problem, one line each; `stem`: the default name."""
    problems: list[str] = []
    description = Description(stem)
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        return description, [f"JSON: {_place(error)}"]
    except RecursionError:
        return description, ["JSON: brackets in brackets, too deep to be read: expected an object of cameras"]
    except ValueError as error:  # an integer with thousands of digits
        return description, [f"JSON: {error}"]
    if not isinstance(document, dict):
        return description, [f"JSON: {type(document).__name__}: expected an object"]
    top = Fields(document, "", problems)
    description.name = top.get("Content_name", TEXT, stem) or stem
    description.fps = top.get("Fps", POSITIVE) or 30.0
    description.lengths_in_metres = top.get("lengthsInMeters", BOOL, True) is not False
    description.frames_number = top.get("Frames_number", COUNT, None)
    description.frame_ranges = top.get("frameRanges", FRAME_RANGES, ()) or ()
    items = top.get("cameras", OBJECTS) or []
    for index, item in enumerate(items):
        _parse_camera(item, index, description, problems)
    names = [unicodedata.normalize("NFC", name) for item in items if isinstance(name := item.get("Name"), str)]
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
        "lengthsInMeters": description.lengths_in_metres,
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


def _place(error: json.JSONDecodeError) -> str:
    """A mistake of the JSON's grammar: its place, what is there, and what was expected."""
    text = error.doc[error.pos : error.pos + _SHOWN].partition("\n")[0]
    there = repr(text) if text else "the end of the line" if error.pos < len(error.doc) else "the end of the file"
    said = error.msg.replace("Expecting", "expected", 1)
    return f"line {error.lineno}, column {error.colno}: {there}: {said[:1].lower()}{said[1:]}"


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
    poses = fields.get("Poses", FILE, None)
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
        document = json.loads(read_text(path))
    except (ValueError, RecursionError):
        return None
    name = document.get("Content_name") if isinstance(document, dict) else None
    return name if isinstance(name, str) else None
