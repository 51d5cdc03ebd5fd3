"""R'G'B' and linear light (IEC 61966-2-1, sRGB), from 0 to 1."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..support.array_types import F32, F64

__all__ = ["encoded", "linear"]


def encoded(light: F32) -> F32:
    """Linear light as R'G'B'; what is outside 0 to 1 is clipped."""
    clipped = np.clip(light.astype(np.float64), 0.0, 1.0)
    out: F32 = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055).astype(np.float32)
    return out


def linear(rgb: npt.NDArray[np.floating]) -> F64:
    """R'G'B' as linear light."""
    code = rgb.astype(np.float64)
    light: F64 = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return light
