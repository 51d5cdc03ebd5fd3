"""Colour conversion of textures (BT.709 limited-range Y'CbCr 4:2:0, 10 bits)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..kernels.base.tone import tone_picture
from ..kernels.rendering import colour as kernels
from .frame import Texture

__all__ = ["empty_texture", "from_rgb", "to_rgb", "toned_texture"]


def empty_texture(height: int, width: int) -> Texture:
    """A texture of `height` x `width` pixels with undefined content."""
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
    """A texture of an 8-bit R'G'B' picture; chroma is the mean of 2 x 2 pixels."""
    texture = empty_texture(*rgb.shape[:2])
    kernels.ycbcr_from_rgb(rgb, texture.y, texture.cb, texture.cr)
    return texture


def toned_texture(texture: Texture, tone: npt.ArrayLike) -> Texture:
    """A copy of a texture with a tone applied: float64 [TONE_SIZE], packed as in `kernels.base.tone`."""
    out = empty_texture(*texture.y.shape)
    tone_picture(np.asarray(tone, np.float64), texture.y, texture.cb, texture.cr, out.y, out.cb, out.cr)
    return out
