"""Encoding and decoding of textures, depth codes and views for the protocol. It takes long: use a worker thread."""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from farside.engine.io.images import decode_jpeg, encode_jpeg
from farside.engine.live.frame_memory import Planes
from farside.engine.rig.camera import Camera
from farside.engine.rig.frame import Texture, View
from farside.engine.rig.texture import empty_texture

from .protocol import CloseCode, DepthData, Picture, ProtocolError, ViewData

__all__ = ["decode_depth", "decode_texture", "decode_view", "encode_depth", "encode_texture", "encode_view"]

Codes = npt.NDArray[np.uint16]
_MAX_TEXTURE_CODE = 1023


def encode_texture(texture: Texture, encoding: str, quality: int = 90) -> Picture:
    """A texture as JPEG ("jpeg", at `quality` 1 to 100) or as planes of 10-bit codes ("raw")."""
    if encoding == "jpeg":
        return Picture(encoding, (encode_jpeg(texture, quality),))
    return Picture(encoding, tuple(_bytes(plane) for plane in (texture.y, texture.cb, texture.cr)))


def decode_texture(picture: Picture, height: int, width: int, name: str = "texture") -> Texture:
    """The texture of `height` x `width` in a picture; `name` is the field in errors. Raises ProtocolError."""
    if picture.encoding == "jpeg":
        try:
            return decode_jpeg(picture.planes[0], height, width)
        except ValueError as error:
            _, value, expected = str(error).split(": ", 2)
            raise ProtocolError(CloseCode.SIZE, name, value, expected.removeprefix("expected ")) from error
    texture = empty_texture(height, width)
    _take_planes(picture.planes, texture, name)
    return texture


def encode_depth(codes: Codes, encoding: str) -> DepthData:
    """Depth codes, uint16 [h, w], as they are ("raw") or as deflated differences along the rows ("zlib"), lossless."""
    if encoding == "raw":
        return DepthData(encoding, _bytes(codes))
    differences = np.diff(codes, axis=1, prepend=np.uint16(0))
    low_high = np.stack([differences & 0xFF, differences >> 8]).astype(np.uint8)
    return DepthData(encoding, zlib.compress(low_high.tobytes(), 1))


def decode_depth(depth: DepthData, height: int, width: int) -> Codes:
    """The codes (uint16 [h, w]) in a message, of any value; raises ProtocolError for a wrong length or bad stream."""
    if depth.encoding == "raw":
        return _plane(depth.data, (height, width), "depth.data")
    expected = 2 * height * width
    inflate = zlib.decompressobj()
    try:
        planes = inflate.decompress(depth.data, expected + 1)  # never more than announced
    except zlib.error as error:
        raise ProtocolError(CloseCode.MALFORMED, "depth.data", str(error), "a zlib stream") from error
    if len(planes) != expected or not inflate.eof:
        value = f"{len(planes)} bytes inflated" + ("" if inflate.eof else ", and more to come")
        raise ProtocolError(CloseCode.SIZE, "depth.data", value, f"{expected} bytes for {width}x{height}")
    low, high = np.frombuffer(planes, np.uint8).reshape(2, height, width)
    differences = low.astype(np.uint16) | (high.astype(np.uint16) << 8)
    codes: Codes = np.cumsum(differences, axis=1, dtype=np.uint16)  # modulo 2^16, as the differences are
    return codes


def encode_view(
    view: View, frame: int, *, texture: str = "raw", depth: str = "raw", quality: int = 90
) -> ViewData:
    """The message for a view of the frame number `frame`, with the camera's pose; `quality` is that of JPEG."""
    camera = view.camera
    picture, codes = encode_texture(view.texture, texture, quality), encode_depth(view.codes, depth)
    return ViewData(frame, camera.name, camera.width, camera.height, picture, codes, camera.pose)


def decode_view(message: ViewData, cameras: Mapping[str, Camera], memory: Mapping[str, Planes]) -> View:
    """The view in a message of one of the announced `cameras`, put into that camera's planes of `memory`.

    Texture and depth that the message does not contain are there already. Raises ProtocolError.
    """
    camera = cameras.get(message.camera)
    if camera is None:
        raise ProtocolError(CloseCode.CAMERA, "camera", message.camera, "one of " + ", ".join(cameras))
    size = message.width, message.height
    if size != (camera.width, camera.height):
        value = f"{size[0]}x{size[1]}"
        expected = f"{camera.width}x{camera.height}, as announced for {camera.name}"
        raise ProtocolError(CloseCode.SIZE, "resolution", value, expected)
    if message.pose is not None:
        camera = dataclasses.replace(camera, pose=message.pose)
    texture, codes = memory[camera.name]
    _take_texture(message.texture, texture)
    _take_depth(message.depth, codes, camera.depth.max_code)
    return View(camera, texture, codes)


def _take_texture(picture: Picture | None, texture: Texture) -> None:
    if picture is None or picture.encoding == "raw":
        _take_planes(picture.planes if picture else None, texture, "texture")
        return
    decoded = decode_texture(picture, *texture.y.shape)
    for name in ("y", "cb", "cr"):
        np.copyto(getattr(texture, name), getattr(decoded, name))


def _take_planes(data: Sequence[bytes | memoryview] | None, texture: Texture, name: str) -> None:
    """Write `data`, if given, into the texture's planes; check the codes there."""
    for number, field in enumerate(("y", "cb", "cr")):
        plane = getattr(texture, field)
        if data is not None:
            np.copyto(plane, _plane(data[number], plane.shape, f"{name}.{field}"))
        _check_range(plane, f"{name}.{field}", _MAX_TEXTURE_CODE)


def _take_depth(depth: DepthData | None, codes: Codes, max_code: int) -> None:
    if depth is not None:
        np.copyto(codes, decode_depth(depth, *codes.shape))
    _check_range(codes, "depth.data", max_code)


def _bytes(plane: Codes) -> memoryview:
    """The bytes of a plane, copied only if the plane is not contiguous."""
    return np.ascontiguousarray(plane, "<u2").data.cast("B")


def _plane(data: bytes | memoryview, shape: tuple[int, ...], name: str) -> Codes:
    """The data as a plane, not copied."""
    expected = 2 * math.prod(shape)
    if len(data) != expected:
        raise ProtocolError(
            CloseCode.SIZE, name, f"{len(data)} bytes", f"{expected} for {shape[1]}x{shape[0]}"
        )
    return np.frombuffer(data, "<u2").reshape(shape)


def _check_range(codes: Codes, name: str, largest: int) -> None:
    if largest < 0xFFFF and (highest := int(codes.max())) > largest:
        raise ProtocolError(CloseCode.VALUE, name, highest, f"codes of at most {largest}")
