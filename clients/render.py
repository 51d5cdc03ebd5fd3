"""`farside render`: virtual cameras or a head-pose trace, rendered from a sequence."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Annotated, Any

import typer
from farside.engine.background.seed_files import read_seed
from farside.engine.io.pose_trace import read_pose_trace
from farside.engine.io.recording import Recording, open_recording
from farside.engine.io.seed_file import check_seed
from farside.engine.pipeline.offline import (
    OfflineRenderer,
    PictureWriter,
    RenderJob,
    Targets,
    camera_target,
    stereo_target,
    summary,
)
from farside.engine.rig.camera import Camera, Perspective
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from rich.console import Console
from rich.progress import Progress

from .effects import read_effects
from .kernels import compile_shown
from .model_options import CullStale, LateRounds, Light, MiddleLayers, ViewingSpace
from .moving import Moving, pose_files

__all__ = ["command"]

Tolerance = Annotated[
    float | None, typer.Option(help="Largest triangulation error in pixels; 0: two triangles for each pixel.")
]
Exposure = Annotated[
    float | None,
    typer.Option(help="Time constant with which exposure and white balance of views are followed, s; 0: not followed."),
]
SeedModel = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="An earlier model of the room that the background begins with (GLB, or saved)."),
]
OutputScale = Annotated[
    float | None,
    typer.Option(help="Factor on the pictures' width and height; the field of view stays the same."),
]


def command(
    sequence: Annotated[Path, typer.Argument(metavar="SEQ", help="A recording: the folder of a TMIV sequence.")],
    out: Annotated[Path, typer.Option(help="Folder for the pictures.")],
    camera: Annotated[list[str] | None, typer.Option(help="A virtual camera of the sequence.")] = None,
    pose_trace: Annotated[Path | None, typer.Option(help="CSV of head poses.")] = None,
    stereo: Annotated[bool, typer.Option(help="Render both eyes of the pose trace.")] = False,
    ipd: Annotated[float, typer.Option(help="Interpupillary distance, metres.")] = 0.063,
    size: Annotated[str | None, typer.Option(metavar="WxH", help="Picture size for the pose trace.")] = None,
    fov: Annotated[
        float | None, typer.Option(help="Horizontal field of view for the pose trace, degrees.")
    ] = None,
    frames: Annotated[str | None, typer.Option(metavar="A:B", help="Output frames A to B - 1.")] = None,
    sources: Annotated[str | None, typer.Option(metavar="v0,v3,...", help="Use only these source views.")] = None,
    moving: Moving = None,
    draw_moving: Annotated[
        bool | None, typer.Option(help="Draw the views of moving cameras, too; else they only update the model.")
    ] = None,
    views: Annotated[int | None, typer.Option(help="Views warped for each picture (n_render).")] = None,
    init: Annotated[int | None, typer.Option(help="Views that build the S-PBS (n_init).")] = None,
    update: Annotated[int | None, typer.Option(help="Views that update the P-PBS in each frame (n_update).")] = None,
    update_interval: Annotated[
        int | None, typer.Option(metavar="N", help="The model takes every N-th frame.")
    ] = None,
    background: Annotated[
        bool, typer.Option("--background/--no-background", help="Build and render the background model.")
    ] = True,
    history: Annotated[
        bool, typer.Option("--history/--no-history", help="Give the model the frames before A first.")
    ] = True,
    quality: Annotated[str, typer.Option(help="fast, balanced, best, or paper (as published).")] = "balanced",
    tolerance: Tolerance = None,
    delta: Annotated[float | None, typer.Option(help="Culling tolerance, metres (in the paper: 0.2).")] = None,
    viewing_space: ViewingSpace = None,
    light: Light = None,
    cull_stale: CullStale = None,
    middle_layers: MiddleLayers = None,
    late_rounds: LateRounds = None,
    seed_model: SeedModel = None,
    exposure: Exposure = None,
    output_scale: OutputScale = None,
    effects: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="3D effects: projectors and meshes (server/PROTOCOL.md).")
    ] = None,
    fill: Annotated[bool, typer.Option("--fill/--no-fill", help="Fill disocclusions.")] = True,
    png: Annotated[bool, typer.Option(help="Also write PNG files.")] = False,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write times and holes of every frame to this file.")
    ] = None,
    ppm_masks: Annotated[bool, typer.Option(help="Also write pictures in which the holes are marked.")] = False,
) -> None:
    """Render virtual cameras or a head-pose trace from a sequence."""
    opened = open_recording(sequence, pose_files(moving))
    given = {
        "n_render": views, "n_init": init, "n_update": update, "tolerance_px": tolerance, "delta_m": delta,
        "viewing_space": viewing_space, "exposure_s": exposure, "update_interval": update_interval,
        "output_scale": output_scale, "draw_moving": draw_moving, "fill": None if fill else "none",
        "light_s": light, "cull_stale": cull_stale, "middle_layers": middle_layers, "late_rounds": late_rounds,
    }  # fmt: skip
    changes = {name: value for name, value in given.items() if value is not None}
    settings = Settings.preset(quality, background=background, **changes)
    targets, count = _targets(opened, camera or [], pose_trace, stereo, ipd, size, fov)
    start, stop = _frame_range(frames, count)
    job = RenderJob(opened, _sources(opened, sources), targets, start, stop, history)
    if seed_model is not None and not background:
        raise ValueError(f"--seed-model: {seed_model}: expected none with --no-background")
    if seed_model is not None:
        check_seed(seed_model)
    if effects is not None:
        job = dataclasses.replace(job, effects=read_effects(effects))
    needed = {"effects": effects is not None, "seed": seed_model is not None, "beyond": settings.beyond}
    compile_shown([quality, *(use for use, wanted in needed.items() if wanted)])
    if seed_model is not None:
        job = dataclasses.replace(job, seed=read_seed(seed_model))
    renderer = OfflineRenderer(job, settings)
    rows = _render(renderer, PictureWriter(out, png=png, masks=ppm_masks))
    result = summary(rows, settings)
    if report is not None:
        report.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    medians = ", ".join(f"{name} {values['median']:.1f}" for name, values in result["summary"]["stages"].items())
    console = Console(stderr=True)
    if left_out := str(renderer.left_out):
        console.print(f"views left out of frames: {left_out}", markup=False)
    console.print(f"{len(rows)} frames to {out}; median milliseconds a frame: {medians}", soft_wrap=True)


def _render(renderer: OfflineRenderer, writer: PictureWriter) -> list[dict[str, Any]]:
    """Write the pictures of a job; returns the report's row of each frame."""
    rows, job = [], renderer.job
    with writer, Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task("rendering", total=job.stop - job.start)
        for index, pictures, row in renderer.frames():
            for name, picture in pictures.items():
                writer.write(name, index, picture)
            rows.append(row)
            progress.advance(task)
    return rows


def _sources(sequence: Recording, sources: str | None) -> tuple[str, ...]:
    if sources is None:
        return tuple(sequence.source_names)
    names = tuple(name.strip() for name in sources.split(","))
    for name in names:
        if name not in sequence.source_names:
            known = ", ".join(sequence.source_names)
            raise ValueError(f"--sources: {name!r}: expected source views of the sequence: {known}")
    return tuple(name for name in sequence.source_names if name in names)


def _targets(
    sequence: Recording, cameras: list[str], trace: Path | None, stereo: bool, ipd: float,
    size: str | None, fov: float | None,
) -> tuple[Targets, int]:  # fmt: skip
    """The viewers of each output frame, and how many output frames there are."""
    if bool(cameras) == (trace is not None):
        raise ValueError("--camera, --pose-trace: expected one or the other")
    if trace is None:
        if stereo or size is not None or fov is not None:
            raise ValueError("--stereo, --size, --fov: expected with --pose-trace only")
        for name in cameras:
            sequence.camera(name)
        return (
            lambda index: {
                name: sequence.camera(name, min(index, sequence.frame_count - 1)) for name in cameras
            },
            sequence.frame_count,
        )
    template = _template(sequence, size, fov)
    poses = read_pose_trace(trace, template)
    if not stereo:
        return camera_target(template, poses, trace.stem), len(poses)
    if not isinstance(template.projection, Perspective):
        raise ValueError("--stereo: the viewport is equirectangular: expected --size and --fov as well")
    view = StereoView(poses[0], ipd, template.projection, template.projection)
    return stereo_target(view, poses, trace.stem), len(poses)


def _template(sequence: Recording, size: str | None, fov: float | None) -> Camera:
    """The camera `viewport`, or the first source view if there is none, with the size and field of view asked for."""
    template = sequence.camera("viewport" if "viewport" in sequence.camera_names else sequence.source_names[0])
    if size is None and fov is None:
        return template
    width, height = (template.width, template.height) if size is None else parse_size(size)
    if fov is None and isinstance(template.projection, Perspective):
        fov = math.degrees(2 * math.atan(0.5 * template.width / abs(template.projection.fx)))
    projection = Perspective.from_fov(width, height, math.radians(90.0 if fov is None else fov))
    return dataclasses.replace(template, projection=projection)


def parse_size(text: str) -> tuple[int, int]:
    """Width and height in pixels from text like 1280x1440; raises ValueError for anything else."""
    match = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if not match:
        raise ValueError(f"--size: {text!r}: expected WxH, as in 1280x1440")
    return int(match[1]), int(match[2])


def _frame_range(frames: str | None, count: int) -> tuple[int, int]:
    if frames is None:
        return 0, count
    first, colon, last = frames.partition(":")
    try:
        start, stop = int(first or 0), int(last) if last else count
    except ValueError:
        start = stop = -1
    if not colon or not 0 <= start < stop <= count:
        raise ValueError(f"--frames: {frames!r}: expected A:B with 0 <= A < B <= {count}")
    return start, stop
