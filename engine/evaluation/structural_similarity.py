"""SSIM, MS-SSIM, IV-SSIM and IV-MS-SSIM as MPEG's present quality tool (QMIV 3) computes them with its defaults.

Windows are blocks of 8 x 8 pixels, four pixels apart; all pixels have one weight. Chroma is compared at luma resolution
(replicated). A picture's figure is the mean of its planes' figures, weighted Y:Cb:Cr = 4:1:1.
MS: the picture is halved again and again, to at most five scales, while its sides have at least 32 pixels. Contrast and
structure are compared at each scale, luminance at the coarsest, with the exponents of Wang et al. (Asilomar 2003); with
fewer scales the exponents are divided by their sum.
IV: before a picture is compared, every pixel of the other is replaced by its best match within two pixels of its place,
and a small global colour difference is forgiven (as in IV-PSNR). The lower figure of the two directions counts.
Dziembowski, Nowak, Stankowski: IV-SSIM, Applied Sciences 14(16), 2024.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..kernels.evaluation.metrics import block_similarity, matched_picture
from ..rig.frame import Texture
from ..support import runtime
from ..support.array_types import F64
from .metrics import K1, K2, WEIGHTS, Erp, check_sizes, colour_shift, full_planes, peak_of, row_weights

__all__ = ["LEAST_PX", "LEAST_SCALED_PX", "Similarity", "structural_similarity"]

Planes = npt.NDArray[np.uint16]  # [3, h, w]

LEAST_PX = 8  # side of a window, pixels
_STRIDE = 4  # pixels from window to window: half a window
LEAST_SCALED_PX = 32  # least side of the coarsest scale, pixels
_EXPONENTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)


@dataclass(frozen=True, slots=True)
class Similarity:
    """Figures of a pair of pictures, at most 1 each.

    ssim, ms_ssim: of Y, Cb and Cr. ms_ssim and iv_ms_ssim are None for pictures with a side of less than 32 pixels.
    """

    ssim: tuple[float, float, float]
    iv_ssim: float
    ms_ssim: tuple[float, float, float] | None
    iv_ms_ssim: float | None

    def figures(self) -> dict[str, float]:
        """All figures by name: ssim and ms_ssim are of the picture; with _y, _cb or _cr they are of a plane."""
        out: dict[str, float] = {}
        for name, planes in (("ssim", self.ssim), ("ms_ssim", self.ms_ssim)):
            if planes is not None:
                out[name] = _picture(np.array(planes))
                out |= {f"{name}_{plane}": value for plane, value in zip(("y", "cb", "cr"), planes, strict=True)}
        out["iv_ssim"] = self.iv_ssim
        return out if self.iv_ms_ssim is None else out | {"iv_ms_ssim": self.iv_ms_ssim}


def structural_similarity(ref: Texture, test: Texture, erp: Erp | None = None, *, bits: int = 10) -> Similarity:
    """All figures of two pictures with codes of `bits` bits.

    With `erp` (degrees) the windows of IV-SSIM are weighted by the solid angle of the pixels in their middle row; the
    tool does not weight the other figures. Raises ValueError if the sizes differ or a side is less than 8 pixels.
    """
    check_sizes(ref, test)
    if min(ref.y.shape) < LEAST_PX:
        raise ValueError(f"picture: {ref.y.shape[::-1]}: expected at least {LEAST_PX} pixels each way for SSIM")
    runtime.require_tbb()
    planes, others, peak = full_planes(ref), full_planes(test), peak_of(bits)
    shift = colour_shift(planes, others, bits)
    moved_ref = matched_picture(others, planes, -shift, WEIGHTS, peak)
    moved_test = matched_picture(planes, others, shift, WEIGHTS, peak)
    weights = None if erp is None else row_weights(ref.y.shape[0], erp)
    pairs = ((others, moved_ref), (planes, moved_test))
    iv = min(_picture(_windows(*pair, peak, weights, luminance=True)) for pair in pairs)
    many = min(ref.y.shape) >= LEAST_SCALED_PX
    return Similarity(
        _three(_windows(planes, others, peak, None, luminance=True)),
        iv,
        _three(_many_scales(planes, others, peak)) if many else None,
        min(_picture(_many_scales(*pair, peak)) for pair in pairs) if many else None,
    )


def _many_scales(a: Planes, b: Planes, peak: int) -> F64:  # [3]
    side, count = min(a.shape[1:]), 1
    while count < len(_EXPONENTS) and side >= LEAST_SCALED_PX << count:
        count += 1
    # Rounded to four decimals, as in the tool.
    exponents = np.round(np.array(_EXPONENTS[:count]) / sum(_EXPONENTS[:count]), 4)
    product = np.ones(3)
    for scale, exponent in enumerate(exponents):
        if scale:
            a, b = _halved(a), _halved(b)
        # Structure may be negative, and a negative number has no such power.
        product *= np.maximum(_windows(a, b, peak, None, luminance=scale == count - 1), 0.0) ** exponent
    return product


def _windows(a: Planes, b: Planes, peak: int, weights: F64 | None, *, luminance: bool) -> F64:  # [3]
    """Mean over the windows of each plane: contrast and structure, times luminance if `luminance`."""
    rows = block_similarity(a, b, _STRIDE, (K1 * peak) ** 2, (K2 * peak) ** 2, luminance)
    middle = np.ones(rows.shape[1]) if weights is None else weights[LEAST_PX // 2 :: _STRIDE][: rows.shape[1]]
    means: F64 = rows @ middle / middle.sum()
    return means


def _halved(planes: Planes) -> Planes:
    """Means of two by two pixels; halves are rounded up."""
    count, h, w = planes.shape[0], planes.shape[1] // 2, planes.shape[2] // 2
    sums = planes[:, : 2 * h, : 2 * w].reshape(count, h, 2, w, 2).sum(axis=(2, 4), dtype=np.uint32)
    halved: Planes = ((sums + 2) >> 2).astype(np.uint16)
    return halved


def _picture(planes: F64) -> float:
    """The figure of a picture from those of its planes."""
    return float(WEIGHTS @ planes / WEIGHTS.sum())


def _three(planes: F64) -> tuple[float, float, float]:
    y, cb, cr = planes.tolist()
    return y, cb, cr
