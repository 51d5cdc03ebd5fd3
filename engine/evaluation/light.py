"""The benefit of following the light: a twin's background model while lamps change, against the truth.

Two engines play the same frames, one with `Settings.light_s` and one without. Their pictures are compared in *filled*
pixels, whose surface is in the background model only, as no present view shows it. The model itself, seen from the
virtual camera, is compared with the scene without its people in the light of that moment, where it shows the same
surface away from depth edges: everywhere, and where people hide the background from that camera. Parts of the sequence
are judged apart: before the light changes, while it changes, and after that; all frames of a twin whose light is steady
are "before".
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..background.exposure import to_picture
from ..background.model import BackgroundModel
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Frame, Texture, View
from ..rig.selection import view_shares
from ..rig.texture import toned_texture
from ..settings import Settings
from ..support.array_types import F64
from ..synth import FPS, Twin, render_view, twin_frame
from .flicker import FlickerMeter
from .metrics import full_planes
from .noise import beside_edges

__all__ = ["PARTS", "Colours", "LightMeter", "LightPart", "part_of", "watch_light", "with_grain"]

PARTS = ("before", "while", "after")
_PEAK = 1023.0
_SETTLED = 20  # first frames whose cost does not count: they compile or load kernels
Bools = npt.NDArray[np.bool_]


@dataclass(slots=True)
class Colours:
    """Summed squared errors of Y, Cb and Cr, [2, 3], without and with following, over `count` pixels."""

    count: int = 0
    errors: F64 = field(default_factory=lambda: np.zeros((2, 3)))

    def add(self, kind: int, found: Texture, truth: Texture, where: Bools) -> None:
        """Adds the pixels of a mask [h, w]; kind: 0 without following, 1 with it."""
        difference = full_planes(found)[:, where].astype(np.float64) - full_planes(truth)[:, where]
        self.errors[kind] += (difference**2).sum(axis=1)
        self.count += difference.shape[1] if kind else 0

    def psnr(self, kind: int) -> tuple[float, float]:
        """PSNR in dB of luma, and of both chroma planes together; nan without pixels."""
        luma, chroma = self.errors[kind, 0], self.errors[kind, 1:].mean()
        return _psnr(float(luma), self.count), _psnr(float(chroma), self.count)


@dataclass(slots=True)
class LightPart:
    """Figures of a part of a sequence: colours of whole pictures, of filled pixels, of the whole model and of its
    hidden part; judged: number of pictures; flicker: meters by camera, in which filled pixels are the
    holes; update_ms [2]: CPU time of all updates of the model, without and with following."""

    judged: int = 0
    whole: Colours = field(default_factory=Colours)
    filled: Colours = field(default_factory=Colours)
    model: Colours = field(default_factory=Colours)
    hidden: Colours = field(default_factory=Colours)
    flicker: dict[str, tuple[FlickerMeter, FlickerMeter]] = field(default_factory=dict)
    update_ms: F64 = field(default_factory=lambda: np.zeros(2))

    @property
    def cost(self) -> float:
        """CPU time of the model's updates with following, as a multiple of that without; nan for no updates."""
        without, following = self.update_ms.tolist()
        return following / without if without else math.nan

    def changes(self, kind: int) -> float:
        """Mean change from one judged frame to the next where the truth keeps still, in filled pixels, codes of
        luma; nan if no camera was judged twice."""
        if self.judged < 2 * max(len(self.flicker), 1):
            return math.nan
        found = [meters[kind].result().holes for meters in self.flicker.values()]
        shares = sum(steadiness.share for steadiness in found)
        return sum(each.share * each.rendered for each in found) / shares if shares else math.nan


class LightMeter:
    """Collects figures by part."""

    def __init__(self) -> None:
        self.parts = {part: LightPart() for part in PARTS}

    def add(self, part: str, truth: View, background: View, engines: Sequence[Engine]) -> None:
        """Takes a camera's truth, with and without people, and the engines without and with following."""
        own, camera = self.parts[part], truth.camera
        own.judged += 1
        meters = own.flicker.setdefault(camera.name, (FlickerMeter(), FlickerMeter()))
        hidden = truth.codes != background.codes
        for kind, engine in enumerate(engines):
            picture = engine.render_camera(camera, camera.name)
            filled = (picture.winner == len(picture.report.views)) & (picture.disparity > 0)
            own.whole.add(kind, picture.texture, truth.texture, np.ones_like(filled))
            own.filled.add(kind, picture.texture, truth.texture, filled)
            meters[kind].add(picture.texture.y, truth.texture.y, filled)
            assert engine.model is not None
            found, same = _seen_model(engine.model, background)
            found = _as_shown(engine, camera, found)
            own.model.add(kind, found, background.texture, same)
            own.hidden.add(kind, found, background.texture, same & hidden)


def watch_light(
    twin: Twin, cameras: Sequence[Camera], frames: int, every: int, settings: Settings, grain: float = 0.0
) -> Iterator[LightMeter]:
    """Play `frames` frames of a twin, rendered in memory, and judge every `every`-th of them; yields the meter after
    each frame. `grain`: standard deviation of noise in the views' luma, 10-bit codes; chroma has half of it."""
    kinds = dataclasses.replace(settings, light_s=0.0), settings
    engines = [Engine(twin.sources, each, f_vin=FPS) for each in kinds]
    meter, targets = LightMeter(), {camera.name: camera for camera in cameras}
    for index in range(frames):
        part, frame = part_of(twin, index), with_grain(twin_frame(twin, index), grain)
        for kind in (0, 1) if index % 2 else (1, 0):
            report = engines[kind].update(frame, targets)
            if index >= _SETTLED:
                meter.parts[part].update_ms[kind] += report.stages.cpu["background"]
        for camera in cameras if index % every == 0 else ():
            background = render_view(twin.scene, camera, index / FPS, background_only=True)
            meter.add(part, twin.truth(camera, index), background, engines)
        yield meter


def part_of(twin: Twin, index: int) -> str:
    """In which of PARTS a frame of a twin is."""
    dimming, time = twin.scene.dimming, index / FPS
    if dimming is None or time <= dimming.start:
        return "before"
    return "while" if time < dimming.end else "after"


def with_grain(frame: Frame, grain: float) -> Frame:
    """The frame with noise in its views' colours; the same noise for the same frame."""
    if not grain:
        return frame
    rng = np.random.default_rng(frame.index)

    def noisy(plane: npt.NDArray[np.uint16], deviation: float) -> npt.NDArray[np.uint16]:
        codes = plane + rng.normal(0.0, deviation, plane.shape)
        return np.rint(codes).clip(0, _PEAK).astype(np.uint16)

    views = []
    for view in frame.views:
        y, cb, cr = view.texture.y, view.texture.cb, view.texture.cr
        texture = Texture(noisy(y, grain), noisy(cb, 0.5 * grain), noisy(cr, 0.5 * grain))
        views.append(dataclasses.replace(view, texture=texture))
    return dataclasses.replace(frame, views=tuple(views))


def _seen_model(model: BackgroundModel, background: View) -> tuple[Texture, Bools]:
    """The model's colours as `background` sees them, and where it shows the same surface, away from depth edges."""
    camera = background.camera
    coding = dataclasses.replace(camera.depth, has_invalid=True, bits=16)
    found = model.render_pbi(dataclasses.replace(camera, depth=coding)).view
    there, true = coding.depth(found.codes), camera.depth.depth(background.codes)
    near = np.abs(np.nan_to_num(there - true, nan=np.inf)) <= model.tolerances.delta_at(true)
    same: Bools = near & ~beside_edges(true)
    return found.texture, same


def _as_shown(engine: Engine, camera: Camera, texture: Texture) -> Texture:
    """Colours of the model as a picture of this camera shows them."""
    front = engine.front
    if front is None or front.tones is None:
        return texture
    cameras = [prepared.view.camera for prepared in front.content.views]
    shares = view_shares(camera, cameras, front.content.scene.depths_for(camera))
    return toned_texture(texture, to_picture(front.tones, shares)[-1])


def _psnr(error: float, count: int) -> float:
    return 10.0 * math.log10(count * _PEAK**2 / max(error, 1.0)) if count else math.nan
