"""Recordings of one hand-held RGB-D camera: a folder of PNG files with a pose for each frame.

color/NAME.png: pictures; depth/NAME.png: 16 bits, millimetres, registered to colour, 0 where nothing was measured;
pose/NAME.txt: world from camera, 4 x 4, metres, camera axes as in OpenCV (x right, y down, z forward); intrinsics.txt:
3 x 3, pixel centres at whole coordinates. Names are numbers, in the order of the frames.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from ..rig.camera import Camera, Perspective, Pose
from ..rig.depth import DepthCoding
from ..rig.frame import Fault, Frame, Texture, View
from ..rig.pose_watch import not_a_pose
from ..support.array_types import F64
from .file_names import entries
from .pose_trace import CameraPoses, believed_poses
from .text import read_text

__all__ = ["RgbdFolder", "is_rgbd_folder"]

# Farside's camera axes (x forward, y left, z up) in OpenCV's.
_OPENCV_FROM_FARSIDE = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
_DEPTHS = DepthCoding(0.2, math.inf, 16, has_invalid=True)
_CAMERA = "camera"
_log = logging.getLogger(__name__)

K = TypeVar("K", np.uint8, np.uint16)


def is_rgbd_folder(path: Path | str) -> bool:
    """Whether a folder has the parts of such a recording."""
    folder = Path(path)
    return (folder / "intrinsics.txt").is_file() and all((folder / part).is_dir() for part in ("color", "pose"))


class RgbdFolder:
    """A `Recording` of one camera that moves. The world's axes are those of the camera in its first frame.

    fps: frames per second, as the files do not tell. The view is left out of frames whose pose is not finite or jumps
    (`pose_trace.believed_poses`), or whose pictures are damaged. Raises ValueError, which names the file, for another
    file that is missing or does not hold what is expected.
    """

    camera_names = source_names = (_CAMERA,)
    truth_names: tuple[str, ...] = ()

    def __init__(self, folder: Path | str, fps: float = 30.0) -> None:
        self.folder, self.fps = Path(folder), fps
        self.name = self.folder.resolve().name
        stems = [path.stem for path in entries(self.folder / "color") if path.suffix == ".png"]
        self._stems = sorted(stems, key=lambda stem: (len(stem.lstrip("0")), stem.lstrip("0")))
        if not self._stems:
            raise ValueError(f"{self.folder / 'color'}: 0 pictures: expected NAME.png for each frame")
        found = [self._world_from_camera(stem) for stem in self._stems]
        first = next((np.linalg.inv(each) for each in found if not isinstance(each, Fault)), np.eye(4))
        poses = [each if isinstance(each, Fault) else Pose.from_matrix(first @ each) for each in found]
        try:
            self._poses, self._faults = believed_poses(poses, fps)
        except ValueError as error:
            raise ValueError(f"{self.folder / 'pose'}: {error}") from error
        if self._faults:
            _log.warning("%s: %s", self.folder / "pose", CameraPoses(self._poses, self._faults).said())

    @property
    def frame_count(self) -> int:
        """The number of pictures."""
        return len(self._stems)

    def camera(self, name: str, frame: int = 0) -> Camera:
        """The camera with its pose in a frame; raises ValueError for another camera or a frame that is not there."""
        if name != _CAMERA:
            raise ValueError(f"camera: {name!r}: expected {_CAMERA}")
        return Camera(_CAMERA, self._lens, self._poses[self._checked(frame)], _DEPTHS)

    def poses(self, name: str) -> list[Pose] | None:
        """The poses of the camera, one per frame."""
        self.camera(name)
        return list(self._poses)

    def texture(self, name: str, frame: int) -> Texture:
        """The camera's picture in 10-bit codes."""
        from ..rig.texture import from_rgb  # late, as it loads the compiler, which a list of contents does not need

        self.camera(name, frame)
        path = self.folder / "color" / f"{self._stems[frame]}.png"
        return from_rgb(self._picture(path, "RGB", np.uint8))

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        """The view of one instant."""
        return Frame(index, tuple(self._view(name, index) for name in names or self.source_names))

    def frames(self, start: int = 0, stop: int | None = None, names: Iterable[str] | None = None) -> Iterator[Frame]:
        """The frames [start, stop), in order; `stop` None: to the end."""
        chosen = None if names is None else tuple(names)
        for index in range(start, self.frame_count if stop is None else stop):
            yield self.frame(index, chosen)

    def _view(self, name: str, index: int) -> View:
        camera = self.camera(name, index)
        path = self.folder / "depth" / f"{self._stems[index]}.png"
        if index in self._faults:
            return View.blank(camera, self._faults[index])
        try:
            millimetres = self._picture(path, "I;16", np.uint16)
        except ValueError as error:
            return View.blank(camera, Fault("depth", str(error)))
        with np.errstate(divide="ignore"):
            codes = camera.depth.codes(np.where(millimetres > 0, millimetres / 1000.0, np.nan))
        try:
            return View(camera, self.texture(name, index), codes)
        except ValueError as error:
            return View.blank(camera, Fault("texture", str(error)))

    def _checked(self, index: int) -> int:
        if not 0 <= index < len(self._stems):
            raise ValueError(f"frame: {index!r}: expected 0 to {len(self._stems) - 1}")
        return index

    @cached_property
    def _size(self) -> tuple[int, int]:
        """Width and height of the first picture, pixels."""
        path = self.folder / "color" / f"{self._stems[0]}.png"
        try:
            with Image.open(path) as image:
                return image.size
        except (OSError, UnidentifiedImageError) as error:
            raise ValueError(f"{path}: {error}: expected a PNG picture") from error

    @cached_property
    def _lens(self) -> Perspective:
        k = _numbers(self.folder / "intrinsics.txt", (3, 3))
        width, height = self._size
        return Perspective(width, height, float(k[0, 0]), float(k[1, 1]), float(k[0, 2]) + 0.5, float(k[1, 2]) + 0.5)

    def _world_from_camera(self, stem: str) -> F64 | Fault:  # [4, 4]
        path = self.folder / "pose" / f"{stem}.txt"
        found = _numbers(path, (4, 4), gaps=True)
        if not np.isfinite(found).all():
            return not_a_pose(f"{path.name}: {found.ravel().tolist()}")
        matrix: F64 = found @ _OPENCV_FROM_FARSIDE
        try:
            Pose.from_matrix(matrix)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error
        return matrix

    def _picture(self, path: Path, mode: str, kind: type[K]) -> npt.NDArray[K]:
        """A picture's pixels; ValueError if it is not there or has another size."""
        try:
            with Image.open(path) as image:
                found, size = np.asarray(image.convert(mode) if mode == "RGB" else image), image.size
        except (OSError, UnidentifiedImageError) as error:
            raise ValueError(f"{path}: {error}: expected a PNG picture") from error
        if size != self._size or found.ndim != (3 if mode == "RGB" else 2):
            (width, height), expected = size, "x".join(map(str, self._size))
            raise ValueError(f"{path}: {width}x{height} {found.dtype}: expected {expected} {mode}")
        return found.astype(kind)


def _numbers(path: Path, shape: tuple[int, int], *, gaps: bool = False) -> F64:
    """A matrix in a text file; ValueError if it has another shape or holds anything else. With `gaps`, numbers need not
    be finite."""
    try:
        lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
        found = np.array([[float(cell) for cell in line] for line in lines])
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}: expected {shape[0]} x {shape[1]} numbers") from error
    if found.shape != shape or not (gaps or np.isfinite(found).all()):
        raise ValueError(f"{path}: numbers {found.shape}: expected {shape[0]} x {shape[1]} that are finite")
    return found
