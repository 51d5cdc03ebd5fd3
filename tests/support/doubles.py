"""A deterministic core: flat pictures that tell the frame and the pose, updates that wait to be released."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from farside.engine.io.mesh_files import ColouredMesh
from farside.engine.live.engine import Source
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings

__all__ = ["CAMERAS", "FakeCore", "a_frame", "a_view", "flat"]

HANG_S = 20.0  # only a deadlock takes this long
CODING = DepthCoding(0.5, 10.0)
CAMERAS = tuple(
    Camera(name, Perspective(24, 16, 20.0, 20.0, 12.0, 8.0), Pose((0.0, 0.1 * i, 1.5)), CODING)
    for i, name in enumerate(("v0", "v1"))
)


def flat(width: int, height: int, luma: int) -> Texture:
    """A grey picture."""
    chroma = ((height + 1) // 2, (width + 1) // 2)
    return Texture(
        np.full((height, width), luma, np.uint16), *(np.full(chroma, 512, np.uint16) for _ in range(2))
    )


def a_view(camera: Camera, luma: int = 300) -> View:
    """A grey wall."""
    shape = camera.height, camera.width
    return View(camera, flat(camera.width, camera.height, luma), np.full(shape, 20000, np.uint16))


def a_frame(index: int, cameras: tuple[Camera, ...] = CAMERAS) -> Frame:
    """A frame of grey walls."""
    return Frame(index, tuple(a_view(camera) for camera in cameras))


@dataclass
class Report:
    stages: dict[str, float]


@dataclass
class Eye:
    texture: Texture


@dataclass
class StereoPair:
    left: Eye
    right: Eye
    frame_index: int
    stages: dict[str, float] = field(default_factory=lambda: {"warp": 1.0})
    holes: float = 0.25


@dataclass
class Gate:
    """Holds threads up until opened; opened unless closed."""

    _open: threading.Event = field(default_factory=threading.Event)
    entered: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self._open.set()

    def close(self) -> None:
        self._open.clear()
        self.entered.clear()

    def open(self) -> None:
        self._open.set()

    def pass_through(self) -> None:
        self.entered.set()
        assert self._open.wait(HANG_S), "nobody opened the gate"


@dataclass
class FakeCore:
    """The live engine's view of a core, with faults and delays on demand."""

    source: Source
    f_vin: float = 0.0
    updates: list[int] = field(default_factory=list)
    viewers: Mapping[str, StereoView] = field(default_factory=dict)
    speeds: Mapping[str, float] = field(default_factory=dict)
    rendered: list[StereoView] = field(default_factory=list)
    bad_frames: set[int] = field(default_factory=set)
    fail_render: bool = False
    settings: Settings | None = None
    closed: bool = False
    updating: Gate = field(default_factory=Gate)
    rendering: Gate = field(default_factory=Gate)

    def update(self, frame: Frame, viewers: Mapping[str, StereoView], speeds: Mapping[str, float]) -> Report:
        self.updating.pass_through()
        if frame.index in self.bad_frames:
            raise ValueError(f"frame: {frame.index}: expected a better one")
        self.updates.append(frame.index)
        self.viewers, self.speeds = viewers, speeds
        return Report({"background": 1.0})

    def render(self, view: StereoView, viewer: str | None = None) -> StereoPair:
        self.rendering.pass_through()
        if self.fail_render:
            raise RuntimeError("the renderer broke")
        self.rendered.append(view)
        luma = 64 + 8 * self.updates[-1]
        left, right = (Eye(flat(eye.width, eye.height, luma)) for eye in (view.left, view.right))
        return StereoPair(left, right, self.updates[-1])

    def retune(self, settings: Settings) -> None:
        self.settings = settings

    def mesh(self) -> ColouredMesh:
        vertices = np.array([[1.0, 0, 0], [1, 1, 0], [1, 0, 1]])
        return ColouredMesh(vertices, np.array([[0, 1, 2]], np.int32), np.full((3, 3), 128, np.uint8))

    def status(self) -> dict[str, Any]:
        return {"frame_index": self.updates[-1]}

    def close(self) -> None:
        self.closed = True
