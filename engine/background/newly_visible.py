"""Newly visible surfaces in the view of a reference camera that has moved (section 4.2)."""

from __future__ import annotations

import math

import numpy as np

from ..kernels.background.farther_only import BLOCK, DepthView, keep_farther, mark_smooth
from ..kernels.base.tolerance import Delta
from ..support.array_types import U8, U16
from ..support.packed import Coding
from .capture import Capture

__all__ = ["newly_visible"]


def newly_visible(capture: Capture, before: Capture, delta: Delta) -> U8:  # [h, w]
    """1 where a capture, just begun, may show a surface that the same camera's capture `before` does not show; else 0.

    Each pixel is back-projected and projected into the picture of the capture before. If the maximum depth image there
    shows the same surface, within delta, the pixel needs no more processing. Nor does it if that image shows a farther
    surface: then the pixel's surface has come between, and is no background. (The paper only names the first case.)
    Pixels that were still candidates in the capture before count as not seen by it.
    """
    image, coding = before.image, before.image.camera.depth.packed()
    known = coding._replace(least=1, min_code=max(coding.min_code, 1))
    keep = np.ones(image.codes.shape, np.uint8)
    earlier = _depth_view(image.settled_codes(), before, known, delta)
    view = _depth_view(capture.image.codes, capture, coding, delta)
    keep_farther(view, coding, earlier, known, float(image.edge), delta, keep)
    return keep


def _depth_view(codes: U16, capture: Capture, coding: Coding, delta: Delta) -> DepthView:
    blocks = [max(1, math.ceil((size - 1) / BLOCK)) for size in codes.shape]
    smooth = np.empty(blocks, np.uint8)
    mark_smooth(codes, coding, delta, smooth)
    return DepthView(codes, capture.packed, smooth)
