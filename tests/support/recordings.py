"""Recordings that are not files: one in memory, and one that has nothing but the protocol's names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from farside.engine.io.recording import Recording
from farside.engine.rig.camera import Camera, Pose
from farside.engine.rig.frame import Frame, Texture

__all__ = ["NAMES", "Bare", "MemoryRecording"]

NAMES = {name for name in vars(Recording) if not name.startswith("_")}


class MemoryRecording:
    """Frames in a list, truth in a dictionary; records in which order it is read."""

    name, fps = "in memory", 20.0

    def __init__(
        self, frames: Sequence[Frame], virtual: Sequence[Camera] = (), truth: dict[str, list[Texture]] | None = None
    ) -> None:
        self._frames, self._virtual, self._truth = frames, virtual, truth or {}
        self.sought: list[int] = []  # indices read by `frame`
        self.played: list[int] = []  # and by `frames`
        self.frame_count = len(frames)
        self.source_names = tuple(view.camera.name for view in frames[0].views)
        self.camera_names = (*self.source_names, *(camera.name for camera in virtual))
        self.truth_names = tuple(self._truth)

    def camera(self, name: str, frame: int = 0) -> Camera:
        cameras = (*(view.camera for view in self._frames[frame].views), *self._virtual)
        found = next((camera for camera in cameras if camera.name == name), None)
        if found is None:
            raise ValueError(f"camera: {name!r}: expected one of {', '.join(self.camera_names)}")
        return found

    def poses(self, name: str) -> list[Pose] | None:
        return None

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        self.sought.append(index)
        return self._named(index, names)

    def frames(self, start: int = 0, stop: int | None = None, names: Iterable[str] | None = None) -> Iterator[Frame]:
        for index in range(start, self.frame_count if stop is None else stop):
            self.played.append(index)
            yield self._named(index, names)

    def texture(self, name: str, frame: int) -> Texture:
        return self._truth[name][frame]

    def _named(self, index: int, names: Iterable[str] | None) -> Frame:
        if not 0 <= index < self.frame_count:
            raise ValueError(f"frame: {index!r}: expected 0 to {self.frame_count - 1}")
        views = {view.camera.name: view for view in self._frames[index].views}
        return Frame(index, tuple(views[name] for name in (self.source_names if names is None else names)))


class Bare:
    """A wrapper of a recording that only has the names of the protocol."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording

    def __getattr__(self, name: str) -> Any:
        if name not in NAMES:
            raise AssertionError(f"{name}: is not among the names of a Recording")
        return getattr(self._recording, name)
