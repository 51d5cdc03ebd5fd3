"""`farside bench`: measurements that the README's figures come from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from PIL import Image
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

__all__ = ["command"]


def command(
    peers: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Sequences whose README has the figures of other renderers."),
    ] = None,
    ghosts: Annotated[
        str | None, typer.Option(metavar="NAME", help="Ghosts and holes of the background model over a twin.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(metavar="SEQ", help="Few views with the model against few and all without it, by truth."),
    ] = None,
    views: Annotated[int, typer.Option(help="What --model calls few views.", min=1)] = 5,
    camera: Annotated[
        list[str] | None, typer.Option(help="Virtual cameras of --model; without it those inside the rig.")
    ] = None,
    every: Annotated[int, typer.Option(help="Look at every so many frames (--model).", min=1)] = 12,
    pairs: Annotated[
        str | None, typer.Option(metavar="NAME", help="Stereo pairs a second of a twin while the model is updated.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Size of the twin's pictures (--ghosts, --pairs).")] = 0.25,
    frames: Annotated[int, typer.Option(help="Frames to play, at most.", min=1)] = 100,
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for plots.")] = None,
    quality: Annotated[str, typer.Option(help="fast, balanced or best.")] = "best",
    background: Annotated[bool, typer.Option("--background/--no-background", help="The model.")] = True,
) -> None:
    """Measure speed and quality."""
    if peers is None and ghosts is None and model is None and pairs is None:
        raise ValueError("bench: nothing to measure: expected --peers FOLDER, --model SEQ, --ghosts or --pairs NAME")
    if pairs is not None:
        _pairs(pairs, scale, quality)
    if peers is not None:
        _peers(peers, quality, background)
    if model is not None:
        _model(model, camera, frames, every, quality, views, report)
    if ghosts is not None:
        _ghosts(ghosts, scale, frames, quality, report)


def _peers(folder: Path, quality: str, background: bool) -> None:
    from farside.engine.bench.peers import peer_rows, read_peer_table

    names = list(dict.fromkeys(name for row in read_peer_table(folder / "README.md") for name in row.peers))
    table = Table(title=f"PSNR-Y / IV-PSNR in dB, Farside at quality {quality}")
    for column in ("sequence", "target", "views", "frame", *names, "Farside", "to the best, IV-PSNR"):
        table.add_column(column, justify="right")
    for row in peer_rows(folder, quality, background):
        best = max(figures[1] for figures in row.peers.values())
        cells = [f"{p:.2f} / {iv:.2f}" if (p := f[0]) and (iv := f[1]) else "" for f in _figures(row.peers, names)]
        table.add_row(
            row.sequence, row.target, str(row.views), str(row.frame), *cells,
            f"{row.ours[0]:.2f} / {row.ours[1]:.2f}", f"{row.ours[1] - best:+.2f}",
        )  # fmt: skip
    Console(width=150).print(table)


def _figures(peers: dict[str, tuple[float, float]], names: list[str]) -> list[tuple[float, float]]:
    return [peers.get(name, (0.0, 0.0)) for name in names]


def _model(
    folder: Path, chosen: list[str] | None, frames: int, every: int, quality: str, views: int, report: Path | None
) -> None:
    from farside.engine.bench.background import compare_model, hole_picture, inside_rig, summarise
    from farside.engine.tmiv import open_sequence

    sequence = open_sequence(folder)
    cameras, count = chosen or inside_rig(sequence), min(frames, sequence.frame_count)
    if not cameras:
        raise ValueError(f"{folder}: no virtual camera with ground truth stands inside the rig")
    samples = []
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("comparing", total=len(cameras) * 3 * -(-count // every))
        for sample in compare_model(sequence, cameras, count, every, quality, views):
            samples.append(sample)
            bar.advance(task)
    # After the second second, or the later half of something shorter.
    settled = min(int(2 * sequence.fps), count // 2)
    table = Table(title=f"{sequence.name}, quality {quality}: {views} views with the model, {views} and all without")
    columns = ("camera", "with, IV-PSNR", "without", "all views", "worst loss", "holes without", "holes with", "all")
    for column in columns:
        table.add_column(column, justify="right")
    for row in summarise(samples, settled):
        figures = (f"{row[mode]:.2f}" for mode in ("model", "few", "all"))
        holes = (f"{100 * float(row[key]):.3f} %" for key in ("holes_warped", "holes_backdrop", "holes_all"))
        table.add_row(str(row["camera"]), *figures, f"{row['worst_loss']:.2f}", *holes)
    Console(width=120).print(table)
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        worst = max(samples, key=lambda sample: sample.holes_warped * (sample.mode == "model"))
        picture = hole_picture(sequence, worst.camera, worst.frame, quality, views)
        Image.fromarray(picture).save(report / "holes.png")


def _pairs(name: str, scale: float, quality: str) -> None:
    from farside.engine.bench.pairs import measure_pairs
    from farside.engine.synth import make_twin, twin_frame

    twin = make_twin(name, scale)
    with Progress(console=Console(stderr=True)) as bar:
        frames = [twin_frame(twin, index) for index in bar.track(range(6), description="making frames")]
        table = Table(title=f"{name} at scale {scale:g}, quality {quality}, a pair of 640x720 an eye")
        for column in ("updates asked for a second", "updates", "pairs a second", "medians of a pair, ms, eyes' sum"):
            table.add_column(column, justify="right")
        for f_vin in bar.track((0.0, 0.5, 1.0, 2.0, 4.0), description="measuring"):
            rate = measure_pairs(frames, quality, f_vin, 10.0)
            stages = ", ".join(f"{stage} {value:.1f}" for stage, value in rate.stages.items())
            table.add_row(f"{f_vin:g}", f"{rate.updates:.1f}", f"{rate.pairs:.1f}", stages)
    Console(width=140).print(table)


def _ghosts(name: str, scale: float, frames: int, quality: str, report: Path | None) -> None:
    from farside.engine.bench.ghosts import inside_cameras, plot_ghosts, watch_ghosts
    from farside.engine.settings import Settings
    from farside.engine.synth import make_twin

    console = Console()
    twin = make_twin(name, scale)
    cameras = inside_cameras(twin)
    table = Table(title=f"{name} at scale {scale}, quality {quality}: % of the pixels of {len(cameras)} inside cameras")
    columns = ("ghosts", "standing", "holes_model", "holes_warped", "holes_backdrop")
    for column in ("frame", *columns):
        table.add_column(column.replace("_", " "), justify="right")
    samples = []
    every = max(1, frames // 20)
    for sample in watch_ghosts(twin, cameras, range(frames), every, Settings.preset(quality)):
        samples.append(sample)
        if sample.camera == cameras[-1].name:
            moment = [s for s in samples if s.frame == sample.frame]
            means = [100 * sum(getattr(s, column) for s in moment) / len(moment) for column in columns]
            table.add_row(str(sample.frame), *(f"{mean:.3f}" for mean in means))
            console.log(f"frame {sample.frame} of {frames}")
    console.print(table)
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        path = report / f"ghosts_{name}.png"
        try:
            plot_ghosts(samples, f"{name}, scale {scale}, quality {quality}", path)
            console.print(f"plot: {path}")
        except ImportError as error:
            console.print(f"no plot: {error} (pip install farside[plots])")
