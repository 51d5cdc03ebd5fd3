"""Recordings to render and judge: those on disk that have ground truth, and twins as recordings in memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..background.model import BackgroundModel
from ..io.file_names import entries
from ..io.recording import Recording, open_recording
from ..io.tmiv_json import TmivError, find_json
from ..rig.camera import Camera, Pose
from ..rig.frame import Frame, Texture, View
from ..synth import FPS, TWINS, Twin, make_twin, render_view, twin_frame
from .background import inside_rig
from .ghosts import ghost_pixels, inside_cameras
from .silhouettes import fine_camera, judge_silhouettes

__all__ = ["TwinRecording", "default_targets", "find_recordings", "is_twin", "open_recording_or_twin"]


@dataclass
class TwinRecording:
    """A twin as a `Recording`: each frame is rendered in memory when it is read."""

    twin: Twin
    fps: float = FPS
    _fine: dict[tuple[str, int], View] = field(default_factory=dict)  # of the latest frame
    _still: dict[str, View] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The twin's name."""
        return self.twin.name

    @property
    def frame_count(self) -> int:
        """The number of frames of the real sequence."""
        return self.twin.rig.frame_count

    @property
    def source_names(self) -> tuple[str, ...]:
        """Names of the reference cameras."""
        return self.twin.source_names

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the reference cameras and of the virtual ones."""
        return tuple(camera.name for camera in self.twin.cameras)

    @property
    def truth_names(self) -> tuple[str, ...]:
        """Names of the virtual cameras for which a twin on disk has ground truth."""
        return self.twin.rig.target_names

    def camera(self, name: str, frame: int = 0) -> Camera:
        """The camera called `name` with its pose in `frame`; raises ValueError for an unknown name."""
        return self.twin.camera(name, frame)

    def poses(self, name: str) -> list[Pose] | None:
        """The poses of a moving camera, one per frame; None for a fixed camera."""
        if name not in self.twin.rig.moving:
            return None
        return [self.camera(name, index).pose for index in range(self.frame_count)]

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        """Frame `index` with the views of the source cameras `names`, by default all."""
        return twin_frame(self.twin, index, None if names is None else tuple(names))

    def frames(self, start: int = 0, stop: int | None = None, names: Iterable[str] | None = None) -> Iterator[Frame]:
        """The frames [start, stop) in order; without `stop`, to the end."""
        chosen = self.source_names if names is None else tuple(names)
        for index in range(start, self.frame_count if stop is None else stop):
            yield self.frame(index, chosen)

    def texture(self, name: str, frame: int) -> Texture:
        """A camera's ground truth."""
        return self.twin.truth(self.camera(name), frame).texture

    def fine(self, name: str, frame: int) -> View:
        """Ground truth with 4x4 pixels in place of one, with one sample each."""
        if (name, frame) not in self._fine:
            self._fine = {key: view for key, view in self._fine.items() if key[1] == frame}
            single = dataclasses.replace(self.twin, samples=1)
            self._fine[name, frame] = single.truth(fine_camera(self.camera(name)), frame)
        return self._fine[name, frame]

    def roughness(self, name: str, frame: int) -> float:
        """Roughness in pixels of the ground truth's own silhouettes: a twin's pictures have four samples per pixel."""
        truth = self.twin.truth(self.camera(name), frame)
        disparity = truth.camera.depth.disparity(truth.codes)
        return judge_silhouettes(self.fine(name, frame), truth.texture, disparity).roughness_px

    def ghosts(self, name: str, frame: int, model: BackgroundModel) -> float:
        """Fraction of pixels where the model shows something that is neither there nor background (`ghosts`)."""
        camera = self.camera(name)
        if name not in self._still:
            self._still[name] = render_view(self.twin.scene, camera, 0.0, samples=1, background_only=True)
        _holes, nearer, nearer_than_now = ghost_pixels(model, self._still[name], self.twin.truth(camera, frame))
        return float(np.mean(nearer & nearer_than_now))


def find_recordings(paths: Sequence[Path]) -> list[Recording]:
    """The recordings in the given folders, each of which is a recording or a folder of recordings.

    Raises ValueError for a folder without any.
    """
    found = list[Recording]()
    for path in paths:
        folders = [path] if _is_sequence(path) else [p for p in entries(path) if p.is_dir() and _is_sequence(p)]
        if not folders:
            raise ValueError(f"{path}: expected a TMIV sequence, or a folder of sequences")
        found += [open_recording(folder) for folder in folders]
    return found


def open_recording_or_twin(name: str, scale: float) -> Recording:
    """The recording in the folder `name`, or the twin called `name` with pictures of size `scale`.

    Raises ValueError if `name` is neither.
    """
    return TwinRecording(make_twin(name, scale)) if is_twin(name) else open_recording(Path(name))


def is_twin(name: str) -> bool:
    """Whether this is a twin's name, not a folder's; raises ValueError if it is neither."""
    if name not in TWINS and not Path(name).is_dir():
        raise ValueError(f"sequence: {name!r}: expected a folder, or a twin: {', '.join(TWINS)}")
    return name in TWINS


def _is_sequence(path: Path) -> bool:
    try:
        find_json(path)
    except TmivError:
        return False
    return True


def default_targets(recording: Recording) -> list[str]:
    """Names of the virtual cameras inside the rig that have ground truth; raises ValueError if there are none."""
    if isinstance(recording, TwinRecording):
        names = [camera.name for camera in inside_cameras(recording.twin)]
    else:
        names = inside_rig(recording)
    if not names:
        raise ValueError(f"{recording.name}: no virtual camera with ground truth stands inside the rig")
    return names
