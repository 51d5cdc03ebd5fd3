"""Rendered pictures against ground truth: every quality figure, over sequences and twins, views, model on and off.

An engine gets the n source views nearest to the target, as in `peers`. With the model it also knows all earlier frames.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..rig.frame import Frame, Texture
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from .flicker import FlickerMeter
from .metrics import erp_range, iv_psnr, psnr, ws_psnr
from .peers import nearest_views
from .silhouettes import judge_silhouettes
from .structural_similarity import structural_similarity
from .twin_recording import TwinRecording

__all__ = ["Case", "Judged", "Plan", "Sample", "judge_pictures", "picture_count", "summarise"]


_SSIMS = ("ssim", "ms_ssim", "iv_ssim", "iv_ms_ssim")


@dataclass(frozen=True, slots=True)
class Plan:
    """What to measure.

    views: numbers of nearest source views to render from, 0 for all. model: whether to use the background model; both
    values measure both. qualities: presets. frames: how many are played. every: pictures of every `every`-th frame are
    judged. Raises ValueError for a number below its least.
    """

    views: tuple[int, ...] = (2, 3, 5, 0)
    model: tuple[bool, ...] = (False, True)
    qualities: tuple[str, ...] = ("best",)
    frames: int = 16
    every: int = 15

    def __post_init__(self) -> None:
        if not self.views or min(self.views) < 0:
            raise ValueError(f"views: {self.views!r}: expected numbers of at least 1, or 0 for all")
        for name in ("frames", "every"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected at least 1")

    def indices(self, recording: Recording) -> list[int]:
        """The frames whose pictures are judged: every `every`-th, and the last."""
        last = min(self.frames, recording.frame_count) - 1
        return sorted({*range(0, last + 1, self.every), last})


@dataclass(frozen=True, slots=True)
class Case:
    """How a picture is made: sequence, virtual camera, number of source views, model or not, and preset."""

    sequence: str
    camera: str
    views: int
    model: bool
    quality: str


@dataclass(frozen=True, slots=True)
class Sample:
    """The figures of one picture; None where a figure does not apply, or where there was nothing to measure.

    PSNRs are in dB (ws_psnr_y for equirectangular cameras only). SSIMs: see `structural_similarity`; those of several
    scales need pictures of at least 32 pixels a side. holes_warped, holes_backdrop: fractions of pixels that are holes
    before and after the backdrop. ghosts: the fraction where the model of a twin is too near. flicker: the picture's
    change since the previous frame, divided by the truth's, where the truth keeps still. bias_px, roughness_px,
    silhouettes, thin, thin_pixels: for twins, see `silhouettes`. truth_roughness_px: roughness of the truth itself,
    whose pictures have four samples per pixel.
    """

    case: Case
    frame: int
    psnr_y: float
    ws_psnr_y: float | None
    iv_psnr: float
    ssim: float
    ms_ssim: float | None
    iv_ssim: float
    iv_ms_ssim: float | None
    holes_warped: float
    holes_backdrop: float
    ghosts: float | None = None
    flicker: float | None = None
    bias_px: float | None = None
    roughness_px: float | None = None
    truth_roughness_px: float | None = None
    silhouettes: int | None = None
    thin: float | None = None
    thin_pixels: int | None = None

    def row(self) -> dict[str, object]:
        """The case and all figures in one flat dictionary."""
        flat = dataclasses.asdict(self)
        case: dict[str, object] = flat.pop("case")
        return case | flat


@dataclass(frozen=True, slots=True)
class Judged:
    """A picture with its figures and its ground truth."""

    sample: Sample
    truth: Texture
    picture: RenderedPicture


def picture_count(recording: Recording, targets: Sequence[str], plan: Plan) -> int:
    """The number of pictures that `judge_pictures` yields."""
    return len(plan.indices(recording)) * sum(len(run.targets) for run in _runs(recording, targets, plan))


@dataclass(frozen=True, slots=True)
class _Run:
    """Targets that are rendered from the same source views with the same settings."""

    names: tuple[str, ...]
    model: bool
    quality: str
    targets: list[str]


def _runs(recording: Recording, targets: Sequence[str], plan: Plan) -> list[_Run]:
    total = len(recording.source_names)
    counts = dict.fromkeys(min(count or total, total) for count in plan.views)
    runs: dict[tuple[tuple[str, ...], bool, str], _Run] = {}
    for count, target in itertools.product(counts, targets):
        names = nearest_views(recording, target, count)
        for quality, model in itertools.product(plan.qualities, plan.model):
            runs.setdefault((names, model, quality), _Run(names, model, quality, [])).targets.append(target)
    return list(runs.values())


def judge_pictures(recording: Recording, targets: Sequence[str], plan: Plan) -> Iterator[Judged]:
    """Play the frames through one engine per case, side by side; yields every judged picture.

    `targets` names the virtual cameras. Raises ValueError for a camera without ground truth.
    """
    runs, judged = _runs(recording, targets, plan), plan.indices(recording)
    rendered = {*judged, *(index - 1 for index in judged)}  # flicker needs the previous frame too
    union = [name for name in recording.source_names if any(name in run.names for run in runs)]
    players = [_Player(recording, run) for run in runs]
    for index in range(judged[-1] + 1):
        shown = [player for player in players if player.run.model or index in rendered]
        if not shown:
            continue
        frame = recording.frame(index, union)
        truths = {name: recording.texture(name, index) for name in targets} if index in rendered else {}
        for player in shown:
            yield from player.play(frame, truths, judged=index in judged)


class _Player:
    """A run's engine, and the latest picture of each target."""

    def __init__(self, recording: Recording, run: _Run) -> None:
        self.recording, self.run = recording, run
        settings = Settings.preset(run.quality, n_render=len(run.names), background=run.model)
        self.engine = Engine([recording.camera(name) for name in run.names], settings, f_vin=recording.fps)
        self.last: dict[str, tuple[RenderedPicture, Texture]] = {}

    def play(self, frame: Frame, truths: dict[str, Texture], *, judged: bool) -> Iterator[Judged]:
        """Update the engine with a frame, render the targets that have truths, and judge them if `judged`."""
        views = tuple(view for view in frame.views if view.camera.name in self.run.names)
        viewers = {name: self.recording.camera(name, frame.index) for name in self.run.targets if name in truths}
        self.engine.update(Frame(frame.index, views), viewers)
        for name, camera in viewers.items():
            picture, truth = self.engine.render_camera(camera, name), truths[name]
            if judged:
                yield Judged(self._judge(frame.index, name, picture, truth), truth, picture)
            self.last[name] = picture, truth

    def _judge(self, index: int, name: str, picture: RenderedPicture, truth: Texture) -> Sample:
        run, erp = self.run, erp_range(picture.camera)
        alike = structural_similarity(truth, picture.texture, erp).figures()
        sample = Sample(
            Case(self.recording.name, name, len(run.names), run.model, run.quality),
            index,
            psnr(truth, picture.texture)[0],
            ws_psnr(truth, picture.texture, erp)[0] if erp else None,
            iv_psnr(truth, picture.texture, erp),
            alike["ssim"],
            alike.get("ms_ssim"),
            alike["iv_ssim"],
            alike.get("iv_ms_ssim"),
            picture.report.holes_warped,
            picture.report.holes_backdrop,
            flicker=_flicker(self.last.get(name), picture, truth),
        )
        if not isinstance(self.recording, TwinRecording):
            return sample
        fine, model = self.recording.fine(name, index), self.engine.model
        edges = judge_silhouettes(fine, picture.texture, picture.disparity)
        return dataclasses.replace(
            sample,
            ghosts=self.recording.ghosts(name, index, model) if model else None,
            bias_px=_known(edges.bias_px),
            roughness_px=_known(edges.roughness_px),
            truth_roughness_px=_known(self.recording.roughness(name, index)),
            silhouettes=edges.silhouettes,
            thin=_known(edges.thin),
            thin_pixels=edges.thin_pixels,
        )


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _flicker(before: tuple[RenderedPicture, Texture] | None, picture: RenderedPicture, truth: Texture) -> float | None:
    if before is None:
        return None
    meter = FlickerMeter()
    for shown, true in (before, (picture, truth)):
        meter.add(shown.texture.y, true.y, shown.holes())
    whole = meter.result().whole
    return whole.ratio if whole.share else None


def summarise(samples: Sequence[Sample]) -> list[dict[str, object]]:
    """A row for each sequence, quality, number of views, and model or not: means over cameras and frames.

    `worst` is the lowest IV-PSNR. Means of figures of silhouettes and thin structures are weighted by their numbers of
    pixels. A figure that no sample has is None.
    """
    groups: dict[tuple[str, str, int, bool], list[Sample]] = {}
    for sample in samples:
        case = sample.case
        groups.setdefault((case.sequence, case.quality, case.views, case.model), []).append(sample)
    rows = []
    for key, group in sorted(groups.items()):
        row: dict[str, object] = dict(zip(("sequence", "quality", "views", "model"), key, strict=True))
        plain = ("psnr_y", "ws_psnr_y", "iv_psnr", *_SSIMS, "holes_warped", "holes_backdrop", "ghosts", "flicker")
        row |= {"pictures": len(group)} | {name: _mean(group, name) for name in plain}
        row["worst"] = min(sample.iv_psnr for sample in group)
        row |= {name: _mean(group, name, "silhouettes") for name in ("bias_px", "roughness_px", "truth_roughness_px")}
        row["thin"] = _mean(group, "thin", "thin_pixels")
        rows.append(row)
    return rows


def _mean(samples: Sequence[Sample], name: str, weight: str | None = None) -> float | None:
    there = [sample for sample in samples if getattr(sample, name) is not None]
    weights = [float(getattr(sample, weight)) if weight else 1.0 for sample in there]
    values = [float(getattr(sample, name)) for sample in there]
    return float(np.average(values, weights=weights)) if there else None
