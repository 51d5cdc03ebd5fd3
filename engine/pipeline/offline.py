"""Offline rendering: plays a recording through the engine as the live service does, and writes pictures to files."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..background.seed import Seed
from ..io.effect_files import EffectContent
from ..io.images import write_png
from ..io.raw_writer import RawWriter
from ..io.recording import Playhead, Recording, playback_index
from ..io.tmiv import depth_path, texture_path
from ..io.yuv import PixelFormat, from_texture
from ..rig.camera import Camera
from ..rig.effects import Effect
from ..rig.left_out import LeftOut
from ..rig.texture import to_rgb
from ..rig.viewer import RenderedPicture, StereoView
from ..settings import Settings
from .engine import BackEndReport, Engine, Viewer

__all__ = ["OfflineRenderer", "RenderJob", "Targets", "summary"]

STAGES = ("ingest", "triangulate", "background", "pbi", "warp", "fill", "total")
# The engine's stages of a picture -> the stages of the report.
_PICTURE_STAGES = dict.fromkeys(("select", "warp", "backdrop", "shade", "antialias"), "warp") | {"fill": "fill"}

Targets = Callable[[int], dict[str, Viewer]]  # output frame -> viewers by name


@dataclass(frozen=True, slots=True)
class RenderJob:
    """A job: output frames [start, stop) of `targets`, rendered from the source views of a recording.

    With `history`, the input frames before `start` are played first, so that the background model at frame n is the
    same as in a live run. seed: an earlier model of the same room, which the background model begins with. effects: 3D
    effects with their names and contents (`Engine.put_effect`).
    """

    recording: Recording
    sources: tuple[str, ...]
    targets: Targets
    start: int
    stop: int
    history: bool = True
    seed: Seed | None = None
    effects: tuple[tuple[str, Effect, EffectContent | None], ...] = ()


class OfflineRenderer:
    """Plays a job's frames in order and yields each output frame's pictures and its row of the report.

    left_out: the views that were left out of frames so far.
    """

    def __init__(self, job: RenderJob, settings: Settings) -> None:
        self.job, self.settings = job, settings
        cameras = [job.recording.camera(name, 0) for name in job.sources]
        self.engine = Engine(cameras, settings, f_vin=job.recording.fps, seed=job.seed)
        for effect in job.effects:
            self.engine.put_effect(*effect)
        self.left_out = LeftOut()
        self._count = job.recording.frame_count
        self._playhead = Playhead(job.recording, job.sources)

    def frames(self) -> Iterator[tuple[int, dict[str, RenderedPicture], dict[str, Any]]]:
        """(output frame, pictures by name, report row) for every output frame."""
        job = self.job
        if job.history and self.settings.background:
            for index in range(min(job.start, self._count)):
                self.left_out.add(self.engine.update(self._playhead.frame(index)).left_out)
        for index in range(job.start, job.stop):
            viewers = job.targets(index)
            back_end, ingest = self._update(playback_index(index, self._count), viewers)
            pictures: dict[str, RenderedPicture] = {}
            for name, viewer in viewers.items():
                pictures |= self._render(name, viewer)
            yield index, pictures, self._row(index, back_end, ingest, pictures)

    def _update(self, index: int, viewers: dict[str, Viewer]) -> tuple[BackEndReport, float]:
        start = time.perf_counter()
        frame = self._playhead.frame(index)
        ingest = 1e3 * (time.perf_counter() - start)
        report = self.engine.update(frame, viewers)
        self.left_out.add(report.left_out)
        return report, ingest

    def _render(self, name: str, viewer: Viewer) -> dict[str, RenderedPicture]:
        if isinstance(viewer, Camera):
            return {name: self.engine.render_camera(viewer, name)}
        pair = self.engine.render(viewer, name)
        return {f"{name}_left": pair.left, f"{name}_right": pair.right}

    def _row(
        self, index: int, back_end: BackEndReport, ingest: float, pictures: dict[str, RenderedPicture]
    ) -> dict[str, Any]:
        stages = dict.fromkeys(STAGES, 0.0) | back_end.stages
        stages["ingest"] = ingest + stages.pop("exposure", 0.0)
        stages["pbi"] += stages.pop("effects", 0.0)
        for picture in pictures.values():
            for name, milliseconds in picture.report.stages.items():
                stages[_PICTURE_STAGES[name]] += milliseconds
        stages["total"] = sum(stages[name] for name in STAGES[:-1])
        cameras = {name: _holes(picture) for name, picture in pictures.items()}
        background = self.engine.status()["background"]
        return {
            "frame": index,
            "stages": stages,
            "hole_fraction": {
                key: float(np.mean([holes[key] for holes in cameras.values()])) for key in _HOLES
            },
            "cameras": cameras,
            "views": {name: list(picture.report.views) for name, picture in pictures.items()},
            "triangles": {
                "s_pbs": background.get("s_pbs_valid", 0),
                "p_pbs": background.get("p_pbs", 0),
                "warped": sum(picture.report.warped for picture in pictures.values()),
            },
        }


_HOLES = ("before_backdrop", "after_backdrop", "after_filling")


def _holes(picture: RenderedPicture) -> dict[str, float]:
    report = picture.report
    return dict(zip(_HOLES, (report.holes_warped, report.holes_backdrop, report.holes_filled), strict=True))


def summary(rows: Sequence[dict[str, Any]], settings: Settings) -> dict[str, Any]:
    """The report of a run: the settings, every frame's row, and median and 95th percentile over the frames."""

    def spread(group: str, key: str) -> dict[str, float]:
        values = [row[group][key] for row in rows]
        return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}

    groups = {"stages": STAGES, "hole_fraction": _HOLES, "triangles": ("s_pbs", "p_pbs", "warped")}
    return {
        "settings": dataclasses.asdict(settings),
        "frames": list(rows),
        "summary": {
            group: {key: spread(group, key) for key in keys} for group, keys in groups.items() if rows
        },
    }


class PictureWriter:
    """Appends pictures to `{name}_texture_...yuv` and `{name}_depth_...yuv`, as a context manager."""

    def __init__(self, folder: Path, *, png: bool = False, masks: bool = False) -> None:
        self.folder, self.png, self.masks = folder, png, masks
        self._videos = RawWriter()
        folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> PictureWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self._videos.close()

    def write(self, name: str, frame: int, picture: RenderedPicture) -> None:
        """Append one picture; PNG and mask files carry the frame's number."""
        camera = dataclasses.replace(picture.camera, name=name)
        texture, codes = picture.texture, picture.codes()
        planes = [from_texture(plane, 10) for plane in (texture.y, texture.cb, texture.cr)]
        self._videos.append(texture_path(self.folder, camera), planes)
        half = ((camera.height + 1) // 2, (camera.width + 1) // 2)
        bits = camera.depth.bits
        neutral = np.full(half, 1 << (bits - 1), PixelFormat(_depth_format(bits)).dtype)
        self._videos.append(
            depth_path(self.folder, camera, _depth_format(bits)),
            [codes.astype(neutral.dtype), neutral, neutral],
        )
        if self.png:
            write_png(self.folder / f"{name}_{frame:04d}.png", texture)
        if self.masks:
            self._write_mask(self.folder / f"{name}_{frame:04d}_mask.ppm", picture)

    def _write_mask(self, path: Path, picture: RenderedPicture) -> None:
        """Write the picture with holes in light blue, and pixels of the backdrop tinted green."""
        rgb = to_rgb(picture.texture)
        backdrop = picture.holes(warped=True) & ~picture.holes()
        rgb[backdrop] = rgb[backdrop] // 2 + np.array([0, 100, 0], np.uint8)
        rgb[picture.holes()] = (128, 200, 255)
        with path.open("wb") as file:
            file.write(b"P6\n%d %d\n255\n" % (rgb.shape[1], rgb.shape[0]))
            file.write(rgb.tobytes())


def _depth_format(bits: int) -> str:
    return "yuv420p" if bits == 8 else f"yuv420p{bits}le"


def stereo_target(view: StereoView, poses: Sequence[Any], name: str) -> Targets:
    """Targets that move a head along a pose trace."""
    return lambda index: {name: view.moved(poses[index])}


def camera_target(camera: Camera, poses: Sequence[Any], name: str) -> Targets:
    """Targets that move one camera along a pose trace."""
    return lambda index: {name: dataclasses.replace(camera, name=name, pose=poses[index])}
