"""A background model's state: arrays, numbers, strings and tuples of them, from which a model continues bit for bit.

It holds everything of a model that outlives a frame. The state of `exposure.Exposure` is a record of its own: the tones
of the views are an argument of `BackgroundModel.update`. `saved_model` has both, as they are kept in a file.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from ..geometry.mesh import Mesh
from ..geometry.scene_scale import Scene
from ..io.saved_file import VERSION, Scalar
from ..rig.camera import Camera, Equirectangular, Perspective, Pose
from ..rig.depth import DepthCoding
from ..settings import Settings
from ..support.array_types import B1, F32, F64, I32, I64, U8, U16, U64
from .atlas import Atlas
from .light import LightState
from .surface import Surface

__all__ = [
    "VERSION", "CameraState", "CaptureState", "ExposureState", "LateState", "ModelState", "NumberedAtlas",
    "RemainsState", "SceneState", "SurfaceState", "settings_state",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class CameraState:
    """A reference camera: its projection's class name, the projection's fields in order (lens), pose, and coding."""

    name: str
    projection: str
    lens: tuple[float | tuple[float, float], ...]
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]
    coding: tuple[float, float, int, bool]  # near, far, bits, has_invalid
    texture_bits: int

    @classmethod
    def of(cls, camera: Camera) -> CameraState:
        """A camera's state."""
        lens, pose = camera.projection, camera.pose
        return cls(
            camera.name, type(lens).__name__, _values(lens), pose.position, pose.orientation, _values(camera.depth),
            camera.texture_bits,
        )  # fmt: skip

    def camera(self) -> Camera:
        """The camera itself; raises ValueError for an unknown projection."""
        known: dict[str, Any] = {"Perspective": Perspective, "Equirectangular": Equirectangular}
        if self.projection not in known:
            raise ValueError(f"projection: {self.projection!r}: expected one of {', '.join(known)}")
        pose = Pose(self.position, self.orientation)
        return Camera(self.name, known[self.projection](*self.lens), pose, DepthCoding(*self.coding), self.texture_bits)


@dataclass(frozen=True, slots=True)
class SceneState:
    """The fields of `scene_scale.Scene`: origin float64 [3], metres in the world; baseline; depths; depth coding."""

    origin: F64
    baseline: float
    depths: tuple[float, float, float]
    coding: tuple[float, float, int, bool]

    @classmethod
    def of(cls, scene: Scene) -> SceneState:
        """A scene's state."""
        return cls(scene.origin.copy(), scene.baseline, scene.depths, _values(scene.coding))

    def scene(self) -> Scene:
        """The scene itself."""
        return Scene(self.origin.copy(), self.baseline, self.depths, DepthCoding(*self.coding))


@dataclass(frozen=True, slots=True)
class CaptureState:
    """A capture (`capture.Capture`): its number; index of its reference camera, that camera in its pose, and its
    maximum depth image (`maximum_depth.MaximumDepthImage`): planes and flags [h, w], chroma [(h + 1) // 2,
    (w + 1) // 2]; per block, whether updates wait, and the numbers of updates; counters; the rules of comparison; and
    the light, None if it is not followed."""

    capture: int
    index: int
    camera: CameraState
    codes: U16
    y: U16
    cb: U16
    cr: U16
    flags: U8
    fused: U8
    pending: B1
    lone: B1
    counts: I64
    number: int
    turn: int
    edge: int
    refine: bool
    margin_m: float
    margin_disparity: float
    light: LightState | None


@dataclass(frozen=True, slots=True)
class RemainsState:
    """What is left of older captures, or the pictures of a late layer (`capture.Remains`)."""

    capture: int
    index: int
    codes: U16
    y: U16
    cb: U16
    cr: U16
    edge: int
    reach: int
    late: bool


@dataclass(frozen=True, slots=True)
class LateState:
    """What a reference camera (its index) has noted of what stands before its maximum depth image
    (`kernels.background.late_layers.Stood`), and the number of pixels that wait until there are more."""

    index: int
    codes: U16
    turns: U8
    waiting: int


@dataclass(frozen=True, slots=True)
class SurfaceState:
    """A surface (`surface.Surface`) of the S-PBS (static) or the P-PBS."""

    static: bool
    camera: int
    capture: int
    points: F32
    uv: F32
    triangles: I32
    marks: U64
    invalid: U8

    @classmethod
    def of(cls, surface: Surface, static: bool) -> SurfaceState:
        """A surface's state; copies."""
        mesh = surface.mesh
        return cls(
            static, surface.camera, surface.capture, mesh.points.copy(), mesh.uv.copy(), mesh.triangles.copy(),
            surface.marks.copy(), surface.invalid.copy(),
        )  # fmt: skip

    def surface(self, *, late: bool) -> Surface:
        """The surface itself, a late layer or not; copies."""
        mesh = Mesh(self.points.copy(), self.uv.copy(), self.triangles.copy())
        return Surface(mesh, self.marks.copy(), self.invalid.copy(), self.camera, self.capture, late)


@dataclass(frozen=True, slots=True)
class NumberedAtlas:
    """An atlas, with its number among the captures. Atlases never change, so a state shares them with the model."""

    number: int
    atlas: Atlas


@dataclass(frozen=True, slots=True)
class ExposureState:
    """The fields of `exposure.Exposure`: tones float64 [n, 3, 3]; whether it has begun; whose turn it is; the cameras
    and the neighbours of each; pairs int64 [p, 2] of views that are compared, their samples float32 [p, s, 2, 3], and
    the number of samples of each pair, counts int64 [p]."""

    tones: F64
    started: bool
    turn: int
    cameras: tuple[CameraState | None, ...]
    neighbours: tuple[tuple[int, ...], ...]
    pairs: I64
    samples: F32
    counts: I64


@dataclass(frozen=True, slots=True)
class ModelState:
    """The state of a background model (`BackgroundModel.state`, `BackgroundModel.from_state`). It owns its
    arrays, except those of atlases.

    captures, remains: each in the order of their numbers. current: number of each reference camera's current capture.
    surfaces: in the order of the model. tolerances: the fields of `tolerances.Tolerances` by name. first: samples of
    each camera's disparities in the first frame, 1/m. frames: number of frames after the first; rounds: of fusion, by
    camera; moved, moving, unseen, next, waited: see `reference_cameras`, `parts`. geometry: the PBS' version; cast: the
    PBS' version at each camera's last culling rays; looks: see `culling`; changed float32 [n, rows, columns]: see
    `changed_directions`; late: of the cameras that have noted something.
    """

    version: int
    settings: tuple[tuple[str, Scalar], ...]
    scene: SceneState
    cameras: tuple[CameraState, ...]
    captures: tuple[CaptureState, ...]
    remains: tuple[RemainsState, ...]
    atlases: tuple[NumberedAtlas, ...]
    current: tuple[int, ...]
    surfaces: tuple[SurfaceState, ...]
    tolerances: tuple[tuple[str, float], ...]
    first: tuple[F64, ...]
    frames: int
    rounds: tuple[int, ...]
    moved: tuple[int, ...]
    moving: tuple[int, ...]
    unseen: tuple[int, ...]
    next: int
    waited: int
    geometry: int
    cast: tuple[int, ...]
    looks: tuple[int, ...]
    changed: F32
    late: tuple[LateState, ...]

    def check(self) -> None:
        """Raises ValueError for a state of another version."""
        if self.version != VERSION:
            raise ValueError(f"model state: version {self.version!r}: expected {VERSION}")

    def with_settings(self, settings: Settings) -> ModelState:
        """It, to be continued with other settings."""
        return dataclasses.replace(self, settings=settings_state(settings))


def settings_state(settings: Settings) -> tuple[tuple[str, Scalar], ...]:
    """Settings by name."""
    return tuple((field.name, getattr(settings, field.name)) for field in dataclasses.fields(settings))


def _values(record: Any) -> tuple[Any, ...]:
    """A record's values, in the order of its fields."""
    return tuple(getattr(record, field.name) for field in dataclasses.fields(record))
