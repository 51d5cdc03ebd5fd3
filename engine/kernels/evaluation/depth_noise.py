"""The errors of estimated depth: correlated noise of the codes, and depth edges that differ from the texture's."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ..base.jit import parallel
from ..synth.patterns import value_noise

__all__ = ["perturb_codes"]

CodeArray = npt.NDArray[np.uint16]


@parallel
def perturb_codes(
    codes: CodeArray, frame: int, seed: int, shift_px: float, error: float, max_code: int, out: CodeArray
) -> None:
    """Write depth codes [h, w] with errors to `out`.

    Codes are taken from up to `shift_px` pixels away, so that edges move, and are off by up to `error` codes. Both
    errors vary smoothly over the picture; a part of them changes from frame to frame.
    """
    height, width = codes.shape
    cell = width / 40.0
    for y in numba.prange(height):
        for x in range(width):
            u, v, time = x / cell, y / cell, 0.35 * frame
            across = value_noise(4.0 * u, 4.0 * v, time, seed + 1)
            down = value_noise(4.0 * u, 4.0 * v, time, seed + 2)
            source_x = min(max(int(np.rint(x + shift_px * across)), 0), width - 1)
            source_y = min(max(int(np.rint(y + shift_px * down)), 0), height - 1)
            wave = 0.4 * value_noise(u, v, 0.0, seed + 3) + 0.4 * value_noise(
                2.0 * u, 2.0 * v, time, seed + 4
            )
            grain = 0.2 * value_noise(8.0 * u, 8.0 * v, 3.0 * time, seed + 5)
            code = np.rint(codes[source_y, source_x] + error * (wave + grain))
            out[y, x] = np.uint16(min(max(code, 0.0), float(max_code)))
