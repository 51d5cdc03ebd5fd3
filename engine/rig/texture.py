"""Colour conversion, JPEG and PNG of textures (BT.709 limited-range Y'CbCr 4:2:0, 10 bits)."""

from __future__ import annotations

from os import PathLike

import numpy as np
import numpy.typing as npt
import simplejpeg
from PIL import Image

from ..kernels.base.tone import tone_picture
from ..kernels.rendering import colour as kernels
from .frame import Texture

__all__ = ["decode_jpeg", "empty_texture", "encode_jpeg", "from_rgb", "to_rgb", "toned_texture", "write_png"]


def empty_texture(height: int, width: int) -> Texture:
    """A texture with planes of undefined content, pixels."""
    chroma = ((height + 1) // 2, (width + 1) // 2)
    return Texture(
        np.empty((height, width), np.uint16), np.empty(chroma, np.uint16), np.empty(chroma, np.uint16)
    )


def to_rgb(texture: Texture) -> npt.NDArray[np.uint8]:  # [h, w, 3]
    """8-bit R'G'B' of a texture, clipped to the gamut."""
    rgb = np.empty((*texture.y.shape, 3), np.uint8)
    kernels.rgb_from_ycbcr(texture.y, texture.cb, texture.cr, rgb)
    return rgb


def from_rgb(rgb: npt.NDArray[np.uint8]) -> Texture:  # [h, w, 3]
    """A texture of an 8-bit R'G'B' picture; chroma is the mean of two by two pixels."""
    texture = empty_texture(*rgb.shape[:2])
    kernels.ycbcr_from_rgb(rgb, texture.y, texture.cb, texture.cr)
    return texture


def encode_jpeg(texture: Texture, quality: int = 90) -> bytes:
    """JFIF bytes (4:2:0) of a texture; the GIL is released meanwhile."""
    (h, w), half = texture.y.shape, texture.cb.shape
    # The encoder reads whole blocks of 2 x 2 pixels, beyond a plane of odd size, too.
    y, cb, cr = np.empty((2 * half[0], 2 * half[1]), np.uint8), np.empty(half, np.uint8), np.empty(half, np.uint8)
    kernels.jpeg_planes(texture.y, texture.cb, texture.cr, y, cb, cr)
    data: bytes = simplejpeg.encode_jpeg_yuv_planes(y[:h, :w], cb, cr, quality=quality, fastdct=True)
    return data


def decode_jpeg(data: bytes | memoryview, height: int, width: int) -> Texture:
    """The texture of a JPEG picture; raises ValueError where it is none or has another size."""
    try:
        size = tuple(simplejpeg.decode_jpeg_header(data)[:2])
        if size == (height, width):
            # Chroma samples are repeated, not interpolated: their mean gives back what was coded.
            return from_rgb(simplejpeg.decode_jpeg(data, "RGB", fastupsample=True))
    except ValueError as error:
        raise ValueError(f"texture: {len(data)} bytes: expected a JPEG picture ({error})") from error
    raise ValueError(f"texture: {size[1]}x{size[0]}: expected {width}x{height}")


def toned_texture(texture: Texture, tone: npt.ArrayLike) -> Texture:
    """A texture in another tone, packed as `kernels.base.tone` has it."""
    out = empty_texture(*texture.y.shape)
    tone_picture(np.asarray(tone, np.float64), texture.y, texture.cb, texture.cr, out.y, out.cb, out.cr)
    return out


def write_png(path: str | PathLike[str], texture: Texture) -> None:
    """Write a texture as an 8-bit RGB PNG."""
    Image.fromarray(to_rgb(texture)).save(path)
