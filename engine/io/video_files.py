"""The names of a camera's raw video files, and the files of a folder that have them."""

from __future__ import annotations

import os
import re
from collections.abc import Collection
from pathlib import Path
from typing import Literal

from ..rig.camera import Camera
from .file_names import entries, find_entry, only_one, same_name
from .yuv import PIXEL_FORMATS, RawVideo

__all__ = ["Kind", "depth_path", "find_video", "look_alikes", "texture_path"]

Kind = Literal["texture", "depth"]


def texture_path(folder: Path | str, camera: Camera, pixel_format: str = "yuv420p10le") -> Path:
    """The path of the camera's texture file."""
    return Path(folder) / f"{_start(camera, 'texture')}{pixel_format}.yuv"


def depth_path(folder: Path | str, camera: Camera, pixel_format: str = "yuv420p16le") -> Path:
    """The path of the camera's file of depth codes."""
    return Path(folder) / f"{_start(camera, 'depth')}{pixel_format}.yuv"


def find_video(folder: Path, camera: Camera, kind: Kind, others: Collection[str] = ()) -> RawVideo | None:
    """The camera's file in a folder or in its truth/, None if there is none.

    If there are files of several formats, it is the one with the number of bits that the JSON says. If none has exactly
    the camera's name, a file is taken whose name differs only in letter case or composition (NFC, NFD), unless it has
    the exact name of another camera; `others`: the names of the sequence's cameras. Raises ValueError, which names all
    files, if there are several such.
    """
    bits = camera.texture_bits if kind == "texture" else camera.depth.bits
    files = _files_of(folder, camera, kind, others)
    if not files and (truth := find_entry(folder, "truth")):
        files = _files_of(truth, camera, kind, others)
    videos = [RawVideo(path, camera.width, camera.height, name) for name, path in files.items()]
    return min(videos, key=lambda video: video.format.bits != bits) if videos else None


def look_alikes(folder: Path, camera: Camera, kind: Kind) -> list[str]:
    """What is wrong with files that seem to be the camera's: another size, an unknown pixel format, another name."""
    pattern = re.compile(re.escape(same_name(f"{camera.name}_")) + r"((?:(texture|depth)_)?.*)\.yuv")
    size = f"{camera.width}x{camera.height}"
    wrong = []
    for path in entries(folder):
        match = pattern.fullmatch(same_name(path.name))
        if not match or (match[2] or "texture") != kind:
            continue
        parts = re.fullmatch(rf"{kind}_(\d+x\d+)_(.*)", match[1])
        if parts is None:
            wrong.append(f"{path.name}: expected a name like {_start(camera, kind)}FORMAT.yuv")
        elif parts[1] != size:
            wrong.append(f"{path.name}: {parts[1]}: expected {size}, the JSON's Resolution")
        else:
            wrong.append(f"{path.name}: {parts[2]}: expected yuv420p, yuv400p or gray, with 9le to 16le")
    return wrong


def _start(camera: Camera, kind: Kind) -> str:
    return f"{camera.name}_{kind}_{camera.width}x{camera.height}_"


def _files_of(folder: Path, camera: Camera, kind: Kind, others: Collection[str]) -> dict[str, Path]:
    """For each pixel format the camera's file in a folder."""
    start, names = _start(camera, kind), sorted(os.listdir(folder)) if folder.is_dir() else []
    exact = re.compile(re.escape(start) + rf"({PIXEL_FORMATS})\.yuv")
    # Most names are exact, and are looked for in a growing folder again and again: other names only if there is none.
    if files := {match[1]: folder / name for name in names if (match := exact.fullmatch(name))}:
        return files
    pattern = re.compile(re.escape(same_name(start)) + rf"({PIXEL_FORMATS})\.yuv")
    theirs = tuple(f"{name}_{kind}_" for name in others if name != camera.name)
    matches = [(name, pattern.fullmatch(same_name(name))) for name in names if not name.startswith(theirs)]
    similar = [(match[1], folder / name) for name, match in matches if match]
    alone = {name: only_one(f"{start}{name}.yuv", (path for n, path in similar if n == name)) for name, _ in similar}
    return {name: path for name, path in alone.items() if path}
