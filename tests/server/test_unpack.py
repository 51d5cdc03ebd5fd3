"""Unpacking without copies: the same as msgpack's, and the same refusals."""

from __future__ import annotations

import struct
from typing import Any

import msgpack
import numpy as np
import pytest
from farside.engine.io.images import decode_jpeg, encode_jpeg
from farside.server import protocol
from farside.server.pictures import encode_view
from farside.server.protocol import CloseCode, ProtocolError, ViewData
from farside.server.unpack import unpack
from hypothesis import given
from hypothesis import strategies as st
from support.doubles import CAMERAS, a_view

SCALARS = (
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 64) - 1) | st.floats(allow_nan=False)
    | st.text(max_size=40) | st.binary(max_size=300)
)  # fmt: skip
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=20) | st.dictionaries(st.text(max_size=40), inner, max_size=20)
)


@given(VALUES)
def test_it_gives_what_msgpack_gives(value: Any) -> None:
    data = msgpack.packb(value)
    assert unpack(data) == msgpack.unpackb(data)


def test_single_precision() -> None:
    assert unpack(msgpack.packb([0.1, -1e30], use_single_float=True)) == [np.float32(0.1), np.float32(-1e30)]


@pytest.mark.parametrize("size", [0, 15, 16, 31, 32, 255, 256, 65535, 65536])
def test_every_length_of_every_kind(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert all(unpack(msgpack.packb(value)) == value for value in (bytes(size), "x" * size))
    monkeypatch.setattr("farside.server.unpack._MOST", 1 << 18)
    assert all(unpack(msgpack.packb(v)) == v for v in ([1] * size, {str(k): k for k in range(size)}))


def test_binary_data_is_not_copied() -> None:
    data = msgpack.packb({"planes": [b"abc", bytes(1 << 16)]})
    planes = unpack(data)["planes"]
    start = np.frombuffer(data, np.uint8).ctypes.data
    assert all(isinstance(plane, memoryview) for plane in planes)
    assert np.frombuffer(planes[1], np.uint8).ctypes.data == start + len(data) - (1 << 16)


@given(st.binary(max_size=200))
def test_junk_is_a_value_error_or_what_msgpack_makes_of_it(data: bytes) -> None:
    try:
        value = unpack(data)
    except ValueError:
        return
    assert repr(msgpack.unpackb(data, strict_map_key=True)) == repr(_bytes(value))


def _bytes(value: Any) -> Any:
    if isinstance(value, memoryview):
        return bytes(value)
    if isinstance(value, list):
        return [_bytes(item) for item in value]
    return {key: _bytes(item) for key, item in value.items()} if isinstance(value, dict) else value


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "only 0 are there"),
        (msgpack.packb(5) + b"\0\0", "2 bytes more than the message"),
        (msgpack.packb([1, 2, 3])[:-1], "only 0 are there"),
        (msgpack.packb(b"abcdef")[:-2], "6 bytes from byte 2: only 4 are there"),
        (struct.pack(">BI", 0xDD, (1 << 32) - 1), "only 0 are there"),
        (b"\x81" + msgpack.packb(5) + b"\0", "int as a key: expected a string"),
        (b"\x81\x90\x00", "expected at most 32|list as a key"),
        (b"\xc1", "0xc1: expected the beginning of a value"),
        (msgpack.packb(msgpack.ExtType(5, b"ab")), "0xd5: expected"),
        (msgpack.packb([1] * 10_000), "expected at most 10000 values"),
        (b"\x91" * 100 + b"\0", "expected at most 32 maps and arrays within one another"),
        (b"\xa2\xff\xff", "can't decode"),
    ],
)
def test_what_is_no_message_is_refused(data: bytes, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        unpack(data)


def test_large_views_are_decoded_without_a_copy_and_small_ones_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    message = encode_view(a_view(CAMERAS[0]), 3)
    monkeypatch.setattr(protocol, "_LARGE", 100)
    decoded = protocol.decode(protocol.encode(message), ViewData)
    assert decoded == message
    assert isinstance(decoded.texture.planes[0], memoryview)
    assert isinstance(decoded.depth.data, memoryview)
    with pytest.raises(ProtocolError, match=r"only .* are there: expected a msgpack map") as caught:
        protocol.decode(protocol.encode(message)[:-1], ViewData)
    assert caught.value.code == CloseCode.MALFORMED


def test_a_jpeg_in_a_view_of_the_message_is_decoded() -> None:
    texture = a_view(CAMERAS[0], 400).texture
    data = encode_jpeg(texture, 90)
    np.testing.assert_array_equal(decode_jpeg(memoryview(data), 16, 24).y, decode_jpeg(data, 16, 24).y)
