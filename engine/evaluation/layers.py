"""What the model keeps beyond the paper's limits: stale foreground is culled at once, and middle layers stay.

A twin is played with each of the `VARIANTS` of a quality side by side. Judged are the *filled* pixels of virtual
cameras, which no drawn view shows in any of them: by their colours and by the depth of the backdrop. Depth sensors with
a short reach, beyond which there is no depth, show what happens where nothing is known behind a person. Of the filled
pixels, those count once more that show what has *come*: it is before what always stands in the twin, and was there a
second ago, but not in the first frame. In the twin `lounge`, that is an armchair that is carried to another place.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Frame, Texture, View
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from ..support.runtime import one_thread
from ..synth import FPS, Twin, render_view, twin_frame
from .backdrop import wrong_depth
from .ghosts import ghost_pixels
from .metrics import iv_psnr, psnr

__all__ = ["VARIANTS", "LayerCost", "LayerSample", "play_layers", "within_reach"]

VARIANTS: Mapping[str, Mapping[str, object]] = {
    "neither": {"cull_stale": False, "middle_layers": 0},
    "stale": {"cull_stale": True, "middle_layers": 0},
    "layers": {"cull_stale": True, "middle_layers": 1 << 20, "late_rounds": 0},
    "late": {"cull_stale": True, "middle_layers": 1 << 20, "late_rounds": 1},
}

# Shares of a depth: what differs by less is the same, and what is nearer by more is before something.
_SAME, _BEFORE = 0.005, 0.05

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class LayerSample:
    """A virtual camera's picture in one frame, by one variant.

    filled: number of pixels that no drawn view shows in any variant; psnr_y, iv_psnr: in these, dB (infinite where
    there are none or all are exact). wrong: filled pixels in which the backdrop is nearer or farther than the truth by
    more than delta; unknown: filled pixels without a backdrop. come: filled pixels that show what has come (see the
    module's docstring); missed: those of them that are wrong or unknown. ghosts: the fraction of all pixels where the
    model's farthest surface is neither there now nor part of what always stands (`ghosts`).
    """

    variant: str
    camera: str
    frame: int
    filled: int
    psnr_y: float
    iv_psnr: float
    wrong: int
    unknown: int
    come: int
    missed: int
    ghosts: float


@dataclass(frozen=True, slots=True)
class LayerCost:
    """A frame's update of the model by one variant: CPU milliseconds on one thread, the model's valid triangles, and
    its bytes."""

    variant: str
    frame: int
    update_ms: float
    triangles: int
    memory: int


def within_reach(frame: Frame, reach_m: float) -> Frame:
    """A frame as depth sensors see it that find no depth beyond `reach_m` metres."""
    views = []
    for view in frame.views:
        coding = view.camera.depth
        codes = np.where(coding.depth(view.codes) > reach_m, 0, np.maximum(view.codes, 1)).astype(np.uint16)
        camera = dataclasses.replace(view.camera, depth=dataclasses.replace(coding, has_invalid=True))
        views.append(View(camera, view.texture, codes))
    return dataclasses.replace(frame, views=tuple(views))


def play_layers(
    twin: Twin, cameras: Sequence[Camera], frames: int, every: int, quality: str, views: int = 2,
    reach_m: float = math.inf,
) -> Iterator[LayerSample | LayerCost]:  # fmt: skip
    """Play `frames` frames of a twin in all variants; yields the costs of each frame, and samples of every `every`-th
    and of the last.

    `views` are drawn in each picture. reach_m: of the depth sensors, metres; infinite: they find all depth. In each
    frame another variant is updated first.
    """
    first = within_reach(twin_frame(twin, 0), reach_m)
    engines = {
        name: Engine([v.camera for v in first.views], Settings.preset(quality, n_render=views, **changes), f_vin=FPS)
        for name, changes in VARIANTS.items()
    }
    still = {c.name: render_view(twin.scene, c, 0.0, samples=1, background_only=True) for c in cameras}
    begin = {c.name: twin.truth(c, 0) for c in cameras}
    for index in range(frames):
        frame, judged = within_reach(twin_frame(twin, index), reach_m), index % every == 0 or index == frames - 1
        viewers = {camera.name: camera for camera in cameras} if judged else {}
        names = list(engines)
        for name in names[index % len(names) :] + names[: index % len(names)]:
            yield _updated(name, engines[name], frame, viewers)
        for camera in viewers.values():
            truth, before = twin.truth(camera, index), twin.truth(camera, max(index - round(FPS), 0))
            come = _have_come(truth, before, begin[camera.name], still[camera.name])
            yield from _samples(engines, camera, truth, still[camera.name], come, index)
    for engine in engines.values():
        engine.close()


def _updated(name: str, engine: Engine, frame: Frame, viewers: Mapping[str, Camera]) -> LayerCost:
    with one_thread():
        report = engine.update(frame, viewers)
    assert report.background is not None
    assert engine.model is not None
    counts, memory = engine.model.counts(), engine.model.memory
    triangles = counts["s_pbs_valid"] + counts["p_pbs"]
    return LayerCost(name, frame.index, report.stages.cpu["background"], triangles, sum(memory.values()))


def _have_come(now: View, before: View, first: View, still: View) -> Bools:
    """Pixels [h, w] with the same depth in two views of a camera, which is before that of the first view, and before
    what always stands."""
    present, past, begin, always = (view.camera.depth.disparity(view.codes) for view in (now, before, first, still))
    result: Bools = (np.abs(present / past - 1.0) < _SAME) & (present / np.maximum(begin, always) - 1.0 > _BEFORE)
    return result


def _samples(
    engines: Mapping[str, Engine], camera: Camera, truth: View, still: View, come: Bools, index: int
) -> Iterator[LayerSample]:
    pictures = {name: engine.render_camera(camera, camera.name) for name, engine in engines.items()}
    filled = np.any([picture.holes(warped=True) for picture in pictures.values()], axis=0)
    for name, picture in pictures.items():
        model = engines[name].model
        assert model is not None
        far, near = wrong_depth(picture, truth, model)
        wrong, unknown = (far | near) & filled, picture.holes() & filled
        _holes, nearer, nearer_than_now = ghost_pixels(model, still, truth)
        yield LayerSample(
            name, camera.name, index, int(filled.sum()), *_quality(picture, truth.texture, filled),
            int(wrong.sum()), int(unknown.sum()), int((come & filled).sum()), int((come & (wrong | unknown)).sum()),
            float((nearer & nearer_than_now).mean()),
        )  # fmt: skip


def _quality(picture: RenderedPicture, truth: Texture, filled: Bools) -> tuple[float, float]:
    """PSNR-Y and IV-PSNR of the filled pixels only, dB."""
    share = float(filled.mean())
    if share == 0.0:
        return math.inf, math.inf
    h, w = filled.shape
    chroma = np.pad(filled, ((0, h % 2), (0, w % 2))).reshape((h + 1) // 2, 2, (w + 1) // 2, 2).any(axis=(1, 3))
    pairs = zip((filled, chroma, chroma), _planes(picture.texture), _planes(truth), strict=True)
    mixed = Texture(*(np.where(mask, found, true) for mask, found, true in pairs))
    room = 10 * math.log10(share)  # the other pixels are exact
    return psnr(truth, mixed)[0] + room, iv_psnr(truth, mixed) + room


def _planes(texture: Texture) -> tuple[npt.NDArray[np.uint16], ...]:
    return texture.y, texture.cb, texture.cr
