"""The triangle filter (section 3.3.3, Fig. 6b): only surfaces more than delta behind the PBS become part of it."""

from __future__ import annotations

import numpy as np

from ..kernels.background.triangle_filter import ACCEPTED, CANDIDATES, CHANGED, LONE, RAYS
from ..kernels.base.tolerance import Delta
from ..support.array_types import B1
from .capture import Capture
from .maximum_depth import BLOCK
from .ray_tracer import RayTracer
from .report import UpdateReport

__all__ = ["filter_updated"]


def filter_updated(
    tracer: RayTracer, capture: Capture, delta: Delta, neighbours: int, report: UpdateReport
) -> B1:
    """Filters the pixels of a maximum depth image that were updated since its camera's last turn. It keeps an accepted
    pixel if at least `neighbours` of its eight neighbours are accepted or kept as well. Returns the blocks
    (`maximum_depth.BLOCK`) in which pixels were accepted, or pixels that were kept before have changed."""
    image = capture.image
    blocks = np.argwhere(image.pending | image.lone)
    counts = tracer.filter_pixels(capture, delta, neighbours, blocks, BLOCK)
    image.pending[:] = False
    image.lone[tuple(blocks.T)] = counts[:, LONE] > 0  # lone pixels wait until they have enough neighbours
    totals = counts.sum(axis=0)
    report.candidates += int(totals[CANDIDATES])
    report.accepted += int(totals[ACCEPTED])
    report.rays += int(totals[RAYS])
    where = np.zeros(image.pending.shape, bool)
    where[tuple(blocks.T)] = counts[:, [ACCEPTED, CHANGED]].any(axis=1)
    return where
