"""JPEG encoding and decoding, raw planes, and PNG files."""

from __future__ import annotations

import io

import numpy as np
import pytest
from farside.engine.io import images
from farside.engine.rig.frame import Texture
from farside.engine.rig.texture import from_rgb, to_rgb
from PIL import Image


def random_texture(h: int, w: int, seed: int = 0) -> Texture:
    rng = np.random.default_rng(seed)
    chroma = (h + 1) // 2, (w + 1) // 2
    return Texture(
        rng.integers(0, 1024, (h, w), np.uint16),
        *(rng.integers(0, 1024, chroma, np.uint16) for _ in range(2)),
    )


def smooth_texture(h: int, w: int) -> Texture:
    v, u = np.mgrid[:h, :w]
    rgb = np.stack([80 + 100 * u / w, 60 + 120 * v / h, 150 - 60 * u / w], axis=-1)
    return from_rgb(rgb.astype(np.uint8))


@pytest.mark.parametrize(("h", "w"), [(48, 64), (47, 63), (47, 64), (1, 1)])
def test_the_encoder_finds_the_border_repeated_where_it_reads_beyond_an_odd_picture(h, w, monkeypatch) -> None:
    given, encode = [], images.simplejpeg.encode_jpeg_yuv_planes

    def record(y, cb, cr, **options):
        given.extend((y, cb, cr))
        return encode(y, cb, cr, **options)

    monkeypatch.setattr(images.simplejpeg, "encode_jpeg_yuv_planes", record)
    images.encode_jpeg(random_texture(h, w))
    y, whole = given[0], given[0].base
    assert y.shape == (h, w)
    assert given[1].shape == given[2].shape == ((h + 1) // 2, (w + 1) // 2)
    assert y.ctypes.data == whole.ctypes.data
    np.testing.assert_array_equal(whole, np.pad(y, ((0, h % 2), (0, w % 2)), "edge"))


@pytest.mark.parametrize(("h", "w"), [(48, 64), (47, 63)])
def test_a_decoder_of_another_hand_sees_the_same_picture(h: int, w: int) -> None:
    """Pillow decodes our JPEG to the RGB values of BT.709: matrix and range were converted in the planes."""
    texture = smooth_texture(h, w)
    decoded = np.asarray(Image.open(io.BytesIO(images.encode_jpeg(texture, 98))), np.int64)
    assert np.abs(decoded - to_rgb(texture)).max() <= 6
    assert np.abs(decoded - to_rgb(texture)).mean() < 1


@pytest.mark.parametrize(("h", "w"), [(48, 64), (47, 63)])
def test_jpeg_there_and_back(h: int, w: int) -> None:
    texture = smooth_texture(h, w)
    back = images.decode_jpeg(images.encode_jpeg(texture, 98), h, w)
    for name in ("y", "cb", "cr"):
        error = getattr(back, name).astype(int) - getattr(texture, name)
        assert np.abs(error).mean() < 4  # 10-bit codes: one step of 8 bits
        assert abs(error.mean()) < 1.5  # no offset: the range is right


@pytest.mark.parametrize("data", [b"", b"no picture", b"\xff\xd8\xff\xe0 broken"])
def test_what_is_no_jpeg_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"texture: .*expected a JPEG picture"):
        images.decode_jpeg(data, 4, 4)


def test_jpeg_cut_short_or_of_another_size_is_refused() -> None:
    data = images.encode_jpeg(smooth_texture(16, 16))
    with pytest.raises(ValueError, match="texture: 16x16: expected 32x16"):
        images.decode_jpeg(data, 16, 32)
    with pytest.raises(ValueError, match="texture: "):
        images.decode_jpeg(data[: len(data) // 2], 16, 16)


def test_png_holds_the_picture(tmp_path) -> None:
    texture = smooth_texture(10, 12)
    images.write_png(tmp_path / "picture.png", texture)
    with Image.open(tmp_path / "picture.png") as image:
        assert np.array_equal(np.asarray(image), to_rgb(texture))


@pytest.mark.parametrize(("h", "w"), [(6, 8), (7, 9), (1, 1)])
def test_raw_bytes_are_the_planes_one_after_the_other(h: int, w: int) -> None:
    texture = random_texture(h, w)
    data = images.encode_picture(texture, "raw")
    for plane, found in zip((texture.y, texture.cb, texture.cr), images.split_planes(data, h, w), strict=True):
        np.testing.assert_array_equal(np.frombuffer(found, "<u2").reshape(plane.shape), plane)
    with pytest.raises(ValueError, match=rf"picture: {len(data)} bytes: expected .* for {w}x{h + 2}"):
        images.split_planes(data, h + 2, w)


def test_a_picture_is_encoded_as_asked_for() -> None:
    texture = smooth_texture(16, 16)
    assert images.encode_picture(texture, "jpeg", 40) == images.encode_jpeg(texture, 40)
    with pytest.raises(ValueError, match="encoding: 'webp': expected one of jpeg, raw"):
        images.encode_picture(texture, "webp")
