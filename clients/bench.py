"""`farside bench`: measurements that the README's figures come from, each in its own module of `benchmarks`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .render import parse_size

__all__ = ["command"]


def command(
    folders: Annotated[
        list[Path] | None, typer.Argument(metavar="FOLDER", help="Sequences, or folders of them (--accuracy, --trade).")
    ] = None,
    accuracy: Annotated[
        bool, typer.Option("--accuracy", help="All quality figures over FOLDERs and --twins, with a report.")
    ] = False,
    twins: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Twins to make at --scale (--accuracy, --trade, --tolerances)."),
    ] = None,
    peers: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Sequences whose README has the figures of other renderers."),
    ] = None,
    ghosts: Annotated[
        str | None, typer.Option(metavar="NAME", help="Ghosts and holes of the background model over a twin.")
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Every frame of a twin with and without the model, and the model's error."),
    ] = None,
    depth_noise: Annotated[
        float | None, typer.Option(help="Strength of a twin's depth errors (--noise); without it the twin's own.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(metavar="SEQ", help="Few views with the model against few and all without it, by truth."),
    ] = None,
    backdrop: Annotated[
        str | None, typer.Option(metavar="NAME", help="The backdrop's surfaces, farthest or standing, over a twin.")
    ] = None,
    fill: Annotated[
        Path | None, typer.Option(metavar="SEQ", help="Kinds of filling against the truth, inside holes only.")
    ] = None,
    flicker: Annotated[
        Path | None,
        typer.Option(metavar="SEQ", help="Change from frame to frame, for a still head, of what is still in truth."),
    ] = None,
    views: Annotated[
        str | None,
        typer.Option(
            metavar="N,...|all", help="Views given: one number (5, --fill 2), for --accuracy a list (2,3,5,all)."
        ),
    ] = None,
    camera: Annotated[
        list[str] | None, typer.Option(help="Virtual cameras; without it those inside the rig.")
    ] = None,
    every: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Every so many frames (--targets 1, --trade 4, --fill 5, --model, --backdrop 12, --accuracy 15).",
        ),
    ] = None,
    pairs: Annotated[
        str | None, typer.Option(metavar="NAME", help="Stereo pairs a second of a twin while the model is updated.")
    ] = None,
    live: Annotated[
        Path | None,
        typer.Option(metavar="SEQ", help="Server, replay and headset over localhost: rates, stalls, pauses, memory."),
    ] = None,
    fps: Annotated[float | None, typer.Option(help="Video frames a second (--live; the sequence's).", min=0.01)] = None,
    seconds: Annotated[float, typer.Option(help="How long the video plays (--live).", min=1.0)] = 20.0,
    size: Annotated[str, typer.Option(help="Picture of an eye, WxH (--live).")] = "640x720",
    sparse: Annotated[
        Path | None,
        typer.Option(metavar="SEQ", help="Depth punched as by time of flight: completed, not, and whole, by truth."),
    ] = None,
    exposure: Annotated[
        str | None, typer.Option(metavar="NAME", help="A twin whose views have random exposures and white balances.")
    ] = None,
    minified: Annotated[
        str | None, typer.Option(metavar="NAME", help="A twin in pictures coarser than its views, prefiltered or not.")
    ] = None,
    trade: Annotated[
        bool, typer.Option("--trade", help="Every knob's cost and worth over FOLDERs and --twins, with a report.")
    ] = False,
    stages: Annotated[
        str | None,
        typer.Option(metavar="SEQ|NAME", help="Time and work of every stage, on a sequence or a twin at --scale."),
    ] = None,
    targets: Annotated[
        str | None, typer.Option(metavar="NAME", help="Speed and loss beside what is wanted, on a twin (--scale 1).")
    ] = None,
    scaling: Annotated[
        str | None, typer.Option(metavar="NAME", help="Cost of a pair over pixels out and pixels in, on a twin.")
    ] = None,
    extremes: Annotated[
        bool, typer.Option("--extremes", help="Errors against oracles at the extremes of every number; 1 if any fails.")
    ] = False,
    spared: Annotated[
        str | None, typer.Option(metavar="NAME,...", help="Work and memory that twins do not need, and are spared.")
    ] = None,
    tolerances: Annotated[
        bool, typer.Option("--tolerances", help="Automatic tolerances beside smaller and larger ones, over --twins.")
    ] = False,
    scale: Annotated[
        float | None, typer.Option(help="Size of a twin's pictures (0.25; --tolerances 0.07).", min=0.001)
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Frames at most (--stages 8, --trade 12, --accuracy, --fill 16, --spared, --targets 30, "
            "--flicker 60, or 100).",
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for plots, pictures and figures.")] = None,
    quality: Annotated[str, typer.Option(help="fast, balanced or best; a list for --accuracy.")] = "best",
    background: Annotated[
        bool | None, typer.Option("--background/--no-background", help="The model; --accuracy: both without this.")
    ] = None,
) -> None:
    """Measure speed and quality."""
    wishes = {
        "--peers": peers, "--ghosts": ghosts, "--noise": noise, "--model": model, "--pairs": pairs,
        "--sparse": sparse, "--backdrop": backdrop, "--exposure": exposure, "--minified": minified, "--fill": fill,
        "--flicker": flicker, "--live": live, "--stages": stages, "--targets": targets, "--scaling": scaling,
        "--spared": spared,
    }  # fmt: skip
    if not (accuracy or trade or extremes or tolerances) and all(chosen is None for chosen in wishes.values()):
        raise ValueError(
            "bench: nothing to measure: expected --accuracy, --trade, --extremes, --tolerances or one of "
            f"{', '.join(wishes)}, with what to measure it on"
        )
    if tolerances:
        from .benchmarks.tolerances import show_tolerances

        show_tolerances(twins, 0.07 if scale is None else scale, quality, report)
    scale = 0.25 if scale is None else scale
    if accuracy:
        from .benchmarks.accuracy import make_plan, show_accuracy

        plan = make_plan(views, background, quality, frames, every)
        show_accuracy(folders or [], twins, scale, camera or [], plan, report)
    if trade:
        from farside.engine.evaluation.trade import Plan

        from .benchmarks.trade import show_trade

        show_trade(folders or [], twins, scale, Plan(frames or 12, every or 4), report)
    if extremes:
        from .benchmarks.extremes import show_extremes

        show_extremes(report)
    if stages is not None:
        from farside.engine.settings import Settings

        from .benchmarks.stages import show_stages

        settings = Settings.preset(quality, n_render=_few(views), background=background is not False)
        show_stages(stages, scale, frames or 8, settings, report)
    if pairs is not None:
        from .benchmarks.pairs import show_pairs

        show_pairs(pairs, scale, quality)
    if live is not None:
        from .benchmarks.live import show_live

        show_live(live, fps, seconds, quality, parse_size(size))
    if exposure is not None:
        from .benchmarks.exposure import show_exposure

        show_exposure(exposure, scale, quality)
    if minified is not None:
        from .benchmarks.minified import show_minified

        show_minified(minified, scale, quality, _few(views))
    if peers is not None:
        from .benchmarks.peers import show_peers

        show_peers(peers, quality, background is not False)
    if model is not None:
        from .benchmarks.model import show_model

        show_model(model, camera, frames or 100, every or 12, quality, _few(views), report)
    if ghosts is not None:
        from .benchmarks.ghosts import show_ghosts

        show_ghosts(ghosts, scale, frames or 100, quality, report)
    if noise is not None:
        from .benchmarks.noise import show_noise

        show_noise(noise, scale, frames or 100, quality, _few(views), depth_noise)
    if sparse is not None:
        from .benchmarks.sparse import show_sparse

        show_sparse(sparse, camera, frames or 1, every or 12, quality, _few(views))
    if backdrop is not None:
        from .benchmarks.backdrop import show_backdrops

        show_backdrops(backdrop, scale, frames or 100, every or 12, quality)
    if fill is not None:
        from .benchmarks.filling import show_fills

        show_fills(fill, camera, frames or 16, every or 5, quality, _few(views or "2"), background is not False)
    if targets is not None:
        from .benchmarks.targets import show_targets

        show_targets(targets, scale, frames or 30, every or 1)
    if scaling is not None:
        from .benchmarks.targets import show_scaling

        show_scaling(scaling, scale, quality, report)
    if spared is not None:
        from .benchmarks.spared import show_spared

        show_spared(spared.split(","), scale, frames or 30)
    if flicker is not None:
        from .benchmarks.filling import show_flicker

        show_flicker(flicker, camera, frames or 60, quality, _few(views), background is not False)


def _few(views: str | None) -> int:
    """The number that --views says, where it must be one."""
    if views is None:
        return 5
    if not (views.isdecimal() and int(views)):
        raise ValueError(f"--views: {views!r}: expected one number of at least 1")
    return int(views)
