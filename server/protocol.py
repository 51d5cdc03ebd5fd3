"""The wire protocol: messages, their checks, encoding to msgpack and decoding. No I/O; PROTOCOL.md describes it.

A message is one msgpack map in one binary WebSocket message; its `type` names it. Unknown fields are
ignored, so that a version can gain fields; what both sides must know is a feature (`Features`). Every error raises
`ProtocolError`, which names field, value and expectation and carries the code with which the connection is closed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self, TypeVar, overload

import msgpack
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding

from .effect_messages import EffectRemoval, EffectUpdate
from .fields import CloseCode, ProtocolError, Quaternion, Reader, Vector
from .unpack import unpack

__all__ = [
    "EFFECTS",
    "MAX_CONTROL_BYTES",
    "MAX_HELLO_BYTES",
    "MAX_MESSAGE_BYTES",
    "MISSING_VIEWS",
    "VERSION",
    "BufferFree",
    "CloseCode",
    "DepthData",
    "EffectRemoval",
    "EffectUpdate",
    "Error",
    "Features",
    "FrameDone",
    "Message",
    "Picture",
    "PoseUpdate",
    "ProtocolError",
    "Scene",
    "SharedMemory",
    "SourceHello",
    "Stereo",
    "Tangents",
    "ViewData",
    "ViewerHello",
    "Welcome",
    "agreed",
    "decode",
    "encode",
    "pose_from_wire",
    "pose_to_wire",
    "vector_from_wire",
]

VERSION = 2
MAX_MESSAGE_BYTES = 64 << 20  # a raw view of 2048x2048 takes 21 MB
MAX_CONTROL_BYTES = 64 << 10  # everything a viewer sends
_LARGE = 1 << 20  # bytes
MAX_CAMERAS = 256
MAX_HELLO_BYTES = 512 * MAX_CAMERAS  # a source's: a camera takes some 270 bytes, and up to 100 more for its name
MAX_EYE_PX = 4096
MAX_VIEW_PX = 8192
MAX_BUFFERS = 100
MAX_COUNT = 1 << 53  # the largest count that a double, and therefore JavaScript, holds exactly

AXES = ("omaf", "openxr")
PICTURE_PLANES = {"jpeg": 1, "raw": 3}
DEPTH_ENCODINGS = ("raw", "zlib")
OUTCOMES = ("updated", "dropped")
MAX_FEATURES = 64
MISSING_VIEWS = "missing_views"  # a source says which cameras have no picture in a frame
EFFECTS = "effects"  # a viewer adds, moves and removes 3D effects
QUERIES = "queries"  # the server answers POST /query
FEATURES: dict[str, tuple[str, ...]] = {  # of this program, by role
    "source": (MISSING_VIEWS, QUERIES), "viewer": (EFFECTS, QUERIES)
}  # fmt: skip

Tangents = tuple[float, float, float, float]  # left, right, top, bottom; positive outwards


@dataclass(frozen=True, slots=True)
class Picture:
    """A texture on the wire: one JPEG, or the planes Y, Cb, Cr of 10-bit codes as uint16 little-endian."""

    encoding: str
    planes: tuple[bytes | memoryview, ...] = field(repr=False)

    def _fields(self) -> dict[str, Any]:
        return {"encoding": self.encoding, "planes": self.planes}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        encoding = reader.choice("encoding", PICTURE_PLANES)
        count = PICTURE_PLANES[encoding]
        planes = reader.items("planes", count, count)
        if not all(isinstance(plane, bytes | memoryview) for plane in planes):
            raise reader.fail(
                "planes", [type(p).__name__ for p in planes], "binary data", CloseCode.MALFORMED
            )
        return cls(encoding, tuple(planes))


@dataclass(frozen=True, slots=True)
class DepthData:
    """Depth codes on the wire: uint16 little-endian rows (raw), or deflated differences along the rows (zlib)."""

    encoding: str
    data: bytes | memoryview = field(repr=False)

    def _fields(self) -> dict[str, Any]:
        return {"encoding": self.encoding, "data": self.data}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        return cls(reader.choice("encoding", DEPTH_ENCODINGS), reader.data("data"))


def _camera_fields(camera: Camera) -> dict[str, Any]:
    p = camera.projection
    projection: dict[str, Any]
    if isinstance(p, Perspective):
        projection = {"kind": "perspective", "focal": [p.fx, p.fy], "centre": [p.cx, p.cy]}
    else:
        projection = {"kind": "equirectangular", "hor_range": p.hor_range, "ver_range": p.ver_range}
    depth = camera.depth
    return {
        "name": camera.name,
        "width": p.width,
        "height": p.height,
        "projection": projection,
        "position": camera.pose.position,
        "orientation": camera.pose.orientation,
        "depth": {"near": depth.near, "far": depth.far, "bits": depth.bits, "has_invalid": depth.has_invalid},
        "texture_bits": camera.texture_bits,
    }


def _read_depth_coding(reader: Reader) -> DepthCoding:
    near, far = reader.number("near", 0.0), reader.number("far", 0.0, math.inf)
    bits, has_invalid = reader.integer("bits", 1, 16), reader.flag("has_invalid")
    try:
        return DepthCoding(near, far, bits, has_invalid)
    except ValueError as error:
        expected = str(error).split("expected ", 1)[1]
        raise reader.fail("near", near, f"{expected} (far is {far:g})") from error


def _read_projection(reader: Reader, width: int, height: int) -> Perspective | Equirectangular:
    try:
        if reader.choice("kind", ("perspective", "equirectangular")) == "perspective":
            (fx, fy), (cx, cy) = reader.numbers("focal", 2), reader.numbers("centre", 2)
            return Perspective(width, height, fx, fy, cx, cy)
        (h0, h1), (v0, v1) = reader.numbers("hor_range", 2), reader.numbers("ver_range", 2)
        return Equirectangular(width, height, (h0, h1), (v0, v1))
    except ProtocolError:
        raise
    except ValueError as error:
        name, value, expected = str(error).split(": ", 2)
        raise reader.fail(name, value, expected.removeprefix("expected ")) from error


def _read_camera(reader: Reader) -> Camera:
    width, height = reader.integer("width", 1, MAX_VIEW_PX), reader.integer("height", 1, MAX_VIEW_PX)
    return Camera(
        reader.label("name", 100),
        _read_projection(reader.child("projection"), width, height),
        Pose(reader.vector("position"), reader.quaternion("orientation")),
        _read_depth_coding(reader.child("depth")),
        reader.integer("texture_bits", 8, 16),
    )


def _read_cameras(reader: Reader) -> tuple[Camera, ...]:
    cameras = tuple(_read_camera(child) for child in reader.children("cameras", 1, MAX_CAMERAS))
    names = [camera.name for camera in cameras]
    for name in names:
        if names.count(name) > 1:
            raise reader.fail("cameras", name, "different names of all cameras")
    return cameras


def _read_version(reader: Reader) -> None:
    version = reader.integer("version", 0, MAX_COUNT)
    if version != VERSION:
        raise reader.fail("version", version, str(VERSION), CloseCode.VERSION)


@dataclass(frozen=True, slots=True)
class Features:
    """What a client can do beyond the protocol's core: optional names, and required ones, without which it cannot go
    on."""

    optional: tuple[str, ...] = ()
    required: tuple[str, ...] = ()

    def _fields(self) -> dict[str, Any]:
        return {"optional": self.optional, "required": self.required}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        optional, required = (
            reader.texts(name, MAX_FEATURES) if reader.has(name) else () for name in ("optional", "required")
        )
        return cls(optional, required)


def agreed(features: Features, role: str) -> tuple[str, ...]:
    """The features of a client in a role that this program has too; ProtocolError for a required one that it lacks."""
    known = FEATURES[role]
    for name in features.required:
        if name not in known:
            expected = f"one of {', '.join(known)}" if known else "none"
            raise ProtocolError(CloseCode.FEATURE, "features.required", name, expected)
    return tuple(name for name in known if name in features.optional or name in features.required)


def _read_features(reader: Reader) -> Features:
    return Features._read(reader.child("features")) if reader.has("features") else Features()


@dataclass(frozen=True, slots=True)
class ViewerHello:
    """A viewer introduces itself: its axes, its eyes' pictures and fields of view, and the encoding of pictures."""

    TYPE: ClassVar[str] = "hello"
    ROLE: ClassVar[str] = "viewer"
    width: int  # of an eye, pixels
    height: int
    left: Tangents
    right: Tangents
    ipd: float = 0.063  # metres
    axes: str = "omaf"
    encoding: str = "jpeg"
    token: str = ""
    features: Features = Features()

    @classmethod
    def symmetric(cls, width: int, height: int, fov_rad: float, **others: Any) -> Self:
        """The hello of two equal eyes with square pixels and the horizontal field of view `fov_rad`, radians."""
        horizontal = math.tan(fov_rad / 2)
        vertical = horizontal * height / width
        eye = (horizontal, horizontal, vertical, vertical)
        return cls(width, height, eye, eye, **others)

    def _fields(self) -> dict[str, Any]:
        return {
            "version": VERSION,
            "role": self.ROLE,
            "token": self.token,
            "axes": self.axes,
            "encoding": self.encoding,
            "width": self.width,
            "height": self.height,
            "tangents": [self.left, self.right],
            "ipd": self.ipd,
            "features": self.features._fields(),
        }

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        width, height = reader.integer("width", 16, MAX_EYE_PX), reader.integer("height", 16, MAX_EYE_PX)
        others: dict[str, Any] = {
            "ipd": reader.number("ipd", 0.0, 1.0),
            "axes": reader.choice("axes", AXES),
            "encoding": reader.choice("encoding", PICTURE_PLANES),
            "token": reader.text("token") if reader.has("token") else "",
            "features": _read_features(reader),
        }
        if not reader.has("tangents"):
            return cls.symmetric(width, height, reader.number("fov", 0.01, 3.1), **others)
        left, right = (_read_tangents(reader, eye) for eye in reader.items("tangents", 2, 2))
        return cls(width, height, left, right, **others)


def _read_tangents(reader: Reader, eye: object) -> Tangents:
    left, right, top, bottom = Reader({"tangents": eye}).numbers("tangents", 4)
    if not (left + right > 1e-3 and top + bottom > 1e-3 and max(map(abs, (left, right, top, bottom))) < 100):
        expected = "left + right > 0, top + bottom > 0, each below 100"
        raise reader.fail("tangents", [left, right, top, bottom], expected)
    return left, right, top, bottom


@dataclass(frozen=True, slots=True)
class SourceHello:
    """A source introduces itself: its frame rate and every camera (OMAF axes)."""

    TYPE: ClassVar[str] = "hello"
    ROLE: ClassVar[str] = "source"
    name: str
    fps: float
    cameras: tuple[Camera, ...]
    token: str = ""
    shares: bool = False  # whether it can write into the memory of a server on the same machine
    features: Features = Features()

    def _fields(self) -> dict[str, Any]:
        return {
            "version": VERSION,
            "role": self.ROLE,
            "token": self.token,
            "name": self.name,
            "fps": self.fps,
            "cameras": [_camera_fields(camera) for camera in self.cameras],
            "shares": self.shares,
            "features": self.features._fields(),
        }

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        return cls(
            reader.label("name"),
            reader.number("fps", 0.01, 1000.0),
            _read_cameras(reader),
            reader.text("token") if reader.has("token") else "",
            reader.flag("shares") if reader.has("shares") else False,
            _read_features(reader),
        )


@dataclass(frozen=True, slots=True)
class SharedMemory:
    """Memory of the server into which a source on the same machine may write frames.

    Buffer k is the file that the server's process has open as descriptor `files[k]`; /proc calls it memfd:`name`.
    """

    process: int
    name: str
    files: tuple[int, ...]

    def _fields(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        files = reader.items("files", 1, MAX_BUFFERS)
        numbers = Reader(dict(zip(map(str, range(len(files))), files, strict=True)), "memory.files")
        return cls(
            reader.integer("process", 1, MAX_COUNT),
            reader.label("name"),
            tuple(numbers.integer(str(k), 0, MAX_COUNT) for k in range(len(files))),
        )


@dataclass(frozen=True, slots=True)
class Welcome:
    """The server's answer to a hello."""

    TYPE: ClassVar[str] = "welcome"
    session: str  # one run of the server
    client: str  # this connection
    settings: dict[str, Any]  # the engine's
    credits: int  # most frames of a source that are not settled yet
    max_message: int  # bytes
    memory: SharedMemory | None = None  # for a source whose hello has `shares`
    features: tuple[str, ...] = ()  # of the client's, those that are agreed

    def _fields(self) -> dict[str, Any]:
        fields = {name: getattr(self, name) for name in self.__slots__}
        return {"version": VERSION, **fields, "memory": self.memory and self.memory._fields()}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        _read_version(reader)
        return cls(
            reader.text("session"),
            reader.text("client"),
            reader.scalars("settings"),
            reader.integer("credits", 1, 1000),
            reader.integer("max_message", 1, MAX_COUNT),
            SharedMemory._read(reader.child("memory")) if reader.has("memory") else None,
            reader.texts("features", MAX_FEATURES) if reader.has("features") else (),
        )


@dataclass(frozen=True, slots=True)
class Scene:
    """The scene on show, sent to a viewer when a source has announced its cameras.

    `cameras` is their number. `position` and `orientation` are a pose among them, in the viewer's axes.
    """

    TYPE: ClassVar[str] = "scene"
    name: str
    fps: float
    cameras: int
    position: Vector
    orientation: Quaternion

    def _fields(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        return cls(
            reader.label("name"),
            reader.number("fps", 0.0),
            reader.integer("cameras", 1, MAX_CAMERAS),
            reader.vector("position"),
            reader.quaternion("orientation"),
        )


@dataclass(frozen=True, slots=True)
class BufferFree:
    """A buffer of the shared memory is free: the source may write one frame into it."""

    TYPE: ClassVar[str] = "buffer"
    number: int

    def _fields(self) -> dict[str, Any]:
        return {"number": self.number}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        return cls(reader.integer("number", 0, MAX_BUFFERS))


@dataclass(frozen=True, slots=True)
class ViewData:
    """One camera's texture and depth of one frame; `pose` if the camera moves (OMAF axes).

    Texture and depth are in the message, or already in shared memory, in the frame's `buffer`. If the camera has no
    picture in this frame (`missing`), there is nothing else. damage: what is wrong with the rest of a message whose
    frame, camera and buffer are right; it concerns this camera alone.
    """

    TYPE: ClassVar[str] = "view"
    frame: int
    camera: str
    width: int
    height: int
    texture: Picture | None
    depth: DepthData | None
    pose: Pose | None = None
    buffer: int | None = None
    missing: bool = False
    damage: ProtocolError | None = None

    @classmethod
    def without(cls, frame: int, camera: str, buffer: int | None = None, **why: Any) -> Self:
        """The message of a camera that has no picture in a frame; why: `missing` or `damage`."""
        return cls(frame, camera, 0, 0, None, None, buffer=buffer, **why)

    def _fields(self) -> dict[str, Any]:
        if self.missing:
            return {"frame": self.frame, "camera": self.camera, "buffer": self.buffer, "missing": True}
        pose = self.pose
        return {
            "frame": self.frame,
            "camera": self.camera,
            "width": self.width,
            "height": self.height,
            "texture": self.texture and self.texture._fields(),
            "depth": self.depth and self.depth._fields(),
            "pose": pose and {"position": pose.position, "orientation": pose.orientation},
            "buffer": self.buffer,
        }

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        frame, camera = reader.integer("frame", 0, MAX_COUNT), reader.text("camera", 100)
        buffer = reader.integer("buffer", 0, MAX_BUFFERS) if reader.has("buffer") else None
        if reader.has("missing") and reader.flag("missing"):
            return cls.without(frame, camera, buffer, missing=True)
        try:
            return cls._read_rest(reader, frame, camera, buffer)
        except ProtocolError as error:
            return cls.without(frame, camera, buffer, damage=error.with_traceback(None))

    @classmethod
    def _read_rest(cls, reader: Reader, frame: int, camera: str, buffer: int | None) -> Self:
        pose = reader.child("pose") if reader.has("pose") else None
        return cls(
            frame,
            camera,
            reader.integer("width", 1, MAX_VIEW_PX),
            reader.integer("height", 1, MAX_VIEW_PX),
            Picture._read(reader.child("texture")) if buffer is None else None,
            DepthData._read(reader.child("depth")) if buffer is None else None,
            Pose(pose.vector("position"), pose.quaternion("orientation")) if pose else None,
            buffer,
        )


@dataclass(frozen=True, slots=True)
class FrameDone:
    """A frame is settled: the model and the viewers have it (updated), or it was overtaken or shows nothing (dropped).

    left_out: why views of it were left out, by camera.
    """

    TYPE: ClassVar[str] = "frame_done"
    frame: int
    outcome: str
    left_out: Mapping[str, str] = field(default_factory=dict)

    def _fields(self) -> dict[str, Any]:
        return {"frame": self.frame, "outcome": self.outcome, "left_out": dict(self.left_out)}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        left_out = reader.scalars("left_out", MAX_CAMERAS) if reader.has("left_out") else {}
        return cls(
            reader.integer("frame", 0, MAX_COUNT),
            reader.choice("outcome", OUTCOMES),
            {camera: str(why) for camera, why in left_out.items()},
        )


@dataclass(frozen=True, slots=True)
class PoseUpdate:
    """The pose of a viewer's head, in the viewer's axes; `time` is on the viewer's clock, seconds.

    `seen` counts the stereo messages that the viewer has received; with it the server keeps only few under way.
    """

    TYPE: ClassVar[str] = "pose"
    seq: int
    time: float
    position: Vector
    orientation: Quaternion
    velocity: Vector | None = None  # m/s
    seen: int | None = None

    def _fields(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        return cls(
            reader.integer("seq", 0, MAX_COUNT),
            reader.number("time"),
            reader.vector("position"),
            reader.quaternion("orientation"),
            reader.vector("velocity") if reader.has("velocity") else None,
            reader.integer("seen", 0, MAX_COUNT) if reader.has("seen") else None,
        )


@dataclass(frozen=True, slots=True)
class Stereo:
    """A stereo pair, and the pose (as it was sent), the pose's time and the frame for which it was rendered."""

    TYPE: ClassVar[str] = "stereo"
    seq: int
    time: float
    position: Vector
    orientation: Quaternion
    frame: int
    width: int
    height: int
    left: Picture
    right: Picture
    stages: Mapping[str, float]  # milliseconds
    holes: float  # fraction of the pixels that nothing covered before filling
    dropped: int  # number of this viewer's poses overtaken so far
    rung: str = ""  # of the governor's ladder; empty if no frame rate is held

    def _fields(self) -> dict[str, Any]:
        fields = {name: getattr(self, name) for name in self.__slots__}
        return fields | {
            "left": self.left._fields(),
            "right": self.right._fields(),
            "stages": dict(self.stages),
        }

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        stages = reader.child("stages")
        return cls(
            reader.integer("seq", 0, MAX_COUNT),
            reader.number("time"),
            reader.vector("position"),
            reader.quaternion("orientation"),
            reader.integer("frame", 0, MAX_COUNT),
            reader.integer("width", 1, MAX_EYE_PX),
            reader.integer("height", 1, MAX_EYE_PX),
            Picture._read(reader.child("left")),
            Picture._read(reader.child("right")),
            {name: stages.number(name) for name in reader.scalars("stages")},
            reader.number("holes", 0.0, 1.0),
            reader.integer("dropped", 0, MAX_COUNT),
            reader.text("rung") if reader.has("rung") else "",
        )


@dataclass(frozen=True, slots=True)
class Error:
    """The reason why the connection is about to be closed; `code` is the close code."""

    TYPE: ClassVar[str] = "error"
    code: int
    field: str
    value: str
    expected: str

    @classmethod
    def of(cls, error: ProtocolError) -> Self:
        """The message for an error."""
        return cls(int(error.code), error.field, error.value, error.expected)

    def _fields(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        return cls(
            reader.integer("code", 1000, 4999),
            reader.text("field", 1000),
            reader.text("value", 1000),
            reader.text("expected", 1000),
        )


Message = (
    ViewerHello | SourceHello | Welcome | Scene | BufferFree | ViewData | FrameDone | PoseUpdate | EffectUpdate
    | EffectRemoval | Stereo | Error
)  # fmt: skip
M = TypeVar("M", bound=Message)
_ROLES = {kind.ROLE: kind for kind in (ViewerHello, SourceHello)}
_TYPES: dict[str, type[Message]] = {
    kind.TYPE: kind
    for kind in (
        Welcome, Scene, BufferFree, ViewData, FrameDone, PoseUpdate, EffectUpdate, EffectRemoval, Stereo, Error
    )
}  # fmt: skip


def encode(message: Message) -> bytes:
    """The bytes of a message (msgpack)."""
    data: bytes = msgpack.packb({"type": message.TYPE, **message._fields()}, use_bin_type=True)
    return data


@overload
def decode(data: bytes, kind: type[M], /, *, limit: int = ...) -> M: ...
@overload
def decode(data: bytes, *allowed: type[Message], limit: int = ...) -> Message: ...
def decode(data: bytes, *allowed: type[Any], limit: int = MAX_MESSAGE_BYTES) -> Any:
    """The message in `data`, one of `allowed` (any type if none is given), of at most `limit` bytes.

    Raises ProtocolError for everything that is wrong, and nothing else.
    """
    if len(data) > limit:
        raise ProtocolError(CloseCode.TOO_BIG, "message", f"{len(data)} bytes", f"at most {limit} bytes")
    try:
        large = len(data) > _LARGE  # `unpack` is slower for small messages, but its time does not grow with binary data
        fields = unpack(data) if large else msgpack.unpackb(data, raw=False, strict_map_key=True)
    except (ValueError, TypeError, OverflowError, msgpack.UnpackException) as error:
        message = str(error) or type(error).__name__
        raise ProtocolError(CloseCode.MALFORMED, "message", message, "a msgpack map") from error
    reader = Reader(fields)
    kind = _kind(reader)
    if allowed and kind not in allowed:
        raise _misplaced(reader, kind, allowed)
    return kind._read(reader)


def _misplaced(reader: Reader, kind: type[Message], allowed: tuple[type[Message], ...]) -> ProtocolError:
    names = " or ".join(dict.fromkeys(option.TYPE for option in allowed))
    if kind.TYPE in names:
        return reader.fail("role", reader.text("role"), "the role of this address", CloseCode.TYPE)
    return reader.fail("type", kind.TYPE, f"{names} here", CloseCode.TYPE)


def _kind(reader: Reader) -> type[Message]:
    name = reader.text("type")
    if name == "hello":
        _read_version(reader)
        return _ROLES[reader.choice("role", _ROLES)]
    if name not in _TYPES:
        raise reader.fail("type", name, "one of " + ", ".join(["hello", *_TYPES]), CloseCode.TYPE)
    return _TYPES[name]


# OpenXR and WebXR: x right, y up, z backward, quaternions x y z w. OMAF: x forward, y left, z up, w x y z.


def vector_from_wire(axes: str, vector: Vector) -> Vector:
    """A vector in a client's `axes` ("omaf" or "openxr"), converted to OMAF's."""
    x, y, z = vector
    return vector if axes == "omaf" else (-z, -x, y)


def pose_from_wire(axes: str, position: Vector, orientation: Quaternion) -> Pose:
    """A pose in a client's `axes` ("omaf" or "openxr"), converted to OMAF's."""
    if axes == "omaf":
        return Pose(position, orientation)
    x, y, z, w = orientation
    return Pose(vector_from_wire(axes, position), (w, *vector_from_wire(axes, (x, y, z))))


def pose_to_wire(axes: str, pose: Pose) -> tuple[Vector, Quaternion]:
    """Position and orientation, in a client's `axes` ("omaf" or "openxr"), of a pose in OMAF's."""
    if axes == "omaf":
        return pose.position, pose.orientation
    (px, py, pz), (w, x, y, z) = pose.position, pose.orientation
    return (-py, pz, -px), (-y, z, -x, w)
