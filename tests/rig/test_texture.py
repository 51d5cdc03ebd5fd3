"""Colour maps against the formulas of BT.709 and JFIF, and JPEG there and back."""

from __future__ import annotations

import io

import numpy as np
import pytest
from farside.engine.rig import texture as colour
from farside.engine.rig.frame import Texture
from PIL import Image


def reference_rgb(texture: Texture) -> np.ndarray:
    """R'G'B' by the formulas of BT.709, in floating point, unclipped: the oracle."""
    h, w = texture.y.shape
    chroma = [np.repeat(np.repeat(p, 2, 0), 2, 1)[:h, :w].astype(float) for p in (texture.cb, texture.cr)]
    y, cb, cr = (texture.y - 64.0) / 876, (chroma[0] - 512) / 896, (chroma[1] - 512) / 896
    r, b = y + 1.5748 * cr, y + 1.8556 * cb
    return 255 * np.stack([r, (y - 0.2126 * r - 0.0722 * b) / 0.7152, b], axis=-1)


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
    return colour.from_rgb(rgb.astype(np.uint8))


@pytest.mark.parametrize(("h", "w"), [(6, 8), (7, 9), (1, 1), (2, 31)])
def test_rgb_is_bt709(h: int, w: int) -> None:
    texture = random_texture(h, w)
    expected = np.clip(reference_rgb(texture), 0, 255)
    assert np.abs(colour.to_rgb(texture) - expected).max() <= 0.51


def test_black_white_and_primaries() -> None:
    rgb = np.array([[0, 0, 0], [255, 255, 255], [255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8)
    for value in rgb:
        picture = np.broadcast_to(value, (4, 6, 3)).copy()
        texture = colour.from_rgb(picture)
        assert np.abs(colour.to_rgb(texture).astype(int) - picture).max() <= 1
    assert colour.from_rgb(np.zeros((2, 2, 3), np.uint8)).y[0, 0] == 64
    white = colour.from_rgb(np.full((2, 2, 3), 255, np.uint8))
    assert (white.y[0, 0], white.cb[0, 0], white.cr[0, 0]) == (940, 512, 512)


@pytest.mark.parametrize(("h", "w"), [(48, 64), (47, 63), (47, 64), (1, 1)])
def test_the_encoder_finds_the_border_repeated_where_it_reads_beyond_an_odd_picture(h, w, monkeypatch) -> None:
    given, encode = [], colour.simplejpeg.encode_jpeg_yuv_planes

    def record(y, cb, cr, **options):
        given.extend((y, cb, cr))
        return encode(y, cb, cr, **options)

    monkeypatch.setattr(colour.simplejpeg, "encode_jpeg_yuv_planes", record)
    colour.encode_jpeg(random_texture(h, w))
    y, whole = given[0], given[0].base
    assert y.shape == (h, w)
    assert given[1].shape == given[2].shape == ((h + 1) // 2, (w + 1) // 2)
    assert y.ctypes.data == whole.ctypes.data
    np.testing.assert_array_equal(whole, np.pad(y, ((0, h % 2), (0, w % 2)), "edge"))


@pytest.mark.parametrize(("h", "w"), [(48, 64), (47, 63)])
def test_a_decoder_of_another_hand_sees_the_same_picture(h: int, w: int) -> None:
    """Pillow decodes our JPEG to the RGB that BT.709 gives: matrix and range went into the planes."""
    texture = smooth_texture(h, w)
    decoded = np.asarray(Image.open(io.BytesIO(colour.encode_jpeg(texture, 98))), np.int64)
    assert np.abs(decoded - colour.to_rgb(texture)).max() <= 6
    assert np.abs(decoded - colour.to_rgb(texture)).mean() < 1


@pytest.mark.parametrize(("h", "w"), [(48, 64), (47, 63)])
def test_jpeg_there_and_back(h: int, w: int) -> None:
    texture = smooth_texture(h, w)
    back = colour.decode_jpeg(colour.encode_jpeg(texture, 98), h, w)
    for name in ("y", "cb", "cr"):
        error = getattr(back, name).astype(int) - getattr(texture, name)
        assert np.abs(error).mean() < 4  # 10-bit codes: one step of 8 bits
        assert abs(error.mean()) < 1.5  # no offset: the range is right


@pytest.mark.parametrize("data", [b"", b"no picture", b"\xff\xd8\xff\xe0 broken"])
def test_what_is_no_jpeg_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"texture: .*expected a JPEG picture"):
        colour.decode_jpeg(data, 4, 4)


def test_jpeg_cut_short_or_of_another_size_is_refused() -> None:
    data = colour.encode_jpeg(smooth_texture(16, 16))
    with pytest.raises(ValueError, match="texture: 16x16: expected 32x16"):
        colour.decode_jpeg(data, 16, 32)
    with pytest.raises(ValueError, match="texture: "):
        colour.decode_jpeg(data[: len(data) // 2], 16, 16)


def test_png_holds_the_picture(tmp_path) -> None:
    texture = smooth_texture(10, 12)
    colour.write_png(tmp_path / "picture.png", texture)
    with Image.open(tmp_path / "picture.png") as image:
        assert np.array_equal(np.asarray(image), colour.to_rgb(texture))
