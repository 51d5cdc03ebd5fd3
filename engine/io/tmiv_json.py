"""The JSON that describes a TMIV sequence: parsing that collects every problem, and its inverse."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from ..rig.camera import Camera, Equirectangular, Perspective, Pose, Projection
from ..rig.depth import DepthCoding
from .pose_trace import euler_degrees

__all__ = ["Description", "TmivError", "find_json", "parse_json", "to_json"]

T = TypeVar("T")


class TmivError(ValueError):
    """What is wrong with a sequence: the field, its value, and what was expected."""


@dataclass(slots=True)
class Description:
    """What the JSON says; cameras in its order."""

    name: str = ""
    fps: float = 30.0
    frames_number: int | None = None
    cameras: dict[str, Camera] = field(default_factory=dict)
    source_names: tuple[str, ...] = ()
    frame_ranges: tuple[tuple[int, int], ...] = ()  # (maxNumberOfFrames, startFrame)
    pose_files: dict[str, str] = field(default_factory=dict)  # moving cameras: CSV beside the JSON


@dataclass(frozen=True, slots=True)
class _Kind(Generic[T]):
    """What a field may be: `convert` raises TypeError or ValueError for anything else."""

    expected: str
    convert: Callable[[Any], T]


def find_json(path: Path) -> Path:
    """The JSON of a folder: <folder name>.json, <Content_name>.json or the only one; or `path` itself."""
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
    """The JSON's text -> what could be understood, and every problem, a line each; `stem`: default name."""
    problems: list[str] = []
    description = Description(stem)
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        return description, [f"JSON: {error}"]
    if not isinstance(document, dict):
        return description, [f"JSON: {type(document).__name__}: expected an object"]
    top = _Fields(document, "", problems)
    description.name = top.get("Content_name", _TEXT, stem) or stem
    description.fps = top.get("Fps", _POSITIVE) or 30.0
    description.frames_number = top.get("Frames_number", _COUNT, None)
    description.frame_ranges = top.get("frameRanges", _FRAME_RANGES, ()) or ()
    items = top.get("cameras", _OBJECTS) or []
    for index, item in enumerate(items):
        _parse_camera(item, index, description, problems)
    names = [name for item in items if isinstance(name := item.get("Name"), str)]
    default = tuple(name for name in names if re.fullmatch("v[0-9]+", name))
    sources = top.get("sourceCameraNames", _NAMES, default)
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


class _Fields:
    """Fetches the fields of a JSON object with checks; what is wrong is added to `problems`."""

    def __init__(self, fields: dict[str, Any], where: str, problems: list[str]) -> None:
        self.fields, self.where, self.problems = fields, where, problems

    def get(self, key: str, kind: _Kind[T], *default: T | None) -> T | None:
        """The field's value, the default where it is absent, None where that is a problem."""
        if key not in self.fields:
            if not default:
                self.problems.append(f"{self.where}{key}: missing: expected {kind.expected}")
            return default[0] if default else None
        try:
            return kind.convert(self.fields[key])
        except (TypeError, ValueError, KeyError, OverflowError):
            shown = json.dumps(self.fields[key])
            shown = shown if len(shown) < 80 else shown[:77] + "..."
            self.problems.append(f"{self.where}{key}: {shown}: expected {kind.expected}")
        return None


def _parse_camera(item: dict[str, Any], index: int, description: Description, problems: list[str]) -> None:
    name = _Fields(item, f"cameras[{index}]: ", problems).get("Name", _TEXT)
    name = name or f"cameras[{index}]"
    before = len(problems)
    fields = _Fields(item, f"camera {name}: ", problems)
    if name in description.cameras:
        problems.append(f"camera {name}: Name: expected names that differ, this one occurs twice")
    position, rotation = fields.get("Position", _VECTOR), fields.get("Rotation", _VECTOR)
    projection, depth = _parse_projection(fields), _parse_depth(fields)
    texture_bits = fields.get("BitDepthColor", _BITS, 10)
    poses = fields.get("Poses", _TEXT, None)
    if len(problems) == before and position and rotation and projection and depth and texture_bits:
        pose = Pose.from_euler(position, *map(math.radians, rotation))
        description.cameras[name] = Camera(name, projection, pose, depth, texture_bits)
        if poses:
            description.pose_files[name] = poses


def _parse_projection(fields: _Fields) -> Projection | None:
    size = fields.get("Resolution", _SIZE)
    kind = fields.get("Projection", _PROJECTION)
    try:
        if kind == "Perspective":
            focal, centre = fields.get("Focal", _PAIR), fields.get("Principle_point", _PAIR)
            return Perspective(*size, *focal, *centre) if size and focal and centre else None
        if kind == "Equirectangular":
            hor, ver = fields.get("Hor_range", _RADIANS), fields.get("Ver_range", _RADIANS)
            return Equirectangular(*size, hor, ver) if size and hor and ver else None
    except ValueError as error:
        fields.problems.append(f"{fields.where}{error}")
    return None


def _parse_depth(fields: _Fields) -> DepthCoding | None:
    limits = fields.get("Depth_range", _DEPTH_RANGE)
    bits = fields.get("BitDepthDepth", _BITS, 16)
    has_invalid = fields.get("HasInvalidDepth", _BOOL, False)
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


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError
    return float(value)


def _positive(value: Any) -> float:
    if _number(value) <= 0:
        raise ValueError
    return float(value)


def _integer(value: Any, low: int, high: int) -> int:
    if _number(value) != int(value) or not low <= value <= high:
        raise ValueError
    return int(value)


def _text(value: Any) -> str:
    # Names become parts of file names.
    if not isinstance(value, str) or not value or "/" in value or "\\" in value or "\0" in value:
        raise TypeError
    return value


def _list(value: Any, count: int | None = None) -> list[Any]:
    if not isinstance(value, list) or (count is not None and len(value) != count):
        raise TypeError
    return value


def _bool(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError
    return value


def _pair(value: Any) -> tuple[float, float]:
    first, second = map(_number, _list(value, 2))
    return first, second


def _vector(value: Any) -> tuple[float, float, float]:
    x, y, z = map(_number, _list(value, 3))
    return x, y, z


def _size(value: Any) -> tuple[int, int]:
    width, height = (_integer(item, 1, 1 << 16) for item in _list(value, 2))
    return width, height


def _radians(value: Any) -> tuple[float, float]:
    low, high = _pair(value)
    return math.radians(low), math.radians(high)


def _depth_range(value: Any) -> tuple[float, float]:
    near, far = _list(value, 2)
    return _number(near), math.inf if far == "inf" else _number(far)


def _objects(value: Any) -> list[dict[str, Any]]:
    if not value or not all(isinstance(item, dict) for item in _list(value)):
        raise TypeError
    return list(value)


def _projection(value: Any) -> str:
    if value not in ("Perspective", "Equirectangular"):
        raise ValueError
    return str(value)


def _frame_ranges(value: Any) -> tuple[tuple[int, int], ...]:
    return tuple(
        (_integer(item["maxNumberOfFrames"], 0, 1 << 31), _integer(item["startFrame"], 0, 1 << 31))
        for item in _list(value)
    )


_TEXT = _Kind("a name without slashes", _text)
_POSITIVE = _Kind("a positive number", _positive)
_COUNT = _Kind("a whole number, 0 or more", lambda value: _integer(value, 0, 1 << 31))
_BITS = _Kind("a whole number from 8 to 16", lambda value: _integer(value, 8, 16))
_BOOL = _Kind("true or false", _bool)
_VECTOR = _Kind("three numbers", _vector)
_PAIR = _Kind("two numbers", _pair)
_SIZE = _Kind("two positive whole numbers", _size)
_RADIANS = _Kind("two numbers, degrees", _radians)
_DEPTH_RANGE = _Kind('two numbers (the second may be "inf")', _depth_range)
_PROJECTION = _Kind("Perspective or Equirectangular", _projection)
_NAMES = _Kind("a list of names", lambda value: tuple(map(_text, _list(value))))
_OBJECTS = _Kind("a list of at least one camera", _objects)
_FRAME_RANGES = _Kind("a list of {maxNumberOfFrames, startFrame}", _frame_ranges)
