"""Textures as pictures for other programs: JPEG (BT.709 limited-range Y'CbCr 4:2:0), raw planes, PNG files."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike

import numpy as np
import numpy.typing as npt
import simplejpeg
from PIL import Image

from ..kernels.rendering import colour as kernels
from ..rig.frame import Texture
from ..rig.texture import from_rgb, to_rgb

__all__ = ["ENCODINGS", "decode_jpeg", "encode_jpeg", "encode_picture", "encode_rgb_jpeg", "split_planes", "write_png"]

ENCODINGS = ("jpeg", "raw")


def encode_picture(texture: Texture, encoding: str, quality: int = 90) -> bytes:
    """A texture as bytes.

    jpeg: JFIF with `quality` from 1 to 100. raw: the planes Y, Cb, Cr one after the other, rows of 10-bit codes as
    little-endian uint16 (see `split_planes`). Raises ValueError for another encoding.
    """
    if encoding == "jpeg":
        return encode_jpeg(texture, quality)
    if encoding == "raw":
        planes = (texture.y, texture.cb, texture.cr)
        return b"".join(np.ascontiguousarray(plane, "<u2").data.cast("B") for plane in planes)
    raise ValueError(f"encoding: {encoding!r}: expected one of {', '.join(ENCODINGS)}")


def split_planes(data: bytes, height: int, width: int) -> Sequence[memoryview]:
    """The planes Y, Cb, Cr in a picture's raw bytes (`encode_picture`), not copied.

    Raises ValueError where the number of bytes does not fit the size.
    """
    whole, luma, chroma = memoryview(data), 2 * height * width, 2 * ((height + 1) // 2) * ((width + 1) // 2)
    if len(whole) != luma + 2 * chroma:
        raise ValueError(f"picture: {len(whole)} bytes: expected {luma + 2 * chroma} for {width}x{height}")
    return whole[:luma], whole[luma : luma + chroma], whole[luma + chroma :]


def encode_jpeg(texture: Texture, quality: int = 90) -> bytes:
    """JFIF bytes (4:2:0) of a texture; the GIL is released while it is encoded."""
    (h, w), half = texture.y.shape, texture.cb.shape
    # The encoder reads whole blocks of 2 x 2 pixels, so it reads beyond a plane of odd size.
    y, cb, cr = np.empty((2 * half[0], 2 * half[1]), np.uint8), np.empty(half, np.uint8), np.empty(half, np.uint8)
    kernels.jpeg_planes(texture.y, texture.cb, texture.cr, y, cb, cr)
    data: bytes = simplejpeg.encode_jpeg_yuv_planes(y[:h, :w], cb, cr, quality=quality, fastdct=True)
    return data


def encode_rgb_jpeg(rgb: npt.NDArray[np.uint8], quality: int) -> bytes:
    """JFIF bytes of R'G'B' uint8 [h, w, 3], with chroma at full resolution (4:4:4)."""
    data: bytes = simplejpeg.encode_jpeg(rgb, quality=quality, colorspace="RGB", colorsubsampling="444", fastdct=False)
    return data


def decode_jpeg(data: bytes | memoryview, height: int, width: int) -> Texture:
    """The texture of a JPEG picture; raises ValueError if the data is not one or its size differs."""
    try:
        size = tuple(simplejpeg.decode_jpeg_header(data)[:2])
        if size == (height, width):
            # Chroma samples are repeated, not interpolated: their mean restores the coded sample.
            return from_rgb(simplejpeg.decode_jpeg(data, "RGB", fastupsample=True))
    except ValueError as error:
        raise ValueError(f"texture: {len(data)} bytes: expected a JPEG picture ({error})") from error
    raise ValueError(f"texture: {size[1]}x{size[0]}: expected {width}x{height}")


def write_png(path: str | PathLike[str], texture: Texture) -> None:
    """Write a texture as an 8-bit RGB PNG."""
    Image.fromarray(to_rgb(texture)).save(path)
