"""The background model over every frame of a twin: its benefit in pictures, and its own error.

Pictures from few views with the model are compared with pictures without it: whole (IV-PSNR), and in the *uncovered*
pixels only. In an uncovered pixel of the virtual camera the ground truth is background that someone hid in the first
frame, and the warped views leave a hole. The error there is the squared error of Y, Cb and Cr, weighted 4:1:1 as in
IV-PSNR, to the best match among the 5x5 pixels around, because estimated depth moves a texture by a pixel.

The model itself, seen from the virtual camera, is compared with the scene without its people: by the RMS distance along
the rays, and by the RMS difference of luma. Only pixels away from the truth's depth edges count where the model shows
the same surface, that is, within its own delta. (People who have not moved on are rightly in the model.)
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..background.model import BackgroundModel
from ..pipeline.engine import Engine
from ..rig.camera import Camera, Equirectangular
from ..rig.frame import Texture, View
from ..settings import Settings
from ..synth import FPS, Twin, render_view, twin_frame
from .metrics import iv_psnr

__all__ = ["ModelError", "WorthSample", "beside_edges", "model_error", "uncovered_psnr", "watch_noise"]

Bools = npt.NDArray[np.bool_]
_SHIFT = 2  # largest distance of a match along rows and columns, pixels, as in IV-PSNR
_EDGE_SHARE = 0.02  # step between neighbours of the true background that is an edge, as a share of the depth


@dataclass(frozen=True, slots=True)
class ModelError:
    """The model against the true background.

    surface_m, surface_delta: RMS distance in metres, and as a share of delta. colour: RMS difference of luma, 10-bit
    codes; colour_once_hidden: the same, only over pixels that someone hid in the first frame. other: fraction of the
    pixels where the model shows another surface, nearer or farther by more than delta. holes: where it shows nothing.
    """

    surface_m: float
    surface_delta: float
    colour: float
    colour_once_hidden: float
    other: float
    holes: float


@dataclass(frozen=True, slots=True)
class WorthSample:
    """One virtual camera at one frame.

    model, without: IV-PSNR with and without the model, dB. uncovered: fraction of the pixels that are uncovered;
    uncovered_model, uncovered_without: their PSNR with and without the model, dB. triangles: of the model. error: the
    model's own error, in the frames where it is measured.
    """

    camera: str
    frame: int
    model: float
    without: float
    uncovered: float
    uncovered_model: float
    uncovered_without: float
    triangles: int
    error: ModelError | None


def watch_noise(
    twin: Twin, cameras: Sequence[Camera], frames: int, every: int, settings: Settings
) -> Iterator[WorthSample]:
    """Play `frames` frames of a twin, rendered in memory, with and without the model; yields a sample per camera.

    The model's own error is measured in every `every`-th frame and in the last.
    """
    engine = Engine(twin.sources, settings, f_vin=FPS)
    plain = Engine(twin.sources, dataclasses.replace(settings, background=False), f_vin=FPS)
    still = {c.name: render_view(twin.scene, c, 0.0, background_only=True) for c in cameras}
    hidden = {c.name: twin.truth(c, 0).codes != still[c.name].codes for c in cameras}
    for index in range(frames):
        frame = twin_frame(twin, index)
        engine.update(frame, {c.name: c for c in cameras})
        plain.update(frame)
        model = engine.model
        assert model is not None
        for camera in cameras:
            truth, background = twin.truth(camera, index), still[camera.name]
            with_model, alone = engine.render_camera(camera, camera.name), plain.render_camera(camera)
            uncovered = hidden[camera.name] & (truth.codes == background.codes) & alone.holes(warped=True)
            error = None
            if index % every == 0 or index == frames - 1:
                error = model_error(model, background, hidden[camera.name])
            counts, erp = model.counts(), _erp(camera)
            yield WorthSample(
                camera.name, index, iv_psnr(truth.texture, with_model.texture, erp),
                iv_psnr(truth.texture, alone.texture, erp), float(uncovered.mean()),
                uncovered_psnr(truth.texture, with_model.texture, uncovered),
                uncovered_psnr(truth.texture, alone.texture, uncovered),
                counts["s_pbs_valid"] + counts["p_pbs"], error,
            )  # fmt: skip


def _erp(camera: Camera) -> tuple[float, float] | None:
    p = camera.projection
    if not isinstance(p, Equirectangular):
        return None
    return math.degrees(np.ptp(p.hor_range)), math.degrees(np.ptp(p.ver_range))


def uncovered_psnr(truth: Texture, test: Texture, where: Bools) -> float:
    """PSNR of 10-bit codes, dB, in the pixels of the mask `where` [h, w], each to its best match; nan for no pixel."""
    if not where.any():
        return math.nan
    h, w = where.shape
    wanted, found = _planes(truth), np.pad(_planes(test), ((0, 0), (_SHIFT, _SHIFT), (_SHIFT, _SHIFT)), mode="edge")
    least = np.full(int(where.sum()), np.inf)
    for dy in range(2 * _SHIFT + 1):
        for dx in range(2 * _SHIFT + 1):
            difference = (found[:, dy : dy + h, dx : dx + w] - wanted)[:, where]
            least = np.minimum(least, np.array([4, 1, 1]) / 6 @ difference**2)
    return 10 * math.log10(1023**2 / max(float(least.mean()), 1e-2))


def _planes(texture: Texture) -> npt.NDArray[np.float64]:  # [3, h, w]
    h, w = texture.y.shape
    chroma = (plane.repeat(2, 0).repeat(2, 1)[:h, :w] for plane in (texture.cb, texture.cr))
    return np.stack([texture.y, *chroma]).astype(np.float64)


def model_error(model: BackgroundModel, background: View, once_hidden: Bools) -> ModelError:
    """Compare the model with `background`, a ground-truth view of the scene without people.

    `once_hidden` [h, w]: the pixels that someone hid in the first frame.
    """
    camera = background.camera
    coding = dataclasses.replace(camera.depth, has_invalid=True, bits=16)
    found = model.render_pbi(dataclasses.replace(camera, depth=coding)).view
    there, true = coding.depth(found.codes), camera.depth.depth(background.codes)
    inside = ~beside_edges(true)
    off = there - true
    delta = model.tolerances.delta_at(true)
    same = inside & (np.abs(np.nan_to_num(off, nan=np.inf)) <= delta)
    luma = found.texture.y.astype(np.float64) - background.texture.y
    surface = _rms(off[same])
    return ModelError(
        surface, _rms(off[same] / delta[same]), _rms(luma[same]), _rms(luma[same & once_hidden]),
        float((inside & ~same & (found.codes > 0)).mean()), float((found.codes == 0).mean()),
    )  # fmt: skip


def beside_edges(depth: npt.NDArray[np.float64]) -> Bools:
    """Mask [h, w] of pixels whose depth differs from a horizontal or vertical neighbour's by an edge's step."""
    edges = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(np.log(depth), axis=axis)) > _EDGE_SHARE
        before, after = [slice(None)] * 2, [slice(None)] * 2
        before[axis], after[axis] = slice(None, -1), slice(1, None)
        edges[tuple(before)] |= step
        edges[tuple(after)] |= step
    return edges


def _rms(values: npt.NDArray[np.floating]) -> float:
    return math.sqrt(float(np.mean(values.astype(np.float64) ** 2))) if values.size else math.nan
