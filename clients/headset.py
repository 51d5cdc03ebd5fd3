"""`farside headset`: send head poses to a live server and receive stereo pictures, as a headset would."""

from __future__ import annotations

import asyncio
import math
import ssl
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, NoReturn

import numpy as np
import typer
from farside.engine.io.images import write_png
from farside.engine.io.pose_trace import read_pose_trace
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.server.pictures import decode_texture
from farside.server.protocol import PoseUpdate, Scene, Stereo, ViewerHello, pose_from_wire, pose_to_wire
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from .address import token_of
from .connection import Peer, connect, persist
from .render import parse_size
from .trust import trust_file

__all__ = ["Headset", "command", "swaying"]

Path6 = Callable[[Pose, float], Pose]  # (home, seconds) -> the head's pose


def swaying(home: Pose, seconds: float) -> Pose:
    """The built-in path: in 8 s the head leans and turns around its `home` pose in a figure of eight."""
    turn = 2 * math.pi * seconds / 8.0
    yaw, pitch = math.radians(15) * math.sin(turn), math.radians(5) * math.sin(2 * turn)
    moved = home.translated((0.05 * math.sin(2 * turn), 0.15 * math.sin(turn), 0.05 * math.sin(2 * turn)))
    r = home.rotation() @ Pose.from_euler((0, 0, 0), yaw, pitch, 0.0).rotation()
    return Pose.from_matrix(np.column_stack([r, moved.position]))


def along_trace(path: Path, rate: float) -> Path6:
    """The path of a pose trace, `rate` rows a second, relative to the home pose; the last pose is held.

    Poses are relative because a rig may be tilted or look along any axis: the wearer faces where the cameras look.
    """
    offsets = read_pose_trace(path, _viewport(Pose()))

    def at(home: Pose, seconds: float) -> Pose:
        row = min(seconds * rate, len(offsets) - 1.0)
        before, after = offsets[int(row)], offsets[min(int(row) + 1, len(offsets) - 1)]
        pose = _between(before, after, row - int(row))
        moved = home.translated(pose.position)
        return Pose.from_matrix(np.column_stack([home.rotation() @ pose.rotation(), moved.position]))

    return at


def _viewport(pose: Pose) -> Camera:
    return Camera("home", Perspective(2, 2, 1, 1, 1, 1), pose, DepthCoding(1, 2))


def _between(a: Pose, b: Pose, fraction: float) -> Pose:
    """Interpolate positions linearly and orientations by normalised linear steps: a trace's steps are small."""
    q, r = np.array(a.orientation), np.array(b.orientation)
    q = (1 - fraction) * q + fraction * (r if q @ r >= 0 else -r)
    p = (1 - fraction) * np.array(a.position) + fraction * np.array(b.position)
    w, x, y, z = (q / np.linalg.norm(q)).tolist()
    return Pose((float(p[0]), float(p[1]), float(p[2])), (w, x, y, z))


@dataclass
class Headset:
    """One viewer: sends a pose `rate` times a second, for `seconds`, and keeps figures of the pictures received."""

    hello: ViewerHello
    path: Path6 = swaying
    rate: float = 72.0
    seconds: float = 10.0
    out: Path | None = None
    progress: Callable[[Headset], None] = lambda headset: None
    tls: ssl.SSLContext | None = None  # whom to trust; None: as the machine
    scene: Scene | None = None
    sent: int = 0
    latencies_ms: list[float] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    holes: list[float] = field(default_factory=list)
    bytes_received: int = 0  # of the pictures
    stages: list[dict[str, float]] = field(default_factory=list)
    rungs: Counter[str] = field(default_factory=Counter)  # pictures on each rung of the server's ladder
    span: tuple[float, float] = (0.0, 0.0)  # arrival of the first and of the last picture, s
    _writing: asyncio.Task[None] | None = None
    _before: int = 0  # pictures received over earlier connections

    async def run(self, url: str) -> None:
        """Connect, send poses and receive pictures for `seconds`; raises RefusedError or ConnectionError."""
        async with connect(url, self.hello, tls=self.tls) as (peer, _):
            self._before = len(self.frames)
            self._show_scene(await peer.receive(Scene))
            receiving = asyncio.create_task(self._receive(peer))
            moving = asyncio.create_task(self._move(peer))
            try:
                await asyncio.wait((receiving, moving), return_when=asyncio.FIRST_COMPLETED)
                for task in (receiving, moving):
                    if task.done():
                        task.result()
            finally:
                for task in (receiving, moving):
                    task.cancel()
                await asyncio.gather(receiving, moving, return_exceptions=True)
                if self._writing is not None:
                    await self._writing

    def _show_scene(self, scene: Scene) -> None:
        self.scene = scene
        self.home = pose_from_wire(self.hello.axes, scene.position, scene.orientation)

    async def _move(self, peer: Peer) -> None:
        """Send poses. `seconds` count from the first picture, because kernels may have to be compiled first."""
        start = time.monotonic()
        while (elapsed := time.monotonic() - start) < self.seconds:
            if not self.frames:
                start, elapsed = time.monotonic(), 0.0
            position, orientation = pose_to_wire(self.hello.axes, self.path(self.home, elapsed))
            pose = PoseUpdate(self.sent, time.monotonic(), position, orientation, seen=len(self.frames) - self._before)
            await peer.send(pose)
            self.sent += 1
            await asyncio.sleep(1.0 / self.rate)

    async def _receive(self, peer: Peer) -> NoReturn:
        while True:
            message = await peer.receive(Stereo, Scene)
            if isinstance(message, Stereo):
                await self._take(message)
            elif isinstance(message, Scene):
                self._show_scene(message)

    async def _take(self, picture: Stereo) -> None:
        now = time.monotonic()
        self.span = (self.span[0] or now, now)
        self.latencies_ms.append(1e3 * (now - picture.time))
        self.frames.append(picture.frame)
        self.holes.append(picture.holes)
        self.bytes_received += sum(len(plane) for eye in (picture.left, picture.right) for plane in eye.planes)
        self.stages.append(dict(picture.stages))
        self.rungs[picture.rung] += 1
        if self.out is not None and (self._writing is None or self._writing.done()):
            number = len(self.frames) - 1  # pictures that arrive while PNGs are written are not saved
            self._writing = asyncio.create_task(asyncio.to_thread(_write_pngs, picture, self.out, number))
        self.progress(self)

    @property
    def rate_received(self) -> float:
        """Stereo pictures received a second."""
        elapsed = self.span[1] - self.span[0]
        return (len(self.frames) - 1) / elapsed if elapsed > 0 else 0.0

    def summary(self) -> str:
        """Rate and latency in a few lines."""
        if not self.frames:
            return f"{self.sent} poses sent, no picture received"
        p50, p95, p99 = np.percentile(self.latencies_ms, (50, 95, 99))
        names = dict.fromkeys(name for stages in self.stages for name in stages)
        medians = {n: float(np.median([s[n] for s in self.stages if n in s])) for n in names}
        return (
            f"{len(self.frames)} stereo pictures for {self.sent} poses, {self.rate_received:.1f} a second, "
            f"video frames {self.frames[0]} to {self.frames[-1]}\n"
            f"latency, pose sent to picture received: p50 {p50:.1f}, p95 {p95:.1f}, p99 {p99:.1f} ms\n"
            f"rendering, medians: {', '.join(f'{n} {ms:.1f}' for n, ms in medians.items())} ms; "
            f"holes before filling: {100 * float(np.median(self.holes)):.2f} %" + self._rungs()
        )

    def _rungs(self) -> str:
        chosen = [f"{rung} {count}" for rung, count in self.rungs.most_common() if rung]
        return f"\npictures on the rungs of the server's ladder: {'; '.join(chosen)}" if chosen else ""


def _write_pngs(picture: Stereo, folder: Path, number: int) -> None:
    for name, eye in (("left", picture.left), ("right", picture.right)):
        texture = decode_texture(eye, picture.height, picture.width, name)
        write_png(folder / f"{number:05d}_{name}.png", texture)


def command(
    url: Annotated[str, typer.Argument(help="The server, like http://127.0.0.1:8765.")],
    pose_trace: Annotated[Path | None, typer.Option(help="CSV of head poses (default: a built-in path).")] = None,
    trace_rate: Annotated[float, typer.Option(help="Rows of the trace a second.")] = 30.0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for PNGs; pictures that arrive while some are written are left out.")
    ] = None,
    rate: Annotated[float, typer.Option(min=0.1, max=1000, help="Poses a second.")] = 72.0,
    seconds: Annotated[float, typer.Option(min=0.1, help="Duration, counted from the first picture.")] = 10.0,
    size: Annotated[str, typer.Option(help="Picture size of an eye, WxH.")] = "640x720",
    fov: Annotated[float, typer.Option(help="Horizontal field of view of an eye, degrees.")] = 90.0,
    ipd: Annotated[float, typer.Option(help="Distance between the eyes, metres.")] = 0.063,
    raw: Annotated[bool, typer.Option("--raw", help="Ask for raw pictures instead of JPEG.")] = False,
    axes: Annotated[str, typer.Option(help="Axes of poses on the wire: omaf or openxr.")] = "openxr",
    token: Annotated[str, typer.Option(envvar="FARSIDE_TOKEN", help="The server's token.")] = "",
    ca_file: Annotated[
        str,
        typer.Option(metavar="FILE", envvar="FARSIDE_CA_FILE", help="PEM file of another authority to trust (TLS)."),
    ] = "",
    patience: Annotated[float, typer.Option(help="Seconds to keep trying to connect.")] = 10.0,
) -> None:
    """Send head poses to a live server and receive stereo pictures, as a headset would."""
    width, height = parse_size(size)
    if not 1 < fov < 175:
        raise ValueError(f"--fov: {fov!r}: expected 1 to 175 degrees")
    encoding, token = "raw" if raw else "jpeg", token_of(url, token)
    hello = ViewerHello.symmetric(width, height, math.radians(fov), ipd=ipd, axes=axes, encoding=encoding, token=token)
    path = along_trace(pose_trace, trace_rate) if pose_trace else swaying
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    with Progress(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=console) as bar:
        task = bar.add_task("waiting for pictures")
        headset = Headset(
            hello,
            path,
            rate,
            seconds,
            out,
            lambda h: bar.update(task, description=f"{len(h.frames)} pictures"),
            trust_file(ca_file),
        )
        try:
            asyncio.run(persist(lambda: headset.run(url), patience, partial(console.print, markup=False)))
        except KeyboardInterrupt:
            console.print("stopped")
    print(headset.summary())
    if not headset.frames:
        raise typer.Exit(1)
