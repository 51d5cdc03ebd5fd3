"""A deterministic core: flat pictures from which frame and pose can be read, updates that wait to be released."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from farside.engine.io.coloured_meshes import ColouredMesh, TexturedMesh, TexturedPart, TexturePage
from farside.engine.io.images import encode_picture, encode_rgb_jpeg
from farside.engine.io.mesh_files import colours_of, to_file
from farside.engine.live.core import Look, Source, Updated
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.effects import Effect, Projector
from farside.engine.rig.frame import Fault, Frame, Texture, View
from farside.engine.rig.viewer import EncodedPair, PairReport, StereoView
from farside.engine.settings import Settings
from farside.engine.support.runtime import give_way

__all__ = ["CAMERAS", "Cores", "FakeCore", "Gate", "a_frame", "a_view", "flat"]

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
class Gate:
    """Makes threads wait while it is closed; it is open at first."""

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
    """A core (`live.core.Core`) with faults and delays on demand."""

    source: Source
    f_vin: float = 0.0
    updates: list[int] = field(default_factory=list)
    look: Look = dict
    speeds: Mapping[str, float] = field(default_factory=dict)
    rendered: list[StereoView] = field(default_factory=list)
    bad_frames: set[int] = field(default_factory=set)
    dark: dict[int, dict[str, Fault]] = field(default_factory=dict)  # views that show nothing, by frame
    fail_render: bool = False
    settings: Settings | None = None
    effects: dict[str, tuple[Effect, Any]] = field(default_factory=dict)
    closed: bool = False
    updating: Gate = field(default_factory=Gate)
    rendering: Gate = field(default_factory=Gate)

    def give_way(self, niceness: int) -> None:
        give_way(niceness)

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        self.updating.pass_through()
        if frame.index in self.bad_frames:
            raise ValueError(f"frame: {frame.index}: expected a better one")
        left_out = frame.faults | self.dark.get(frame.index, {})
        shown = len(left_out) < len(frame.views)
        if shown:
            self.updates.append(frame.index)
        self.look, self.speeds, self.f_vin = look, speeds, f_vin
        return Updated({"background": 1.0, "total": 2.0}, {"frame_index": frame.index}, left_out, shown)

    def picture(self, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        self.rendering.pass_through()
        if self.fail_render:
            raise RuntimeError("the renderer broke")
        self.rendered.append(view)
        left, right = (encode_picture(texture, encoding) for texture in self.paint(view))
        report = PairReport(self.updates[-1], view.left.width, view.left.height, 0.25, {"warp": 1.0}, 1.0, 2.0)
        return EncodedPair(left, right, report)

    def paint(self, view: StereoView) -> tuple[Texture, Texture]:
        """Both eyes' pictures."""
        luma = 64 + 8 * self.updates[-1]
        return flat(view.left.width, view.left.height, luma), flat(view.right.width, view.right.height, luma)

    def continues(self, cameras: Sequence[Camera]) -> bool:
        return False

    def begin_model(self) -> None:
        pass

    def put_effect(self, name: str, effect: Effect, content: Any = None) -> None:
        if isinstance(effect, Projector) and effect.camera not in ("", *(c.name for c in self.source.cameras)):
            raise ValueError(f"camera: {effect.camera!r}: expected another one")
        self.effects[name] = effect, self.effects[name][1] if content is None and name in self.effects else content

    def remove_effect(self, name: str) -> None:
        self.effects.pop(name, None)

    def retune(self, settings: Settings) -> None:
        self.settings = settings

    def mesh(self, file_format: str, colours: str | None = None) -> bytes:
        vertices, triangles = np.array([[1.0, 0, 0], [1, 1, 0], [1, 0, 1]]), np.array([[0, 1, 2]], np.int32)
        if colours_of(file_format, colours) == "vertex":
            return to_file(ColouredMesh(vertices, triangles, np.full((3, 3), 0.5, np.float32)), file_format)
        page = TexturePage(encode_rgb_jpeg(np.full((8, 8, 3), 128, np.uint8), 90), 8, 8)
        part = TexturedPart(vertices, triangles, np.array([[1, 1], [7, 1], [1, 7]], np.float32), page)
        return to_file(TexturedMesh((part,)), file_format)

    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        return {"free": np.ones(len(arguments["origins"]), bool)}

    def close(self) -> None:
        self.closed = True


class Cores:
    """Makes cores for sources, and remembers them."""

    def __init__(self, kind: Callable[[Source], FakeCore] = FakeCore) -> None:
        self._kind = kind
        self.made: list[FakeCore] = []

    def __call__(self, source: Source) -> FakeCore:
        self.made.append(self._kind(source))
        return self.made[-1]
