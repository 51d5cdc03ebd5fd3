"""`farside info`: what a sequence or a saved model holds, and what is wrong with it."""

from __future__ import annotations

import itertools
import math
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.io.rgbd_folder import RgbdFolder, is_rgbd_folder
from farside.engine.io.saved_file import means_saved, read_about
from farside.engine.io.tmiv_check import check_sequence
from farside.engine.io.tmiv_empty import look_for_empty_views
from farside.engine.io.tmiv_json import Description, TmivError, find_json, read_json
from farside.engine.io.tmiv_look import look_at_first_frame
from farside.engine.io.video_files import Kind, find_video
from farside.engine.io.yuv import RawVideo
from farside.engine.rig.camera import Camera, Perspective
from farside.engine.rig.left_out import without_empty_views
from farside.engine.settings import Settings
from rich.console import Console
from rich.markup import escape
from rich.table import Table

__all__ = ["command"]


def command(
    sequence: Annotated[
        Path, typer.Argument(metavar="SEQ|MODEL", help="The sequence's folder, or its JSON, or a saved model.")
    ],
) -> None:
    """List what a sequence or a saved model holds and what is wrong with it; the exit code is 2 if anything is wrong.

    Warnings tell what seems to be wrong by a look at the first frame, and which views show nothing; they leave the exit
    code as it is.
    """
    console = Console(width=None if sys.stdout.isatty() else 140)
    if is_rgbd_folder(sequence):
        _show_walk(console, sequence)
        return
    if means_saved(sequence):
        _show_saved(console, sequence)
        return
    problems, warnings = check_sequence(sequence), list[str]()
    try:
        file = find_json(sequence)
        description, _ = read_json(file)
        _show(console, description, file.parent)
        warnings = look_at_first_frame(file.parent, description) + look_for_empty_views(file.parent, description)
    except (TmivError, OSError):
        pass  # check_sequence has reported it
    _tell(console, problems, warnings)


def _show_walk(console: Console, folder: Path) -> None:
    """List a folder of pictures of one RGB-D camera, and which frames are left out; raises ValueError for another file
    that does not fit."""
    walk = RgbdFolder(folder)
    depths, problems = [], []
    for index in range(walk.frame_count):
        frame = without_empty_views(walk.frame(index))
        problems += [f"frame {index}: left out: {fault}" for fault in frame.faults.values()]
        depths += [frame.views[c].codes > 0 for c in frame.there]
    camera, path = walk.camera("camera"), [walk.camera("camera", k).pose.position for k in range(walk.frame_count)]
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(path))
    table = Table(title=f"{escape(walk.name)}: one RGB-D camera, moving")
    for title in ("camera", "size", "frames", "way, m", "pixels with depth"):
        table.add_column(title, no_wrap=True)
    share = sum(float(there.mean()) for there in depths) / max(len(depths), 1)
    size = f"{camera.width}x{camera.height}"
    table.add_row(camera.name, size, str(walk.frame_count), f"{length:.2f}", f"{100 * share:.0f} %")
    console.print(table)
    _tell(console, problems)


def _tell(console: Console, problems: Sequence[str], warnings: Sequence[str] = ()) -> None:
    """Print what is wrong; if anything is, the exit code is 2."""
    for kind, lines in (("[red]problem[/]", problems), ("[yellow]warning[/]", warnings)):
        for line in lines:
            console.print(f"{kind} {escape(line)}", soft_wrap=True, highlight=False)
    if problems:
        raise typer.Exit(2)
    console.print("no problems found")


def _show_saved(console: Console, path: Path) -> None:
    """What a saved model is of; raises ValueError for a damaged one."""
    about = read_about(path)
    sizes = Counter(f"{width}x{height}" for _, width, height in about.cameras)
    table = Table(title=f"{escape(path.name)}: a saved model, {path.stat().st_size / 1e6:.1f} MB", show_header=False)
    rows = {
        "saved at": about.saved, "newest frame": str(about.frame),
        "reference cameras": ", ".join(f"{count} of {size}" for size, count in sizes.items()),
        "": ", ".join(name for name, _, _ in about.cameras),
        "S-PBS": f"{about.s_pbs_valid} triangles valid of {about.s_pbs}",
        "P-PBS": f"{about.p_pbs} triangles", "from an earlier model": f"{about.seeded} of them",
        "pictures": str(about.pictures),
    }  # fmt: skip
    defaults = Settings()
    rows["settings"] = ", ".join(
        f"{name} {value}" for name, value in about.settings if value != getattr(defaults, name, None)
    ) or "the defaults"
    for name, value in rows.items():
        table.add_row(name, escape(value))
    console.print(table)
    console.print("no problems found")


def _show(console: Console, description: Description, folder: Path) -> None:
    sources = description.source_names
    table = Table(title=f"{escape(description.name)}: {len(sources)} source views, {description.fps:g} fps")
    for title in ("camera", "role", "size", "projection", "depth, m", "texture", "depth codes", "frames"):
        table.add_column(title, justify="right" if title == "frames" else "left", no_wrap=True)
    for name, camera in description.cameras.items():
        role = "source" if name in sources else "virtual"
        role += ", moving" if name in description.pose_files else ""
        table.add_row(escape(name), role, *_row(camera, folder, description))
    console.print(table)


def _row(camera: Camera, folder: Path, description: Description) -> list[str]:
    p, d = camera.projection, camera.depth
    if isinstance(p, Perspective):
        projection = f"perspective, focal {p.fx:.6g} {p.fy:.6g}"
    else:
        spans = [round(math.degrees(high - low), 3) for low, high in (p.hor_range, p.ver_range)]
        projection = f"equirectangular, {spans[0]:g} x {spans[1]:g}°"
    texture, depth = (_video(folder, camera, kind, description) for kind in ("texture", "depth"))
    counts = sorted({video.frame_count for video in (texture, depth) if video})
    return [
        f"{p.width}x{p.height}",
        projection,
        f"{d.near:g} to {d.far:g}{', holes' if d.has_invalid else ''}",
        texture.format.name if texture else "-",
        depth.format.name if depth else "-",
        "/".join(map(str, counts)) or "-",
    ]


def _video(folder: Path, camera: Camera, kind: Kind, description: Description) -> RawVideo | None:
    try:
        return find_video(folder, camera, kind, description.cameras)
    except ValueError:
        return None  # check_sequence has reported it
