"""The benefit of following exposure: a twin whose views get other exposures and white balances, against its truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..background.exposure import packed
from ..pipeline.engine import Engine
from ..rig.frame import Frame, Texture
from ..rig.texture import toned_texture
from ..settings import Settings
from ..support.array_types import F64
from ..synth import make_twin, twin_frame
from .metrics import iv_psnr, psnr

__all__ = [
    "ExposureReport",
    "ExposureRow",
    "measure_exposure",
    "misexposed",
    "random_tones",
    "tone_errors",
    "without_gain",
]


_REPEATS = 8
_GREY = np.array([438.0, 0.0, 0.0, 1.0])  # the middle of luma's range, relative to black and grey


@dataclass(frozen=True, slots=True)
class ExposureRow:
    """(PSNR-Y, IV-PSNR) in dB of a picture whose gain was fitted to the truth (`without_gain`).

    clean: from unaltered views. off, on: from altered views, without and with following of the exposure.
    """

    camera: str
    clean: tuple[float, float]
    off: tuple[float, float]
    on: tuple[float, float]


@dataclass(frozen=True, slots=True)
class ExposureReport:
    """Rows of all pictures, and the differences between the views.

    before, after: root mean square of the views' differences in Y', Cb and Cr at mid grey, codes [3], without and with
    following. update_ms: milliseconds that following takes for a frame, the least of several.
    """

    rows: list[ExposureRow]
    before: F64
    after: F64
    update_ms: float


def random_tones(count: int, seed: int, gain: float = 0.15, balance: float = 0.04) -> F64:  # [count, 4, 4]
    """`count` random tones: gains of 1 +- gain, tints of up to +- balance, luma offsets of up to 4 codes."""
    rng = np.random.default_rng(seed)
    tones = np.tile(np.eye(4), (count, 1, 1))
    tones[:, [0, 1, 2], [0, 1, 2]] = rng.uniform(1 - gain, 1 + gain, (count, 1))
    tones[:, 1:3, 0] = rng.uniform(-balance, balance, (count, 2))
    tones[:, 0, 3] = rng.uniform(-4.0, 4.0, count)
    return tones


def misexposed(frame: Frame, tones: F64) -> Frame:
    """The frame as n cameras with the tones [n, 4, 4] would have recorded it."""
    views = zip(frame.views, packed(tones), strict=True)
    return replace(frame, views=tuple(replace(view, texture=toned_texture(view.texture, tone)) for view, tone in views))


def tone_errors(tones: F64, truth: F64) -> F64:  # [n, 4, 4] each -> [n, 3]
    """Differences of the n views from their mean at mid grey, in codes of Y', Cb and Cr.

    `truth` holds the tones that the views were given, `tones` those that were found; the latter are removed.
    """
    shown = (np.linalg.inv(tones) @ truth @ _GREY)[:, :3]
    errors: F64 = shown - shown.mean(axis=0)
    return errors


def without_gain(truth: Texture, picture: Texture) -> Texture:
    """The picture times one gain of luma and chroma, chosen so that its luma fits the truth's best (least squares)."""
    y, wanted = picture.y.astype(float) - 64.0, truth.y.astype(float) - 64.0
    return toned_texture(picture, packed(np.diag([*3 * [(y * wanted).sum() / (y * y).sum()], 1.0])[None])[0])


def measure_exposure(name: str, scale: float, quality: str, seed: int = 0) -> ExposureReport:
    """Render the virtual cameras of the twin `name` in its first frame; time further updates with the same frame.

    `scale` is the size of its pictures, `quality` a preset, and `seed` draws the tones.
    """
    twin = make_twin(name, scale)
    frame = twin_frame(twin, 0)
    tones = random_tones(len(frame.views), seed)
    altered = misexposed(frame, tones)
    targets = {target: twin.camera(target) for target in twin.rig.target_names}
    engines = []
    for one, follow_s in ((frame, 0.0), (altered, 0.0), (altered, 0.5)):
        engine = Engine(twin.sources, Settings.preset(quality, exposure_s=follow_s))
        engine.update(one, targets)
        engines.append(engine)
    rows = []
    for name, target in targets.items():
        truth = twin.truth(target, 0).texture
        pictures = [without_gain(truth, engine.render_camera(target, name).texture) for engine in engines]
        rows.append(ExposureRow(name, *((psnr(truth, picture)[0], iv_psnr(truth, picture)) for picture in pictures)))
    found = engines[-1].tones
    assert found is not None
    left = np.tile(np.eye(4), (len(tones), 1, 1))
    before, after = (np.sqrt((tone_errors(guess, tones) ** 2).mean(axis=0)) for guess in (left, found))
    update_ms = min(engines[-1].update(altered).stages["exposure"] for _ in range(_REPEATS))
    return ExposureReport(rows, before, after, update_ms)
