"""Sequences in TMIV's layout: a folder with a JSON and raw planar files, read on demand."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera, Pose
from ..rig.frame import Frame, Texture, View
from .file_names import find_path
from .pose_trace import CameraPoses, read_camera_poses
from .tmiv_json import Description, TmivError, find_json, read_json
from .tmiv_writer import SequenceWriter
from .video_files import Kind, depth_path, find_video, look_alikes, texture_path
from .yuv import RawVideo

__all__ = [
    "Sequence",
    "SequenceWriter",
    "TmivError",
    "depth_path",
    "find_video",
    "open_sequence",
    "texture_path",
]

_KINDS: tuple[Kind, ...] = ("texture", "depth")
_log = logging.getLogger(__name__)


class Sequence:
    """An opened sequence: a `Recording`. Files are mapped, so a view is read from disk only when it is used.

    `cameras` holds every camera of the JSON, also virtual ones (`viewport`). Frame 0 is the first of the files. moving:
    see `open_sequence`.
    """

    def __init__(self, folder: Path, description: Description, moving: Mapping[str, Path] | None = None) -> None:
        self.folder = folder
        self.name, self.fps = description.name, description.fps
        self.frames_number = description.frames_number
        self._names = tuple(description.cameras)
        self.source_names = description.source_names
        given = {} if moving is None else {name: str(path) for name, path in moving.items()}
        self._pose_files = {**description.pose_files, **given}  # of the JSON below the folder, given ones anywhere
        self._read = {
            name: _poses(
                None if name in given else folder, name, file, self.fps if name in self.source_names else None
            )
            for name, file in self._pose_files.items()
        }
        self._poses = {name: read.poses for name, read in self._read.items()}
        self._videos: dict[tuple[str, Kind], RawVideo] = {}
        self.cameras = {name: self._with_file_bits(camera) for name, camera in description.cameras.items()}

    @property
    def frame_count(self) -> int:
        """The number of frames that all files of the source views hold: whole pictures, and rows of poses.

        Raises TmivError if a file is missing or does not hold a single one.
        """
        videos = self._source_videos()
        for video in videos:
            if not video.frame_count:
                raise TmivError(f"{video.path.name}: {video.extra_bytes} bytes: expected at least {_a_frame(video)}")
        return min([*(video.frame_count for video in videos), *self._rows_of_poses().values()])

    def pictures_of(self, name: str) -> int:
        """The number of whole pictures with depth that a camera's files hold; 0 if one is missing."""
        videos = [self._videos.get((name, kind)) or self._find(self.cameras[name], kind) for kind in _KINDS]
        return min(0 if video is None else video.frame_count for video in videos)

    def left_out(self) -> str:
        """The number of frames that `frame_count` leaves out, and the files that are short, for people; "" if none is.

        Pictures that are cut off count as left out. Raises TmivError as `frame_count` does.
        """
        count, videos = self.frame_count, self._source_videos()
        held = max(video.frame_count + bool(video.extra_bytes) for video in videos)
        short = [
            f"{video.path.name} holds {video.frame_count}"
            + (f" and {video.extra_bytes} bytes of {_a_frame(video)}" if video.extra_bytes else "")
            for video in videos
            if video.frame_count < held
        ]
        short += [f"{file} has {rows} rows" for file, rows in self._rows_of_poses().items() if rows < held]
        return f"{held - count} of {held} frames left out: {'; '.join(short)}" if count < held else ""

    def lost_poses(self) -> list[str]:
        """What is wrong with the poses of moving cameras, one line a camera, for people."""
        return [
            f"camera {name}: Poses: {self._pose_files[name]}: {read.said()}"
            for name, read in self._read.items()
            if read.faults
        ]

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
        """A camera with its pose in a frame; a moving camera has another pose in every frame. If the row of a frame
        holds no pose, it is the one of `pose_trace.CameraPoses`.

        Raises TmivError for an unknown camera, or a frame beyond the rows of a moving camera.
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
        """One camera's texture and depth codes, with its pose in that frame; left out if it has no pose there."""
        fault = self._read[name].faults.get(frame) if name in self._read else None
        return View(self.camera(name, frame), self.texture(name, frame), self.codes(name, frame), fault)

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        """The source views (or the named ones) of one instant."""
        chosen = self.source_names if names is None else tuple(names)
        return Frame(index, tuple(self.view(name, index) for name in chosen))

    def frames(self, start: int = 0, stop: int | None = None, names: Iterable[str] | None = None) -> Iterator[Frame]:
        """The frames [start, stop), in order; `stop` None: to the end."""
        chosen = self.source_names if names is None else tuple(names)
        for index in range(start, self.frame_count if stop is None else stop):
            yield self.frame(index, chosen)

    def _source_videos(self) -> list[RawVideo]:
        return [self.video(name, kind) for name in self.source_names for kind in _KINDS]

    def _rows_of_poses(self) -> dict[str, int]:
        """For each pose file of a source view the number of its rows."""
        files = self._pose_files.items()
        return {file: len(self._poses[name]) for name, file in files if name in self.source_names}

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


def _a_frame(video: RawVideo) -> str:
    return f"{video.frame_bytes}, a frame of {video.width}x{video.height} {video.format.name}"


def _poses(folder: Path | None, name: str, file: str, fps: float | None) -> CameraPoses:
    try:
        return read_camera_poses(file if folder is None else find_path(folder, file), fps)
    except (OSError, ValueError) as error:
        raise TmivError(f"camera {name}: Poses: {error}") from error


def open_sequence(
    path: Path | str, *, growing: bool = False, moving: Mapping[str, Path] | None = None
) -> Sequence:
    """Open a folder (or its JSON); raises TmivError with the first problem of the JSON.

    moving: pose files of cameras that move, by name; they go before those that the JSON names. Raises TmivError for an
    unknown camera, or a file that cannot be read.

    Frames that are left out because a file is short are logged as a warning, unless the files are `growing`. Files that
    are missing or empty are noticed when they are read; `tmiv_check` finds all problems at once.
    """
    file = find_json(Path(path))
    description, problems = read_json(file)
    if problems:
        more = f" (and {len(problems) - 1} more problems)" if len(problems) > 1 else ""
        raise TmivError(f"{problems[0]}{more}")
    for name in moving or {}:
        if name not in description.cameras:
            raise TmivError(f"moving camera: {name!r}: expected one of {', '.join(description.cameras)}")
    sequence = Sequence(file.parent, description, moving)
    with contextlib.suppress(TmivError):
        if not growing and (left_out := sequence.left_out()):
            _log.warning("%s: %s", file.parent, left_out)
    for lost in () if growing else sequence.lost_poses():
        _log.warning("%s: %s", file.parent, lost)
    return sequence
