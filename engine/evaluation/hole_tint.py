"""Pictures in which people can see the holes."""

from __future__ import annotations

from ..rig.texture import to_rgb
from ..rig.viewer import RenderedPicture
from ..support.array_types import U8

__all__ = ["HOLE_RGB", "tinted"]

HOLE_RGB = (150, 215, 255)  # light blue, as in the paper's figures


def tinted(picture: RenderedPicture) -> U8:  # [h, w, 3]
    """A picture in R'G'B'; its holes, in which nothing was drawn, are light blue, whether they were filled or not."""
    rgb = to_rgb(picture.texture)
    rgb[picture.holes()] = HOLE_RGB
    return rgb
