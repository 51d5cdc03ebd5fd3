"""3D effects as pictures are drawn with them: projected pictures with their shadow maps, and placed meshes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..kernels.rendering import projector as kernels
from ..kernels.rendering.added_mesh import ColouredTriangles
from ..kernels.rendering.colour import BLACK, BLUE_709, GREY, LUMA_709, RED_709, SWING, WHITE
from ..kernels.rendering.projector import OPAQUE, ProjectedPicture
from ..rig.frame import Texture
from ..support.array_types import I64, U8, U16

__all__ = ["Effects", "PictureLevels", "levels_of_rgba", "levels_of_texture"]


@dataclass(frozen=True, slots=True, eq=False)
class Effects:
    """What pictures show besides the scene: projectors in the order in which they shine, and added meshes."""

    projectors: tuple[ProjectedPicture, ...] = ()
    meshes: tuple[ColouredTriangles, ...] = ()


class PictureLevels(NamedTuple):
    """A picture in its own size and in halves of it, as `ProjectedPicture` has it."""

    texels: U16
    levels: I64

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the whole size, pixels."""
        return int(self.levels[0, kernels.PIXELS_WIDE]), int(self.levels[0, kernels.PIXELS_HIGH])


def levels_of_rgba(rgba: U8) -> PictureLevels:
    """The levels of an R'G'B' picture with alpha, uint8 [h, w, 4]."""
    picture = _empty(*rgba.shape[:2])
    red, green, blue, alpha = (rgba[..., k].astype(np.float32) / 255.0 for k in range(4))
    luma = LUMA_709[0] * red + LUMA_709[1] * green + LUMA_709[2] * blue
    planes = (
        BLACK + (WHITE - BLACK) * luma, GREY + SWING * (blue - luma) / BLUE_709, GREY + SWING * (red - luma) / RED_709
    )  # fmt: skip
    count = rgba.shape[0] * rgba.shape[1]
    for k, plane in enumerate((*(alpha * plane for plane in planes), OPAQUE * alpha)):
        picture.texels[:count, k] = np.rint(plane).ravel()
    return _filled(picture)


def levels_of_texture(texture: Texture) -> PictureLevels:
    """The levels of a view's picture."""
    picture = _empty(*texture.y.shape)
    kernels.take_planes(texture.y, texture.cb, texture.cr, picture.texels)
    return _filled(picture)


def _empty(height: int, width: int) -> PictureLevels:
    rows, first, w, h = [], 0, width, height
    while True:
        rows.append((first, w, h))
        first += w * h
        if max(w, h) == 1:
            break
        w, h = math.ceil(w / 2), math.ceil(h / 2)
    return PictureLevels(np.empty((first, 4), np.uint16), np.array(rows, np.int64))


def _filled(picture: PictureLevels) -> PictureLevels:
    """The picture, with all levels made from the first."""
    for number in range(1, len(picture.levels)):
        kernels.halve(picture.texels, picture.levels[number - 1], picture.levels[number])
    return picture
