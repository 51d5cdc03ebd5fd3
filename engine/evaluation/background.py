"""The benefit of the background model: few views with it against few and all views without it (paper section 4.1)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..settings import Settings
from .hole_tint import tinted
from .metrics import erp_range, iv_psnr, psnr

__all__ = ["MODES", "ModelSample", "compare_model", "hole_picture", "inside_rig", "summarise"]

# Few views with the model, few views without, all views without.
MODES = ("model", "few", "all")


@dataclass(frozen=True, slots=True)
class ModelSample:
    """One virtual camera at one frame in one mode.

    psnr_y, iv_psnr: dB. holes_warped, holes_backdrop: fractions of pixels before and after the backdrop.
    """

    camera: str
    frame: int
    mode: str
    psnr_y: float
    iv_psnr: float
    holes_warped: float
    holes_backdrop: float


def inside_rig(sequence: Recording) -> list[str]:
    """Virtual cameras with ground truth that stand among the source cameras.

    "Among" means: at most 1.5 times as far from the rig's middle as its farthest camera.
    """
    positions = np.array([sequence.camera(name).pose.position for name in sequence.source_names])
    middle = positions.mean(axis=0)
    reach = 1.5 * float(np.linalg.norm(positions - middle, axis=1).max())
    return [
        name for name in sequence.truth_names if np.linalg.norm(sequence.camera(name).pose.position - middle) <= reach
    ]


def compare_model(
    sequence: Recording, cameras: Sequence[str], frames: int, every: int, quality: str, views: int = 5
) -> Iterator[ModelSample]:
    """Play `frames` frames in all modes side by side; yields samples of every `every`-th frame.

    `cameras` are virtual cameras with ground truth, `views` is the number of views that "few" means.
    """
    rig = [sequence.camera(name) for name in sequence.source_names]
    engines = {
        "model": Engine(rig, Settings.preset(quality, n_render=views), f_vin=sequence.fps),
        "few": Engine(rig, Settings.preset(quality, n_render=views, background=False), f_vin=sequence.fps),
        "all": Engine(rig, Settings.preset(quality, n_render=len(rig), background=False), f_vin=sequence.fps),
    }
    for index in range(frames):
        frame = sequence.frame(index)
        sampled = index % every == 0
        viewers = {name: sequence.camera(name) for name in cameras} if sampled else {}
        engines["model"].update(frame, viewers)
        if not sampled:
            continue
        for mode in MODES[1:]:
            engines[mode].update(frame)
        for name, camera in viewers.items():
            truth, erp = sequence.texture(name, index), erp_range(camera)
            for mode, engine in engines.items():
                picture = engine.render_camera(camera, name)
                yield ModelSample(
                    name, index, mode, psnr(truth, picture.texture)[0], iv_psnr(truth, picture.texture, erp),
                    picture.report.holes_warped, picture.report.holes_backdrop,
                )  # fmt: skip


def summarise(samples: Sequence[ModelSample], settled: int) -> list[dict[str, float | str]]:
    """A row per camera: median IV-PSNR of each mode from frame `settled` on, the model's worst loss, remaining holes.

    worst_loss is the largest difference, dB, by which "few" beats "model" in any frame. holes_all: holes of all views
    without the model. Holes are means of fractions of the pixels.
    """
    rows: list[dict[str, float | str]] = []
    for camera in dict.fromkeys(sample.camera for sample in samples):
        by_mode = {
            mode: [s for s in samples if s.camera == camera and s.mode == mode] for mode in MODES
        }
        late = {mode: [s for s in group if s.frame >= settled] for mode, group in by_mode.items()}
        pairs = list(zip(by_mode["model"], by_mode["few"], strict=True))
        rows.append(
            {"camera": camera}
            | {mode: float(np.median([s.iv_psnr for s in late[mode]])) for mode in MODES}
            | {
                "worst_loss": max(off.iv_psnr - on.iv_psnr for on, off in pairs),
                "holes_warped": float(np.mean([s.holes_warped for s in late["model"]])),
                "holes_backdrop": float(np.mean([s.holes_backdrop for s in late["model"]])),
                "holes_all": float(np.mean([s.holes_warped for s in late["all"]])),
            }
        )
    return rows


def hole_picture(
    sequence: Recording, camera: str, frame: int, quality: str, views: int
) -> npt.NDArray[np.uint8]:  # [h, 2 w, 3]
    """RGB picture of a virtual camera at a frame from `views` views; holes are light blue.

    The left half is rendered without the model, the right half with it.
    """
    rig, target = [sequence.camera(name) for name in sequence.source_names], sequence.camera(camera, frame)
    settings = Settings.preset(quality, n_render=views, fill="none")
    engine = Engine(rig, settings, f_vin=sequence.fps)
    for index in range(frame + 1):
        engine.update(sequence.frame(index), {camera: target} if index == frame else None)
    halves = []
    for viewer in (None, camera):  # only a named viewer has a backdrop
        picture = engine.render_camera(target, viewer)
        halves.append(tinted(picture))
    return np.concatenate(halves, axis=1)
