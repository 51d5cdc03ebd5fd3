"""Smoothing of outlines in a finished picture: see `kernels.rendering.morphology`."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..kernels.rendering.morphology import SPAN, blend_steps, mark_steps
from ..rig.frame import Texture

__all__ = ["smooth_outlines"]


def smooth_outlines(texture: Texture, disparity: npt.NDArray[np.float32], edge: float) -> Texture:
    """A picture in which pixels at outlines are blended by the area that each side covers.

    disparity [h, w] in 1/m, 0 in holes; `edge`: the disparity step at which the target's meshes are cut, 1/m.
    """
    h, w = disparity.shape
    marks, found = np.empty((h, w), np.uint8), np.empty((h, math.ceil(w / SPAN)), np.uint8)
    mark_steps(disparity, edge, marks, found)
    if not found.any():
        return texture
    planes = (texture.y, texture.cb, texture.cr)
    outs = tuple(plane.copy() for plane in planes)
    blend_steps(marks, found, planes, outs)
    return Texture(*outs)
