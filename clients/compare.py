"""`farside compare`: how close two raw videos are, frame by frame."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.evaluation import metrics, structural_similarity
from farside.engine.io.yuv import PixelFormat, RawVideo
from rich import box
from rich.console import Console
from rich.table import Table

__all__ = ["command", "compare"]


_DEFAULT_FORMAT = "yuv420p10le"
_SIZE = re.compile(r"[1-9]\d*x[1-9]\d*")
# FFmpeg's names of pixel formats, also those that are not read here.
_FORMAT = re.compile(r"(?:yuv[aj]?4\d\dp|gray|nv\d\d|p[02]\d\d|rgb|bgr|gbrp)(?:\d+)?(?:le|be)?")


def command(
    ref: Annotated[Path, typer.Argument(metavar="REF.yuv", help="The reference.")],
    test: Annotated[Path, typer.Argument(metavar="TEST.yuv", help="The video to judge.")],
    size: Annotated[str, typer.Option(metavar="WxH", help="Picture size, pixels.")],
    pixel_format: Annotated[
        str | None,
        typer.Option("--format", help="Pixel format of both files, 4:2:0 (default: as in the names, or yuv420p10le)."),
    ] = None,
    erp: Annotated[
        str | None,
        typer.Option(metavar="H,V", help="The videos are equirectangular with these angular ranges, degrees."),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Also write the figures to this file.")
    ] = None,
) -> None:
    """Compare two raw videos, frame by frame and on average: PSNR, IV-PSNR and, with --erp, WS-PSNR, in dB; SSIM,
    MS-SSIM, IV-SSIM and IV-MS-SSIM."""
    width, height = _size(size)
    form = PixelFormat(_format_in_names(ref, test) if pixel_format is None else pixel_format)
    reference, judged = (RawVideo(path, width, height, form) for path in (ref, test))
    for video in (reference, judged):
        _check_name(video)
    report = compare(reference, judged, _erp(erp))
    if json_file:
        json_file.write_text(json.dumps(report, indent=1) + "\n", "utf-8")
    Console(width=None if sys.stdout.isatty() else 140).print(_table(report))
    counts = reference.frame_count, judged.frame_count
    if counts[0] != counts[1]:
        raise ValueError(f"frames: {ref.name} has {counts[0]}, {test.name} has {counts[1]}: expected the same number")


def compare(ref: RawVideo, test: RawVideo, erp: tuple[float, float] | None = None) -> dict[str, object]:
    """Quality figures of every frame that both videos have, and their means, as the JSON report.

    `erp`: horizontal and vertical range of equirectangular pictures, degrees. Raises ValueError for a truncated or
    empty file and for a format that is not 4:2:0.
    """
    for video in (ref, test):
        if not video.format.has_chroma:
            raise ValueError(f"format: {video.format.name!r}: expected 4:2:0 (yuv420p...)")
        if not video.frame_count or video.extra_bytes:
            length = video.frame_count * video.frame_bytes + video.extra_bytes
            raise ValueError(
                f"{video.path.name}: {length} bytes: expected a multiple of {video.frame_bytes}, "
                f"a frame of {video.width}x{video.height} {video.format.name}"
            )
    count = min(ref.frame_count, test.frame_count)
    frames = [_figures(ref, test, frame, erp) for frame in range(count)]
    return {
        "reference": str(ref.path),
        "test": str(test.path),
        "size": [ref.width, ref.height],
        "format": ref.format.name,
        "erp": erp,
        "frames": [{"frame": index, **figures} for index, figures in enumerate(frames)],
        "mean": {name: math.fsum(figures[name] for figures in frames) / count for name in frames[0]},
    }


def _format_in_names(ref: Path, test: Path) -> str:
    """The pixel format that the files' names tell, else yuv420p10le; raises ValueError if they tell different ones."""
    told = {path.name: formats[-1] for path in (ref, test) if (formats := _told_by_name(path)[1])}
    if len(set(told.values())) > 1:
        both = " and ".join(f"{name}: {form}" for name, form in told.items())
        raise ValueError(f"--format: missing: the names tell different ones, {both}: expected one for both files")
    return next(iter(told.values()), _DEFAULT_FORMAT)


def _check_name(video: RawVideo) -> None:
    """Compare a file's name with the size and the pixel format that are given.

    Raises ValueError for a contradiction; if the file's length fits what is given and not what the name tells, the
    contradiction is only told on stderr.
    """
    sizes, formats = _told_by_name(video.path)
    size, form = f"{video.width}x{video.height}", video.format.name
    wrong = [f"--size: {size}: expected {sizes[-1]}, as in the name"] if sizes and size not in sizes else []
    wrong += [f"--format: {form}: expected {formats[-1]}, as in the name"] if formats and form not in formats else []
    if not wrong:
        return
    said = f"{video.path.name}: {'; '.join(wrong)}"
    if video.extra_bytes or _fits(video.path, (sizes or [size])[-1], (formats or [form])[-1]):
        raise ValueError(said)
    print(f"{said}; but its {video.path.stat().st_size} bytes are no whole number of such frames", file=sys.stderr)


def _told_by_name(path: Path) -> tuple[list[str], list[str]]:
    """Sizes and pixel formats in a file's name, which ends like _1920x1080_yuv420p10le.yuv."""
    words = path.stem.lower().split("_")
    return [word for word in words if _SIZE.fullmatch(word)], [word for word in words if _FORMAT.fullmatch(word)]


def _fits(path: Path, size: str, form: str) -> bool:
    """Whether the length of a file is a whole number of frames; it may be one of a format that is not known."""
    try:
        return not RawVideo(path, *_size(size), form).extra_bytes
    except ValueError:
        return True


def _figures(
    ref: RawVideo, test: RawVideo, frame: int, erp: tuple[float, float] | None
) -> dict[str, float]:
    pictures, bits = (ref.native(frame), test.native(frame)), ref.format.bits
    names = ("y", "cb", "cr")
    plain = metrics.psnr(*pictures, bits=bits)
    figures = {f"psnr_{name}": value for name, value in zip(names, plain, strict=True)}
    if erp:
        weighted = metrics.ws_psnr(*pictures, erp, bits=bits)
        figures |= {f"ws_psnr_{name}": value for name, value in zip(names, weighted, strict=True)}
    figures["iv_psnr"] = metrics.iv_psnr(*pictures, erp, bits=bits)
    least = min(ref.width, ref.height)
    if least >= structural_similarity.LEAST_PX:
        figures |= structural_similarity.structural_similarity(*pictures, erp, bits=bits).figures()
    if least >= metrics.WINDOW:
        figures["ssim_gaussian"] = metrics.ssim(*pictures, bits=bits)
    return figures


def _table(report: dict[str, object]) -> Table:
    frames, mean = report["frames"], report["mean"]
    assert isinstance(frames, list)
    assert isinstance(mean, dict)
    table = Table("frame", title="PSNR in dB", box=box.SIMPLE)
    shown = [name for name in mean if not re.search(r"ssim_(y|cb|cr|gaussian)$", name)]  # the JSON file has all
    for name in shown:
        title = name.replace("psnr", "PSNR").replace("ssim", "SSIM")
        for prefix in ("ws_", "iv_", "ms_"):
            title = title.replace(prefix, prefix[:2].upper() + "-")
        table.add_column(title.replace("_", " "), justify="right", no_wrap=True)
    for figures in frames:
        table.add_row(str(figures["frame"]), *(f"{figures[name]:.4f}" for name in shown))
    table.add_section()
    table.add_row("mean", *(f"{mean[name]:.4f}" for name in shown))
    return table


def _size(text: str) -> tuple[int, int]:
    if not _SIZE.fullmatch(text):
        raise ValueError(f"--size: {text!r}: expected WIDTHxHEIGHT, as in 1920x1080")
    width, height = map(int, text.split("x"))
    return width, height


def _erp(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        horizontal, vertical = map(float, text.split(","))
    except ValueError:
        raise ValueError(f"--erp: {text!r}: expected two ranges in degrees, as in 360,180") from None
    return horizontal, vertical
