"""A recording: the views of a rig of cameras, frame by frame. Replay, rendering, export and the benchmarks read it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Protocol

from ..rig.camera import Camera, Pose
from ..rig.frame import Frame, Texture
from .rgbd_folder import RgbdFolder, is_rgbd_folder
from .tmiv import open_sequence

__all__ = ["Playhead", "Recording", "ToAndFro", "open_recording", "playback_index"]


class Recording(Protocol):
    """Multiview video plus depth with calibrated cameras; it may also hold ground truth of virtual cameras.

    There are two ways to read it: `frame` at any index, and `frames` in order. An implementation that cannot seek
    (compressed video) is fast at the second and may be slow at the first. Frame 0 is the first. An index outside
    0 .. frame_count - 1 and an unknown camera raise ValueError.
    """

    @property
    def name(self) -> str:
        """The name for people."""

    @property
    def fps(self) -> float:
        """Frames per second (the paper's f_vin)."""

    @property
    def frame_count(self) -> int:
        """The number of frames that every source view has."""

    @property
    def source_names(self) -> tuple[str, ...]:
        """The reference cameras, in the order of the views of a frame."""

    @property
    def camera_names(self) -> tuple[str, ...]:
        """All cameras: the reference cameras, and the virtual ones, which are never an input."""

    @property
    def truth_names(self) -> tuple[str, ...]:
        """The virtual cameras for which `texture` returns ground truth."""

    def camera(self, name: str, frame: int = 0) -> Camera:
        """A camera with its pose in a frame."""

    def poses(self, name: str) -> list[Pose] | None:
        """The poses of a moving camera, one per frame; None for a fixed one."""

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        """The reference views of one instant: all, or those in `names`, in that order."""

    def frames(self, start: int = 0, stop: int | None = None, names: Iterable[str] | None = None) -> Iterator[Frame]:
        """The frames [start, stop) in order, each as `frame` returns it; `stop` None: to the end.

        A frame is read when the iterator reaches it.
        """

    def texture(self, name: str, frame: int) -> Texture:
        """A camera's picture in 10-bit codes; for a virtual camera the ground truth."""


class Playhead:
    """Reads a recording at any index; as long as indices rise by one, it reads in order (`Recording.frames`)."""

    def __init__(self, recording: Recording, names: Iterable[str] | None = None) -> None:
        self._recording = recording
        self._names = recording.source_names if names is None else tuple(names)
        self._next = 0
        self._coming: Iterator[Frame] | None = None  # frames from `_next` on; None: not begun yet

    def frame(self, index: int) -> Frame:
        """The views of a frame; raises ValueError outside the recording."""
        if index < self._next:  # backwards, or the same frame again: a single frame, not the start of a run
            self._next, self._coming = index + 1, None
            return self._recording.frame(index, self._names)
        if self._coming is None or index > self._next:
            self._coming = self._recording.frames(index, None, self._names)
        frame = next(self._coming, None)
        if frame is None:
            raise ValueError(f"frame: {index!r}: expected 0 to {self._recording.frame_count - 1}")
        self._next = index + 1
        return frame


def playback_index(index: int, count: int) -> int:
    """The input frame for output frame `index` when `count` input frames are played to and fro: 0 1 1 0 0 1 ...

    Raises ValueError for a negative index or a count below 1.
    """
    if count < 1 or index < 0:
        raise ValueError(f"frame: {index!r} of {count!r}: expected a frame of at least one")
    turn = index % (2 * count)
    return turn if turn < count else 2 * count - 1 - turn


class ToAndFro:
    """Plays a recording to and fro, as `playback_index`, also while it grows: then it goes on where it is."""

    def __init__(self) -> None:
        self._number, self._index, self._step = 0, 0, 1

    def index(self, number: int, count: int) -> int:
        """The input frame for output frame `number`, which never falls, when there are `count` input frames."""
        for _ in range((number - self._number) % (2 * count)):  # after 2 * count frames it is where it was
            if 0 <= self._index + self._step < count:
                self._index += self._step
            else:
                self._step = -self._step
        self._number = number
        return self._index


def open_recording(path: Path | str, moving: Mapping[str, Path] | None = None) -> Recording:
    """Open a recording in any known format: TMIV's, a folder with a JSON, or that JSON; or a folder of pictures of one
    hand-held RGB-D camera (`rgbd_folder`).

    moving: pose files (`pose_trace.read_poses`) of cameras that move, by name; they go before those that the JSON
    names. Raises ValueError (TmivError) with the first problem.
    """
    if is_rgbd_folder(path):
        if moving:
            raise ValueError(f"moving camera: {next(iter(moving))!r}: expected none: {path} has its camera's poses")
        return RgbdFolder(path)
    return open_sequence(path, moving=moving)
