"""Views at reduced sizes, for pictures that are coarser than the views: a texel covers about as much as a pixel.

This is prefiltering as in mip maps (Williams 1983), but by surfaces: colours are averaged only on one side of a depth
edge.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..kernels.geometry import minify as kernels
from ..rig.camera import Camera, Perspective, Projection
from ..support.array_types import U16
from .triangulation import TriangulationOptions, depth_cuts

__all__ = ["MOST_LEVELS", "Level", "halved", "level_for"]

MOST_LEVELS = 3  # smaller than the full size
# Largest size of a texel, in pixels. Up to this size, the gain from less aliasing is greater than the loss by blur.
_LARGEST_PX = 1.15


@dataclass(frozen=True, slots=True)
class Level:
    """A view at one size: its camera, depth codes, colour planes and cuts (see `depth_cuts`).

    codes, y and cuts are [h, w]. cb and cr have half that size at the view's full size (4:2:0), and are [h, w] at
    reduced sizes.
    """

    camera: Camera
    codes: U16
    y: U16
    cb: U16
    cr: U16
    cuts: npt.NDArray[np.uint8]

    @property
    def subsampled(self) -> bool:
        """Whether chroma is 4:2:0."""
        return self.cb.shape != self.y.shape


def level_for(ratio: float) -> int:
    """The level for a picture; `ratio` is view pixels per picture pixel. Below 1.74 it is 0, the full size."""
    return min(max(math.floor(math.log2(_LARGEST_PX * ratio)), 0), MOST_LEVELS)


def halved(level: Level, options: TriangulationOptions) -> Level | None:
    """The next level; None if width or height is odd or less than 4.

    The chroma planes of a 4:2:0 level are taken over as they are: they have the size of the next level, and each
    sample is already the mean of 2 x 2 pixels.
    """
    h, w = level.y.shape
    if h % 2 or w % 2 or min(h, w) < 4:
        return None
    codes, masks = np.empty((h // 2, w // 2), np.uint16), np.empty((h // 2, w // 2), np.uint8)
    kernels.halve_codes(level.codes, level.cuts, codes, masks)
    y, cb, cr = (
        plane if plane.shape == codes.shape else _mean(plane, masks) for plane in (level.y, level.cb, level.cr)
    )
    camera = _halved_camera(level.camera)
    return Level(camera, codes, y, cb, cr, depth_cuts(camera, codes, options))


def _mean(plane: U16, masks: npt.NDArray[np.uint8]) -> U16:
    out = np.empty(masks.shape, np.uint16)
    kernels.halve_plane(plane, masks, out)
    return out


def _halved_camera(camera: Camera) -> Camera:
    """The camera with half the width and height, which are even."""
    p = camera.projection
    width, height = p.width // 2, p.height // 2
    if isinstance(p, Perspective):
        smaller: Projection = Perspective(width, height, 0.5 * p.fx, 0.5 * p.fy, 0.5 * p.cx, 0.5 * p.cy)
    else:
        smaller = dataclasses.replace(p, width=width, height=height)
    return dataclasses.replace(camera, projection=smaller)
