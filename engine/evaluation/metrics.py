"""Objective quality: PSNR, WS-PSNR and IV-PSNR, as MPEG's IV-PSNR tool prints them, and SSIM as first published.

Pictures are 4:2:0 `Texture`s with codes of `bits` bits. Chroma is compared at luma resolution (replicated), so every
plane has N pixels, as many as luma. A summed error of 0 counts as 1, so identical planes have 10 log10(N peak^2) dB.
IV-PSNR: Dziembowski et al., IEEE TCSVT 32(11), 2022. SSIM: Wang et al., IEEE TIP 13(4), 2004.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..kernels.evaluation.metrics import match_errors, similarity_rows
from ..rig.camera import Camera, Equirectangular
from ..rig.frame import Texture
from ..support import runtime
from ..support.array_types import F64

__all__ = ["Erp", "erp_range", "iv_psnr", "psnr", "ssim", "ws_psnr"]

WEIGHTS = np.array([4, 1, 1])  # weights of Y, Cb, Cr in the search for matches and in the mean of their PSNRs
UNNOTICEABLE = 0.01  # the largest global colour difference that is forgiven, as a share of the peak
WINDOW, SIGMA, K1, K2 = 11, 1.5, 0.01, 0.03  # SSIM: window side and standard deviation in pixels, constants

Erp = tuple[float, float]  # horizontal and vertical range of an equirectangular picture, degrees


def erp_range(camera: Camera) -> Erp | None:
    """Horizontal and vertical range of an equirectangular camera in degrees; None for other cameras."""
    p = camera.projection
    if not isinstance(p, Equirectangular):
        return None
    return math.degrees(float(np.ptp(p.hor_range))), math.degrees(float(np.ptp(p.ver_range)))


def psnr(ref: Texture, test: Texture, *, bits: int = 10) -> tuple[float, float, float]:
    """PSNR of Y, Cb and Cr, dB. Raises ValueError if the sizes differ."""
    return _plane_psnrs(_row_errors(ref, test).sum(axis=0), ref, bits)


def ws_psnr(ref: Texture, test: Texture, erp: Erp, *, bits: int = 10) -> tuple[float, float, float]:
    """PSNR of Y, Cb and Cr with rows weighted by the solid angle of their pixels, dB.

    Raises ValueError if the sizes differ, or for a range in `erp` that no sphere has.
    """
    weights = row_weights(ref.y.shape[0], erp)
    errors = weights @ _row_errors(ref, test) * (len(weights) / weights.sum())
    return _plane_psnrs(errors, ref, bits)


def iv_psnr(ref: Texture, test: Texture, erp: Erp | None = None, *, bits: int = 10) -> float:
    """IV-PSNR, dB: forgives a small global colour difference and shifts of up to two pixels.

    With `erp`, rows are weighted by the solid angle of their pixels. Raises ValueError as `ws_psnr` does.
    """
    check_sizes(ref, test)
    runtime.require_tbb()
    planes, others = full_planes(ref), full_planes(test)
    shift = colour_shift(planes, others, bits)
    weights = np.ones(ref.y.shape[0]) if erp is None else row_weights(ref.y.shape[0], erp)
    both = (match_errors(planes, others, shift, WEIGHTS), match_errors(others, planes, -shift, WEIGHTS))
    qualities = [np.array(_plane_psnrs(weights @ rows, ref, bits)) for rows in both]
    return float(min(WEIGHTS @ quality for quality in qualities) / WEIGHTS.sum())


def ssim(ref: Texture, test: Texture, *, bits: int = 10) -> float:
    """Mean structural similarity of luma, at most 1: Gaussian windows that lie inside the picture, no down-sampling.

    Raises ValueError if the sizes differ, or if a side is shorter than the window's 11 pixels.
    """
    check_sizes(ref, test)
    if min(ref.y.shape) < WINDOW:
        raise ValueError(f"picture: {ref.y.shape[::-1]}: expected at least {WINDOW} pixels each way for SSIM")
    runtime.require_tbb()
    offsets = np.arange(WINDOW) - WINDOW // 2
    window = np.exp(-(offsets**2) / (2 * SIGMA**2))
    rows = similarity_rows(ref.y, test.y, window / window.sum(), (K1 * peak_of(bits)) ** 2, (K2 * peak_of(bits)) ** 2)
    return float(rows.sum() / (rows.size * (ref.y.shape[1] - WINDOW + 1)))


def colour_shift(planes: npt.NDArray[np.uint16], others: npt.NDArray[np.uint16], bits: int) -> npt.NDArray[np.int64]:
    """Codes [3] to add to the first planes [3, h, w] so that their means match the second's, within UNNOTICEABLE."""
    limit = round(UNNOTICEABLE * peak_of(bits))
    means = (others.mean(axis=(1, 2), dtype=np.float64) - planes.mean(axis=(1, 2), dtype=np.float64)).tolist()
    return np.array([max(-limit, min(limit, _round(mean))) for mean in means])


def _row_errors(ref: Texture, test: Texture) -> npt.NDArray[np.int64]:  # [h, 3]
    """Squared errors of Y, Cb and Cr, summed over each row."""
    check_sizes(ref, test)
    difference = full_planes(ref).astype(np.int64) - full_planes(test)
    errors: npt.NDArray[np.int64] = np.einsum("chw,chw->hc", difference, difference)
    return errors


def full_planes(texture: Texture) -> npt.NDArray[np.uint16]:  # [3, h, w]
    """All planes at luma resolution."""
    h, w = texture.y.shape
    chroma = [plane.repeat(2, 0).repeat(2, 1)[:h, :w] for plane in (texture.cb, texture.cr)]
    return np.stack([texture.y, *chroma])


def row_weights(height: int, erp: Erp) -> F64:  # [h]
    """Cosines of the rows' elevations, for a range centred on the horizon; ValueError for an impossible range."""
    if not (0 < erp[0] <= 360 and 0 < erp[1] <= 180):
        raise ValueError(f"erp: {erp!r}: expected horizontal and vertical ranges up to 360 and 180 degrees")
    elevations = ((np.arange(height) + 0.5) / height - 0.5) * math.radians(erp[1])
    return np.cos(elevations)


def _plane_psnrs(errors: npt.NDArray[np.number], ref: Texture, bits: int) -> tuple[float, float, float]:
    signal = ref.y.size * peak_of(bits) ** 2
    y, cb, cr = (10 * math.log10(signal / (float(error) or 1.0)) for error in errors)
    return y, cb, cr


def peak_of(bits: int) -> int:
    """The largest code of `bits` bits."""
    return (1 << bits) - 1


def _round(value: float) -> int:
    """Round halves away from zero, so that both directions get the same shift."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def check_sizes(ref: Texture, test: Texture) -> None:
    """Raises ValueError if the sizes of the two pictures differ."""
    if ref.y.shape != test.y.shape:
        size, expected = test.y.shape[::-1], ref.y.shape[::-1]
        raise ValueError(f"test picture: {size}: expected the reference's size {expected}")
