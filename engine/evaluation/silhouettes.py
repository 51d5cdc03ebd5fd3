"""Silhouettes and thin structures of rendered pictures against a twin's ground truth with 4x4 samples per pixel.

A silhouette is fattened where more of a pixel's light comes from the near side than in the truth, and thinned where
less does. Light is compared, not luma: a twin's pixel is the mean light of its samples, coded with a gamma of 2.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..kernels.evaluation.silhouettes import FINE, silhouette_offsets, thin_structures
from ..rig.camera import Camera
from ..rig.frame import Texture, View
from ..support.array_types import F64

__all__ = ["SilhouetteFigures", "fine_camera", "judge_silhouettes"]


STEP = 0.05  # relative step of disparity from sample to sample that makes a silhouette
CONTRAST = 0.05  # least difference in light between the two sides, as a share of white
BLACK, WHITE = 64, 940  # codes of luma
THIN_PX = 2  # structures up to this width are thin
_NEIGHBOURS = 4  # pixels: reach of the square around a silhouette pixel whose mean is the silhouette's smooth course


@dataclass(frozen=True, slots=True)
class SilhouetteFigures:
    """Figures of a picture; nan where there is nothing to measure.

    bias_px: mean displacement of silhouettes outwards, pixels; above 0 they are fattened. roughness_px: RMS about the
    local mean (serration). silhouettes: number of pixels where a displacement was measured. thin_pixels: number of
    pixels whose middle shows a thin structure; thin: the share of these that were rendered at its depth.
    """

    bias_px: float
    roughness_px: float
    silhouettes: int
    thin: float
    thin_pixels: int


def fine_camera(camera: Camera) -> Camera:
    """The camera with 4x4 pixels in place of one: silhouettes are judged by its ground truth."""
    return dataclasses.replace(camera, projection=camera.projection.scaled(FINE))


def judge_silhouettes(fine: View, texture: Texture, rendered: npt.NDArray[np.floating]) -> SilhouetteFigures:
    """Figures of a rendered picture.

    fine: ground truth of the picture's `fine_camera`. texture: the picture. rendered: its disparity [h, w], 1/m, 0 for
    holes. Raises ValueError if the sizes do not fit.
    """
    h, w = rendered.shape
    if fine.codes.shape != (FINE * h, FINE * w):
        raise ValueError(f"fine: {fine.codes.shape[::-1]}: expected {FINE} times the picture's {(w, h)}")
    disparity = fine.camera.depth.disparity(fine.codes)
    light = _light(fine.texture).reshape(h, FINE, w, FINE).mean(axis=(1, 3))
    offsets = silhouette_offsets(disparity, light, _light(texture), STEP, CONTRAST)
    bias, roughness, count = _bias_and_roughness(offsets)
    found = _thin(disparity, rendered)
    return SilhouetteFigures(bias, roughness, count, float(found.mean()) if found.size else math.nan, found.size)


def _light(texture: Texture) -> F64:
    """Light of a texture's luma codes [h, w]: 0 for black, 1 for white."""
    light: F64 = np.maximum((texture.y.astype(np.float64) - BLACK) / (WHITE - BLACK), 0.0) ** 2
    return light


def _bias_and_roughness(offsets: F64) -> tuple[float, float, int]:
    """Mean of the offsets [h, w] that are not nan, their RMS about the mean of their neighbours, and their number."""
    there = ~np.isnan(offsets)
    counts, sums = _box_sums(there.astype(float)), _box_sums(np.where(there, offsets, 0.0))
    count = int(np.count_nonzero(there))
    near = there & (counts > _NEIGHBOURS)
    if not near.any():
        return (float(offsets[there].mean()) if count else math.nan), math.nan, count
    n = counts[near]
    # The mean of n values includes the value itself, which reduces the variance by 1/n of it.
    squares = (offsets[near] - sums[near] / n) ** 2 * n / (n - 1)
    return float(offsets[there].mean()), math.sqrt(float(squares.mean())), count


def _box_sums(values: F64) -> F64:
    """Sums over a square around each pixel, with sides of 2 _NEIGHBOURS + 1 pixels."""
    for axis in (0, 1):
        margin = [(_NEIGHBOURS + 1, _NEIGHBOURS) if a == axis else (0, 0) for a in (0, 1)]
        total = np.cumsum(np.pad(values, margin), axis=axis)
        size = 2 * _NEIGHBOURS + 1
        ends, starts = np.split(total, [size], axis)[1], np.split(total, [total.shape[axis] - size], axis)[0]
        values = ends - starts
    return values


def _thin(disparity: F64, rendered: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
    """For each pixel whose middle shows a thin structure, whether the rendered surface there is at its depth."""
    behind = thin_structures(disparity, STEP, THIN_PX * FINE)
    h, w = rendered.shape
    middle = slice(FINE // 2 - 1, FINE // 2 + 1)
    squares = [a.reshape(h, FINE, w, FINE)[:, middle, :, middle] for a in (behind, disparity)]
    is_thin = squares[0].min(axis=(1, 3)) > 0
    level = 0.5 * (squares[0].max(axis=(1, 3)) + squares[1].mean(axis=(1, 3)))
    survived: npt.NDArray[np.bool_] = rendered[is_thin] > level[is_thin]
    return survived
