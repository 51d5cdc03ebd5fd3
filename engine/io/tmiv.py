"""Sequences in TMIV's layout: a folder with a JSON and raw planar files, read on demand."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera, Pose
from ..rig.frame import Frame, Texture, View
from .file_names import find_path
from .pose_trace import read_poses, write_poses
from .tmiv_json import Description, TmivError, find_json, read_json, to_json
from .video_files import Kind, depth_path, find_video, look_alikes, texture_path
from .yuv import PixelFormat, RawVideo, from_texture

__all__ = [
    "Sequence",
    "SequenceWriter",
    "TmivError",
    "depth_path",
    "find_video",
    "open_sequence",
    "texture_path",
]

class Sequence:
    """An opened sequence: a `Recording`. Files are mapped, so a view is read from disk only when it is used.

    `cameras` holds every camera of the JSON, also virtual ones (`viewport`). Frame 0 is the first of the files.
    """

    def __init__(self, folder: Path, description: Description) -> None:
        self.folder = folder
        self.name, self.fps = description.name, description.fps
        self.frames_number = description.frames_number
        self._names = tuple(description.cameras)
        self.source_names = description.source_names
        self._poses = {name: _poses(folder, name, file) for name, file in description.pose_files.items()}
        self._videos: dict[tuple[str, Kind], RawVideo] = {}
        self.cameras = {name: self._with_file_bits(camera) for name, camera in description.cameras.items()}

    @property
    def frame_count(self) -> int:
        """Whole frames in the shortest file of the source views; raises TmivError if a file is missing."""
        kinds: tuple[Kind, ...] = ("texture", "depth")
        return min(self.video(name, kind).frame_count for name in self.source_names for kind in kinds)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Every camera of the JSON, also virtual ones."""
        return tuple(self.cameras)

    @property
    def truth_names(self) -> tuple[str, ...]:
        """The virtual cameras that have a texture file."""
        virtual = [camera for name, camera in self.cameras.items() if name not in self.source_names]
        videos = {camera.name: self._find(camera, "texture") for camera in virtual}
        return tuple(name for name, video in videos.items() if video is not None and video.frame_count)

    def camera(self, name: str, frame: int = 0) -> Camera:
        """A camera with its pose in a frame; a moving camera has another pose in every frame.

        Raises TmivError for an unknown camera, or a frame for which a moving camera has no pose.
        """
        if name not in self.cameras:
            raise TmivError(f"camera: {name!r}: expected one of {', '.join(self.cameras)}")
        camera, poses = self.cameras[name], self._poses.get(name)
        if poses is None:
            return camera
        if not 0 <= frame < len(poses):
            raise TmivError(f"camera {name}: Poses: no row for frame {frame}: the file has {len(poses)}")
        return dataclasses.replace(camera, pose=poses[frame])

    def poses(self, name: str) -> list[Pose] | None:
        """The poses of a moving camera, one per frame; None for a fixed one."""
        return self._poses.get(name)

    def video(self, name: str, kind: Kind) -> RawVideo:
        """The camera's texture or depth file; raises TmivError if there is none."""
        key = (name, kind)
        if key not in self._videos:
            camera = self.camera(name)
            video = self._find(camera, kind)
            if video is None:
                like = (texture_path if kind == "texture" else depth_path)(self.folder, camera)
                found = "; ".join(look_alikes(self.folder, camera, kind))
                expected = f"expected a file like {like}"
                raise TmivError(f"camera {name}: {kind}: missing: {expected}{f' (found {found})' if found else ''}")
            self._videos[key] = video
        return self._videos[key]

    def texture(self, name: str, frame: int) -> Texture:
        """A texture in 10-bit codes; for a virtual camera the ground truth."""
        return self.video(name, "texture").texture(frame)

    def codes(self, name: str, frame: int) -> npt.NDArray[np.uint16]:  # [h, w]
        """Depth codes, coded as in the camera's `depth`."""
        return self.video(name, "depth").codes(frame)

    def view(self, name: str, frame: int) -> View:
        """One camera's texture and depth codes, with its pose in that frame."""
        return View(self.camera(name, frame), self.texture(name, frame), self.codes(name, frame))

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        """The source views (or the named ones) of one instant."""
        chosen = self.source_names if names is None else tuple(names)
        return Frame(index, tuple(self.view(name, index) for name in chosen))

    def frames(self, start: int = 0, stop: int | None = None, names: Iterable[str] | None = None) -> Iterator[Frame]:
        """The frames [start, stop), in order; `stop` None: to the end."""
        chosen = self.source_names if names is None else tuple(names)
        for index in range(start, self.frame_count if stop is None else stop):
            yield self.frame(index, chosen)

    def _find(self, camera: Camera, kind: Kind) -> RawVideo | None:
        try:
            return find_video(self.folder, camera, kind, self._names)
        except ValueError as error:
            raise TmivError(f"camera {camera.name}: {kind}: {error}") from error

    def _with_file_bits(self, camera: Camera) -> Camera:
        # The file's name decides how its codes are read, even where the JSON differs.
        depth = self._find(camera, "depth")
        if depth is None or depth.format.bits == camera.depth.bits:
            return camera
        return dataclasses.replace(
            camera, depth=dataclasses.replace(camera.depth, bits=depth.format.bits)
        )


def _poses(folder: Path, name: str, file: str) -> list[Pose]:
    try:
        return read_poses(find_path(folder, file))
    except (OSError, ValueError) as error:
        raise TmivError(f"camera {name}: Poses: {error}") from error


def open_sequence(path: Path | str) -> Sequence:
    """Open a folder (or its JSON); raises TmivError with the first problem of the JSON.

    Missing or short video files are noticed when they are read; `tmiv_check` finds all problems at once.
    """
    file = find_json(Path(path))
    description, problems = read_json(file)
    if problems:
        more = f" (and {len(problems) - 1} more problems)" if len(problems) > 1 else ""
        raise TmivError(f"{problems[0]}{more}")
    return Sequence(file.parent, description)


class SequenceWriter:
    """Writes a sequence frame by frame, as a context manager; `open_sequence` reads it back.

    Source cameras are written to the folder, other cameras to its truth/. The JSON is written when the `with` block
    ends without an error; ValueError is raised then if source cameras differ in their number of frames, and at the
    start for a source name that no camera has.
    """

    def __init__(
        self,
        folder: Path | str,
        name: str,
        fps: float,
        cameras: Iterable[Camera],
        source_names: Iterable[str],
        *,
        depth_format: str = "yuv420p16le",
        texture_format: str = "yuv420p10le",
    ) -> None:
        self.folder = Path(folder)
        self.depth_format, self.texture_format = PixelFormat(depth_format), PixelFormat(texture_format)
        bits = self.texture_format.bits
        named = {camera.name: dataclasses.replace(camera, texture_bits=bits) for camera in cameras}
        self._description = Description(name, fps, None, named, tuple(source_names))
        for source in self._description.source_names:
            if source not in named:
                raise ValueError(f"source_names: {source!r}: no camera has this name")
        self._poses: dict[str, list[Pose]] = {}
        self._files: dict[Path, BinaryIO] = {}
        self.folder.mkdir(parents=True, exist_ok=True)

    def write(
        self, camera_name: str, texture: Texture, codes: npt.NDArray[np.uint16], pose: Pose | None = None
    ) -> None:
        """Append a frame of one camera; `pose` is absolute, None: the camera's own (it does not move).

        Raises ValueError for an unknown camera, and for shapes or depth bits that do not fit it.
        """
        camera = self._description.cameras.get(camera_name)
        if camera is None:
            names = ", ".join(self._description.cameras)
            raise ValueError(f"camera: {camera_name!r}: expected one of {names}")
        if camera.depth.bits != self.depth_format.bits:
            raise ValueError(
                f"camera {camera_name}: depth bits: {camera.depth.bits}: expected "
                f"{self.depth_format.bits} ({self.depth_format.name})"
            )
        View(camera, texture, codes)  # checks the shapes
        folder = self.folder if camera_name in self._description.source_names else self.folder / "truth"
        planes = [from_texture(p, self.texture_format.bits) for p in (texture.y, texture.cb, texture.cr)]
        shapes = self.depth_format.plane_shapes(camera.width, camera.height)
        neutral = [np.full(shape, 1 << (self.depth_format.bits - 1)) for shape in shapes[1:]]
        self._append(texture_path(folder, camera, self.texture_format.name), self.texture_format, planes)
        self._append(depth_path(folder, camera, self.depth_format.name), self.depth_format, [codes, *neutral])
        self._poses.setdefault(camera_name, []).append(pose or camera.pose)

    def __enter__(self) -> SequenceWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for file in self._files.values():
            file.close()
        if kind is None:
            self._finish()

    def _append(self, path: Path, pixel_format: PixelFormat, planes: Iterable[npt.NDArray[Any]]) -> None:
        if path not in self._files:
            path.parent.mkdir(exist_ok=True)
            self._files[path] = path.open("wb")
        for plane in islice(planes, 3 if pixel_format.has_chroma else 1):
            self._files[path].write(np.ascontiguousarray(plane, pixel_format.dtype).data)

    def _finish(self) -> None:
        description = self._description
        counts = {name: len(self._poses.get(name, ())) for name in description.source_names}
        if len(set(counts.values())) > 1:
            raise ValueError(f"frames written: {counts!r}: expected as many of every source camera")
        description.frames_number = max(counts.values(), default=0)
        for name, poses in self._poses.items():
            if any(pose != description.cameras[name].pose for pose in poses):
                description.pose_files[name] = f"{name}_poses.csv"
                write_poses(self.folder / f"{name}_poses.csv", poses)
        file = self.folder / f"{self.folder.resolve().name}.json"
        file.write_text(to_json(description) + "\n", "utf-8")
