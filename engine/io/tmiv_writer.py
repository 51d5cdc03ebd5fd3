"""Writing sequences in TMIV's layout, frame by frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera, Pose
from ..rig.frame import Texture, View
from .pose_trace import write_poses
from .raw_writer import RawWriter
from .tmiv_json import Description, to_json
from .video_files import depth_path, texture_path
from .yuv import PixelFormat, from_texture

__all__ = ["SequenceWriter"]


class SequenceWriter:
    """Writes a sequence frame by frame, as a context manager; `open_sequence` reads it back.

    Source cameras are written to the folder, other cameras to its truth/. The JSON is written when the `with` block
    ends without an error, and also at its start if the `frame_count` to come is given: then the frames so far can be
    read meanwhile. It is called `json_name`.json, by default as the folder. ValueError is raised at the end if source
    cameras differ in their number of frames, and at the start for a source name that no camera has.
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
        json_name: str | None = None,
        frame_count: int | None = None,
    ) -> None:
        self.folder = Path(folder)
        self.json_name = self.folder.resolve().name if json_name is None else json_name
        self.depth_format, self.texture_format = PixelFormat(depth_format), PixelFormat(texture_format)
        bits = self.texture_format.bits
        named = {camera.name: dataclasses.replace(camera, texture_bits=bits) for camera in cameras}
        self._description = Description(name, fps, None, named, tuple(source_names))
        for source in self._description.source_names:
            if source not in named:
                raise ValueError(f"source_names: {source!r}: no camera has this name")
        self._poses: dict[str, list[Pose]] = {}
        self._videos = RawWriter()
        self.folder.mkdir(parents=True, exist_ok=True)
        if frame_count is not None:
            self._description.frames_number = frame_count
            self._describe()

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
        self._videos.close()
        if kind is None:
            self._finish()

    def _append(self, path: Path, pixel_format: PixelFormat, planes: Iterable[npt.NDArray[Any]]) -> None:
        stored = islice(planes, 3 if pixel_format.has_chroma else 1)
        self._videos.append(path, [plane.astype(pixel_format.dtype, copy=False) for plane in stored])

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
        self._describe()

    def _describe(self) -> None:
        file = self.folder / f"{self.json_name}.json"
        file.write_text(to_json(self._description) + "\n", "utf-8")
