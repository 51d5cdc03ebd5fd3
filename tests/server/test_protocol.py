"""The protocol on bytes: round trips, refusals that name field, value and expectation, damaged input."""

from __future__ import annotations

import math
import zlib
from typing import Any

import msgpack
import numpy as np
import pytest
from farside.engine.geometry.prepared_view import pixels_per_radian
from farside.engine.live.frame_memory import Planes, frame_bytes, lay_out
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture, View
from farside.server import pictures, protocol
from farside.server.protocol import CloseCode, ProtocolError
from hypothesis import given, settings
from hypothesis import strategies as st

numbers = st.floats(-1e6, 1e6)
vectors = st.tuples(numbers, numbers, numbers)
counts = st.integers(0, 1 << 53)
names = st.text(st.characters(codec="utf-8").filter(str.isprintable), min_size=1, max_size=20)
blobs = st.binary(max_size=50)
fractions = st.floats(0, 1)


@st.composite
def quaternions(draw: Any) -> tuple[float, float, float, float]:
    parts = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 4)))
    norm = float(np.linalg.norm(parts))
    return tuple((parts / norm).tolist()) if norm > 1e-3 else (1.0, 0.0, 0.0, 0.0)


poses = st.builds(Pose, vectors, quaternions())
perspectives = st.builds(
    Perspective,
    st.integers(1, 8192),
    st.integers(1, 8192),
    st.floats(1, 1e4),
    st.floats(-1e4, -1),
    numbers,
    numbers,
)
spheres = st.builds(
    Equirectangular,
    st.integers(1, 8192),
    st.integers(1, 8192),
    st.just((-math.pi, math.pi)) | st.tuples(st.floats(-3, 0), st.floats(0.1, 3)),
    st.just((-math.pi / 2, math.pi / 2)),
)
codings = st.builds(
    DepthCoding, st.floats(0.1, 1), st.floats(2, 100) | st.just(math.inf), st.integers(1, 16), st.booleans()
)
cameras = st.builds(Camera, names, perspectives | spheres, poses, codings, st.integers(8, 16))
eyes = st.tuples(*[st.floats(0.01, 5)] * 4)
sizes = st.integers(16, 4096)
planes = st.builds(protocol.Picture, st.just("jpeg"), st.tuples(blobs)) | st.builds(
    protocol.Picture, st.just("raw"), st.tuples(blobs, blobs, blobs)
)
features = st.builds(protocol.Features, *[st.lists(names, max_size=3).map(tuple)] * 2)
messages = st.one_of(
    st.builds(
        protocol.ViewerHello,
        sizes,
        sizes,
        eyes,
        eyes,
        fractions,
        st.sampled_from(protocol.AXES),
        st.sampled_from(["jpeg", "raw"]),
        names,
        features,
    ),
    st.builds(
        protocol.SourceHello,
        names,
        st.floats(1, 240),
        st.lists(cameras, min_size=1, max_size=3, unique_by=lambda c: c.name).map(tuple),
        names,
        st.booleans(),
        features,
    ),
    st.builds(
        protocol.Welcome,
        names,
        names,
        st.dictionaries(names, st.none() | st.booleans() | numbers | names, max_size=3),
        st.integers(1, 9),
        st.integers(1, 1 << 40),
        features=st.lists(names, max_size=3).map(tuple),
    ),
    st.builds(protocol.Scene, names, st.floats(0, 240), st.integers(1, 256), vectors, quaternions()),
    st.builds(
        protocol.ViewData,
        counts,
        names,
        st.integers(1, 8192),
        st.integers(1, 8192),
        planes,
        st.builds(protocol.DepthData, st.sampled_from(["raw", "zlib"]), blobs),
        st.none() | poses,
    ),
    st.builds(protocol.ViewData.without, counts, names, st.none() | st.integers(0, 9), missing=st.just(True)),
    st.builds(
        protocol.FrameDone,
        counts,
        st.sampled_from(["updated", "dropped"]),
        st.dictionaries(names, names, max_size=3),
    ),
    st.builds(
        protocol.EffectUpdate, names, st.just("projector"), vectors, quaternions(), st.floats(0.02, 2.9), fractions,
        st.sampled_from(["mix", "add"]), names,
    ),
    st.builds(
        protocol.EffectUpdate, names, st.just("mesh"), vectors, quaternions(), scale=st.floats(1e-3, 1e3)
    ),
    st.builds(protocol.EffectRemoval, names),
    st.builds(protocol.PoseUpdate, counts, numbers, vectors, quaternions(), st.none() | vectors, st.none() | counts),
    st.builds(
        protocol.Stereo,
        counts,
        numbers,
        vectors,
        quaternions(),
        counts,
        sizes,
        sizes,
        planes,
        planes,
        st.dictionaries(names, numbers, max_size=4),
        fractions,
        counts,
    ),
    st.builds(protocol.Error, st.sampled_from(list(CloseCode)).map(int), names, names, names),
)


def same(a: Any, b: Any) -> bool:
    """Whether two messages are equal up to the last bits of numbers: a quaternion is normalised again on arrival."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and (a == b or (isinstance(a, float) and abs(a - b) < 1e-12))


def refusal(data: bytes) -> ProtocolError | None:
    try:
        protocol.decode(data)
    except ProtocolError as error:
        return error
    return None


@given(messages)
def test_a_message_comes_back_as_it_went(message: protocol.Message) -> None:
    back = protocol.decode(protocol.encode(message))
    assert type(back) is type(message)
    assert same(msgpack.unpackb(protocol.encode(back)), msgpack.unpackb(protocol.encode(message)))
    if not isinstance(message, protocol.SourceHello | protocol.ViewData):
        assert back == message


@given(messages, st.data())
def test_damaged_bytes_raise_nothing_but_protocol_errors(message: protocol.Message, data: st.DataObject) -> None:
    good = protocol.encode(message)
    at = data.draw(st.integers(0, len(good) - 1))
    flipped = good[:at] + bytes([data.draw(st.integers(0, 255))]) + good[at + 1 :]
    with pytest.raises(ProtocolError):
        protocol.decode(good[:at])
    for damaged in (flipped, good + b"\x00", flipped[at:]):
        error = refusal(damaged)
        assert error is None or (error.code in CloseCode and error.field and error.expected)


@given(st.binary(max_size=200))
@settings(max_examples=300)
def test_any_bytes_raise_nothing_but_protocol_errors(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        protocol.decode(data)


json_like = st.recursive(
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats() | names | blobs,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
)


@given(messages, st.data())
def test_any_value_in_any_field_raises_nothing_but_protocol_errors(
    message: protocol.Message, data: st.DataObject
) -> None:
    fields = msgpack.unpackb(protocol.encode(message))
    key = data.draw(st.sampled_from(sorted(fields)))
    fields[key] = data.draw(json_like)
    error = refusal(msgpack.packb(fields))
    assert error is None or error.field.startswith(key)


POSE = {"type": "pose", "seq": 1, "time": 0.5, "position": [0, 0, 0], "orientation": [1, 0, 0, 0]}
HELLO = {
    "type": "hello",
    "version": 2,
    "role": "viewer",
    "axes": "omaf",
    "encoding": "jpeg",
    "width": 64,
    "height": 48,
    "fov": 1.5,
    "ipd": 0.06,
}
CAMERA = msgpack.unpackb(
    protocol.encode(
        protocol.SourceHello("s", 30, (Camera("v0", Perspective(64, 48, 50, 50, 32, 24), Pose(), DepthCoding(1, 9)),))
    )
)


@pytest.mark.parametrize(
    ("fields", "code", "says"),
    [
        ([], CloseCode.MALFORMED, "message: list: expected a map"),
        ({}, CloseCode.MALFORMED, "type: missing: expected a string"),
        ({"type": "dance"}, CloseCode.TYPE, "type: dance: expected one of hello, welcome"),
        (POSE | {"seq": -1}, CloseCode.VALUE, "seq: -1: expected an integer from 0"),
        (POSE | {"seq": True}, CloseCode.MALFORMED, "seq: True: expected an integer"),
        (POSE | {"seq": 1.5}, CloseCode.MALFORMED, "seq: 1.5: expected an integer"),
        (POSE | {"time": math.nan}, CloseCode.VALUE, "time: nan: expected a number"),
        (
            POSE | {"position": [0, math.nan, 0]},
            CloseCode.VALUE,
            "position: .*nan.*: expected 3 finite numbers",
        ),
        (
            POSE | {"position": [0, math.inf, 0]},
            CloseCode.VALUE,
            "position: .*inf.*: expected 3 finite numbers",
        ),
        (POSE | {"position": [0, 0]}, CloseCode.VALUE, "position: 2 items: expected an array of 3 items"),
        (
            POSE | {"orientation": [1, 1, 0, 0]},
            CloseCode.VALUE,
            "orientation: .*: expected a unit quaternion",
        ),
        (
            POSE | {"orientation": [0, 0, 0, 0]},
            CloseCode.VALUE,
            "orientation: .*: expected a unit quaternion",
        ),
        (POSE | {"orientation": "up"}, CloseCode.MALFORMED, "orientation: up: expected an array of 4"),
        (HELLO | {"version": 1}, CloseCode.VERSION, "version: 1: expected 2"),
        (HELLO | {"role": "judge"}, CloseCode.VALUE, "role: judge: expected one of viewer, source"),
        (HELLO | {"axes": "left"}, CloseCode.VALUE, "axes: left: expected one of omaf, openxr"),
        (HELLO | {"encoding": "gif"}, CloseCode.VALUE, "encoding: gif: expected one of jpeg, raw"),
        (HELLO | {"width": 100000}, CloseCode.VALUE, "width: 100000: expected an integer from 16 to 4096"),
        (HELLO | {"fov": 4}, CloseCode.VALUE, "fov: 4: expected a number from 0.01 to 3.1"),
        (HELLO | {"tangents": [[1, 1, 1, 1]]}, CloseCode.VALUE, "tangents: 1 items: expected an array of 2"),
        (HELLO | {"tangents": [[1, -1, 1, 1]] * 2}, CloseCode.VALUE, "tangents: .*: expected left"),
        (CAMERA | {"cameras": []}, CloseCode.VALUE, "cameras: 0 items: expected an array of 1 to 256"),
        (
            CAMERA | {"cameras": CAMERA["cameras"] * 2},
            CloseCode.VALUE,
            "cameras: v0: expected different names of all cameras",
        ),
        (CAMERA | {"fps": 0}, CloseCode.VALUE, "fps: 0: expected a number from 0.01"),
        (
            CAMERA
            | {"cameras": [CAMERA["cameras"][0] | {"depth": {"near": 2, "far": 1, "bits": 8, "has_invalid": 0}}]},
            CloseCode.MALFORMED,
            r"cameras\[0\].depth.has_invalid: 0: expected true or false",
        ),
        (
            CAMERA
            | {"cameras": [CAMERA["cameras"][0] | {"depth": {"near": 2, "far": 1, "bits": 8, "has_invalid": False}}]},
            CloseCode.VALUE,
            r"cameras\[0\].depth.near: 2.0: expected 0 < near < far",
        ),
        (
            CAMERA
            | {
                "cameras": [
                    CAMERA["cameras"][0] | {"projection": {"kind": "perspective", "focal": [0, 1], "centre": [0, 0]}}
                ]
            },
            CloseCode.VALUE,
            r"cameras\[0\].projection.fx: 0.0: expected a finite number of at least 1e-09 in magnitude",
        ),
    ],
)
def test_what_is_wrong_is_named(fields: Any, code: CloseCode, says: str) -> None:
    with pytest.raises(ProtocolError, match=says) as caught:
        protocol.decode(msgpack.packb(fields))
    assert caught.value.code == code


def test_a_message_out_of_place_is_refused() -> None:
    with pytest.raises(ProtocolError, match="type: pose: expected hello here") as caught:
        protocol.decode(msgpack.packb(POSE), protocol.ViewerHello)
    assert caught.value.code == CloseCode.TYPE
    with pytest.raises(ProtocolError, match="role: viewer: expected the role of this address"):
        protocol.decode(msgpack.packb(HELLO), protocol.SourceHello)


def test_an_oversized_message_is_refused_unread() -> None:
    with pytest.raises(ProtocolError, match="message: 101 bytes: expected at most 100 bytes") as caught:
        protocol.decode(bytes(101), limit=100)
    assert caught.value.code == CloseCode.TOO_BIG


@pytest.mark.parametrize("depth", [30, 500, 1010, 5000])
@pytest.mark.parametrize("nest", [b"\x91", b"\x81\xa1a"])
@pytest.mark.parametrize("place", [b"", b"\x81\xa4type", b"\x82\xa4type\xa4pose\xa3seq"])
def test_a_deep_nest_is_refused(place: bytes, nest: bytes, depth: int) -> None:
    with pytest.raises(ProtocolError, match=r"(message|type|seq): .*expected"):
        protocol.decode(place + nest * depth + b"\0")


_NUMBERS = st.one_of(
    st.floats(),
    st.sampled_from([0.0, 5e-324, 1e-300, -1e-200, 1e-12, 1e-3, 1.0, 1e12, 1e300]),
    st.integers(-(1 << 63), (1 << 64) - 1),
)
_VALUES = st.recursive(
    st.none() | st.booleans() | _NUMBERS | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all values within a message."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, inner in items for place in _places(inner, (*path, key)))]


def _replaced(value: Any, path: tuple[Any, ...], new: Any) -> Any:
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = _replaced(value[path[0]], path[1:], new)
    return copy


@given(
    st.floats(0.9985, 1.0015), st.lists(st.floats(-1, 1), min_size=4, max_size=4), st.sampled_from(["omaf", "openxr"])
)
def test_an_orientation_that_is_read_is_a_pose(length: float, parts: list[float], axes: str) -> None:
    norm = math.sqrt(sum(part * part for part in parts))
    orientation = [length * part / norm for part in parts] if norm > 1e-3 else [length, 0.0, 0.0, 0.0]
    try:
        update = protocol.decode(msgpack.packb(POSE | {"orientation": orientation}), protocol.PoseUpdate)
    except ProtocolError:
        return
    protocol.pose_from_wire(axes, update.position, update.orientation)


@given(st.data(), st.sampled_from(["HELLO", "CAMERA", "POSE"]))
def test_whatever_stands_in_a_message_it_is_read_or_refused(data: st.DataObject, name: str) -> None:
    fields = msgpack.unpackb(msgpack.packb({"HELLO": HELLO, "CAMERA": CAMERA, "POSE": POSE}[name]))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from(_places(fields)))
        fields = _replaced(fields, place, data.draw(_VALUES | _NUMBERS))
    try:
        message = protocol.decode(msgpack.packb(fields))
    except ProtocolError:
        return
    if isinstance(message, protocol.SourceHello):  # what is read can be worked with
        for camera in message.cameras:
            assert np.isfinite(camera.packed()).all()
            assert 0 < pixels_per_radian(camera) < math.inf
            assert np.isfinite(camera.depth.packed()).all()


def test_field_of_view_is_a_pair_of_equal_frusta_with_square_pixels() -> None:
    hello = protocol.decode(msgpack.packb(HELLO), protocol.ViewerHello)
    assert hello.left == hello.right
    left, right, top, bottom = hello.left
    assert left == right == pytest.approx(math.tan(0.75))
    assert top == bottom == pytest.approx(left * 48 / 64)


# Axes


def test_openxr_axes() -> None:
    """Forward is -z in OpenXR and +x in OMAF; right is +x and -y, up is +y and +z."""
    half = math.sqrt(0.5)
    pose = protocol.pose_from_wire("openxr", (1.0, 2.0, 3.0), (0.0, half, 0.0, half))  # 90 degrees to the left
    assert pose.position == (-3.0, -1.0, 2.0)
    assert pose.rotation() @ [1, 0, 0] == pytest.approx([0, 1, 0])  # forward became left
    assert protocol.vector_from_wire("openxr", (0.0, 0.0, -1.0)) == (1.0, 0.0, 0.0)


@given(poses, st.sampled_from(protocol.AXES))
def test_axes_there_and_back(pose: Pose, axes: str) -> None:
    back = protocol.pose_from_wire(axes, *protocol.pose_to_wire(axes, pose))
    assert back.position == pose.position
    assert back.orientation == pytest.approx(pose.orientation, abs=1e-12)


@given(quaternions(), vectors)
def test_rotating_commutes_with_changing_axes(q: Any, v: Any) -> None:
    """Turning a point and then changing axes gives the same as changing axes first and then turning."""
    w, x, y, z = q
    in_xr = Pose((0, 0, 0), (w, x, y, z)).rotation() @ v
    here = protocol.pose_from_wire("openxr", (0.0, 0.0, 0.0), (x, y, z, w)).rotation()
    expected = protocol.vector_from_wire("openxr", tuple(in_xr))
    assert here @ protocol.vector_from_wire("openxr", v) == pytest.approx(expected, abs=1e-6 * (1 + np.abs(v).max()))


# Pictures and depth


def a_view(width: int = 9, height: int = 7, bits: int = 16) -> View:
    rng = np.random.default_rng(1)
    chroma = (height + 1) // 2, (width + 1) // 2
    camera = Camera("v0", Perspective(width, height, 8, 8, 4, 3), Pose(), DepthCoding(0.5, 9, bits))
    texture = Texture(
        rng.integers(0, 1024, (height, width), np.uint16),
        *(rng.integers(0, 1024, chroma, np.uint16) for _ in range(2)),
    )
    return View(camera, texture, rng.integers(0, 1 << bits, (height, width), np.uint16))


def memory_for(view: View) -> dict[str, Planes]:
    return lay_out(np.zeros(frame_bytes([view.camera]), np.uint8), [view.camera])


@pytest.mark.parametrize("depth", ["raw", "zlib"])
def test_a_raw_view_is_lossless(depth: str) -> None:
    view = a_view()
    message = protocol.decode(protocol.encode(pictures.encode_view(view, 5, depth=depth)), protocol.ViewData)
    back = pictures.decode_view(message, {"v0": view.camera}, memory_for(view))
    assert message.frame == 5
    assert back.camera == view.camera
    assert np.array_equal(back.codes, view.codes)
    for plane in ("y", "cb", "cr"):
        assert np.array_equal(getattr(back.texture, plane), getattr(view.texture, plane))
        assert getattr(back.texture, plane).flags.writeable


def test_smooth_depth_gets_small() -> None:
    codes = (20000 + 30 * np.arange(640)[None] + 7 * np.arange(480)[:, None]).astype(np.uint16)
    assert len(pictures.encode_depth(codes, "zlib").data) < codes.nbytes / 100


@pytest.mark.parametrize(
    ("changes", "code", "says"),
    [
        ({"camera": "v9"}, CloseCode.CAMERA, "camera: v9: expected one of v0"),
        ({"width": 8}, CloseCode.SIZE, "resolution: 8x7: expected 9x7, as announced for v0"),
        (
            {"texture": protocol.Picture("raw", (b"12", b"", b""))},
            CloseCode.SIZE,
            "texture.y: 2 bytes: expected 126",
        ),
        (
            {"texture": protocol.Picture("jpeg", (b"12",))},
            CloseCode.SIZE,
            "texture: 2 bytes: expected a JPEG",
        ),
        (
            {"texture": protocol.Picture("raw", (b"\xff" * 126, bytes(40), bytes(40)))},
            CloseCode.VALUE,
            "texture.y: 65535: expected codes of at most 1023",
        ),
        (
            {"depth": protocol.DepthData("raw", bytes(124))},
            CloseCode.SIZE,
            "depth.data: 124 bytes: expected 126",
        ),
        (
            {"depth": protocol.DepthData("raw", b"\xff" * 126)},
            CloseCode.VALUE,
            "depth.data: 65535: expected codes",
        ),
        (
            {"depth": protocol.DepthData("zlib", b"junk")},
            CloseCode.MALFORMED,
            "depth.data: .*expected a zlib stream",
        ),
        (
            {"depth": protocol.DepthData("zlib", zlib.compress(bytes(1 << 24)))},
            CloseCode.SIZE,
            "depth.data: 127 bytes inflated, and more to come: expected 126 bytes for 9x7",
        ),
        (
            {"depth": protocol.DepthData("zlib", zlib.compress(bytes(99)))},
            CloseCode.SIZE,
            "depth.data: 99 bytes",
        ),
    ],
)
def test_a_view_that_does_not_fit_is_refused(changes: dict[str, Any], code: CloseCode, says: str) -> None:
    view = a_view(bits=12)
    fields = {name: getattr(pictures.encode_view(view, 0), name) for name in protocol.ViewData.__slots__}
    with pytest.raises(ProtocolError, match=says) as caught:
        pictures.decode_view(protocol.ViewData(**(fields | changes)), {"v0": view.camera}, memory_for(view))
    assert caught.value.code == code


VIEW = msgpack.unpackb(protocol.encode(pictures.encode_view(a_view(), 3)))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"texture": None}, "texture: None: expected a map"),
        ({"texture": {"encoding": "gif", "planes": []}}, "texture.encoding: gif: expected one of jpeg, raw"),
        ({"texture": {"encoding": "jpeg", "planes": ["text"]}}, "texture.planes: .*: expected binary data"),
        ({"depth": 7}, "depth: 7: expected a map"),
        ({"depth": {"encoding": "raw"}}, "depth.data: missing: expected binary data"),
        ({"width": 0}, "width: 0: expected an integer from 1"),
        ({"height": "tall"}, "height: tall: expected an integer"),
        ({"pose": {"position": [0, 0, 0]}}, "pose.orientation: missing"),
        ({"pose": {"position": [0, 0, math.inf], "orientation": [1, 0, 0, 0]}}, "pose.position: .*3 finite numbers"),
        ({"pose": {"position": [0, 0, 0], "orientation": [math.nan] * 4}}, "pose.orientation: .*4 finite numbers"),
    ],
)
def test_what_is_wrong_with_one_cameras_part_of_a_view_is_told_with_its_frame_and_camera(
    changes: dict[str, Any], says: str
) -> None:
    view = protocol.decode(msgpack.packb(VIEW | changes), protocol.ViewData)
    assert (view.frame, view.camera, view.buffer, view.missing) == (3, "v0", None, False)
    with pytest.raises(ProtocolError, match=says):
        raise view.damage


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"frame": None}, "frame: None: expected an integer"),
        ({"frame": -1}, "frame: -1"),
        ({"camera": 7}, "camera: 7: expected a string"),
        ({"buffer": -1}, "buffer: -1"),
        ({"missing": "yes"}, "missing: yes: expected true or false"),
    ],
)
def test_what_concerns_the_whole_frame_is_an_error(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(ProtocolError, match=says):
        protocol.decode(msgpack.packb(VIEW | {"width": 0} | changes), protocol.ViewData)


def test_a_view_that_is_missing_needs_nothing_but_its_frame_and_camera() -> None:
    fields = {"type": "view", "frame": 3, "camera": "v0", "missing": True}
    assert protocol.decode(msgpack.packb(fields)) == protocol.ViewData.without(3, "v0", missing=True)
    assert protocol.decode(msgpack.packb(VIEW | {"missing": False}), protocol.ViewData).texture is not None


@pytest.mark.parametrize(
    ("optional", "required", "common"),
    [
        ((), (), ()),
        (("missing_views", "depth_layers"), (), ("missing_views",)),
        (("depth_layers",), ("missing_views",), ("missing_views",)),
        (("missing_views",), ("missing_views",), ("missing_views",)),
        (("queries",), ("missing_views",), ("missing_views", "queries")),
    ],
)
def test_features_that_both_sides_have_are_agreed_and_unknown_optional_ones_ignored(
    optional: tuple[str, ...], required: tuple[str, ...], common: tuple[str, ...]
) -> None:
    assert protocol.agreed(protocol.Features(optional, required), "source") == common


def test_nothing_that_controls_a_terminal_gets_into_names_and_reasons() -> None:
    error = ProtocolError(CloseCode.VALUE, "name", "a\0b\n\x1b[31m\ud800 é", "another")
    assert str(error) == "name: a\\x00b\\n\\x1b[31m\\ud800 é: expected another"
    for name in ("v0\n", "\x1b[2J", "v\u2028"):
        for path in (("name",), ("cameras", 0, "name")):
            with pytest.raises(ProtocolError, match=r"name: .*: expected printable characters"):
                protocol.decode(msgpack.packb(_replaced(CAMERA, path, name)), protocol.SourceHello)


def test_a_required_feature_that_is_unknown_is_refused_by_name() -> None:
    with pytest.raises(ProtocolError, match=r"features\.required: scenes: expected one of missing_views") as caught:
        protocol.agreed(protocol.Features(("scenes",), ("missing_views", "scenes")), "source")
    assert caught.value.code == CloseCode.FEATURE == 4410
