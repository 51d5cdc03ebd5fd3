"""`farside bench queries`: questions about the background model that are answered in a second, and by HTTP."""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any
from urllib.parse import urlsplit

import msgpack
import numpy as np
import typer
from farside.engine.evaluation.queries import QueryRow, measure_queries, rays_from_inside
from farside.engine.live.core import Source, make_local_core
from farside.engine.live.core_process import ProcessCore
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.frame import Frame
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame
from farside.server.app import make_server
from farside.server.pictures import encode_view
from farside.server.protocol import BufferFree, FrameDone, SourceHello
from farside.server.settings import ServerSettings
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from ..connection import connect
from ..listening import addresses_of, listen
from .options import Frames, Quality, Scale, TwinName

__all__ = ["command", "show_queries"]

_HANG_S = 600.0
_IN_JSON = 2000  # rays in a request


def command(
    name: TwinName,
    scale: Scale = 0.25,
    frames: Frames = 5,
    quality: Quality = "balanced",
    count: Annotated[int, typer.Option(min=1000, max=10_000_000, help="Rays that are cast at once.")] = 1_000_000,
) -> None:
    """Measure rays, closest points and spheres a second against the model of a twin, in the library and by HTTP."""
    show_queries(name, scale, frames, quality, count)


def show_queries(name: str, scale: float, frames: int, quality: str, count: int, repeats: int = 5) -> None:
    """Print how many questions are answered in a second, after `frames` frames of a twin have been played."""
    twin, settings = make_twin(name, scale), Settings.preset(quality)
    video = [twin_frame(twin, index) for index in range(frames)]
    origins, directions = rays_from_inside(twin.sources, count)
    rows: list[QueryRow] = []
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("asking", total=9 + frames)
        engine = Engine(twin.sources, settings)
        for frame in video:
            engine.update(frame)
            bar.advance(task)
        assert engine.model is not None
        triangles = sum(engine.model.counts()[part] for part in ("s_pbs_valid", "p_pbs"))
        rows += measure_queries(engine.model.queries, origins, directions, repeats, lambda: bar.advance(task))
        engine.close()
        rows += _by_http(video, settings, origins, directions, repeats, lambda: bar.advance(task))
    console = Console(width=110)
    console.print(_table(rows, f"{name} at scale {scale:g}, {quality}: {triangles} triangles"))


def _table(rows: list[QueryRow], title: str) -> Table:
    table = Table(title=title)
    for column in ("question", "at once", "a second", "CPU us for one", "found"):
        table.add_column(column, justify="left" if column == "question" else "right")
    for row in rows:
        cpu = "" if np.isnan(row.cpu_us) else f"{row.cpu_us:.2f}"
        table.add_row(row.question, f"{row.count:,}", f"{row.per_second:,.0f}", cpu, f"{100 * row.found:.1f} %")
    return table


def _by_http(
    video: list[Frame], settings: Settings, origins: Any, directions: Any, repeats: int, advance: Callable[[], None]
) -> Iterator[QueryRow]:
    """The nearest hits of rays by HTTP, from a server on this machine and its engine's process; no video plays."""
    many = min(len(origins), ServerSettings().max_queries)
    few = min(many, _IN_JSON)
    packed = {name: array[:many].astype("<f4").tobytes() for name, array in _named(origins, directions)}
    plain = {name: array[:few].tolist() for name, array in _named(origins, directions)}
    with _server(video, settings) as url:
        for what, number, kind, body in (
            ("nearest hit, HTTP, msgpack", many, "application/x-msgpack", msgpack.packb({"query": "rays", **packed})),
            ("nearest hit, HTTP, msgpack", 100, "application/x-msgpack", msgpack.packb(
                {"query": "rays", **{name: data[:1200] for name, data in packed.items()}})),
            ("nearest hit, HTTP, JSON", few, "application/json", json.dumps({"query": "rays", **plain}).encode()),
        ):  # fmt: skip
            client = http.client.HTTPConnection(str(urlsplit(url).hostname), urlsplit(url).port, timeout=_HANG_S)
            walls, data = [], b""
            for _ in range(repeats + 1):
                start = time.perf_counter()
                client.request("POST", "/query", body, {"content-type": kind})
                answer = client.getresponse()
                data = answer.read()
                walls.append(time.perf_counter() - start)
                if answer.status != 200:
                    raise RuntimeError(f"POST /query: {answer.status}: {data[:200]!r}")
            decoded = json.loads(data) if kind.endswith("json") else msgpack.unpackb(data)
            found = float(np.mean(decoded["hit"] if kind.endswith("json") else np.frombuffer(decoded["hit"], np.uint8)))
            client.close()
            yield QueryRow(what, number, number / min(walls[1:]), np.nan, found)
            advance()


def _named(origins: Any, directions: Any) -> tuple[tuple[str, Any], ...]:
    return ("origins", origins), ("directions", directions)


@contextmanager
def _server(video: list[Frame], settings: Settings) -> Iterator[str]:
    """A server on this machine to which a source has played a video; yields its address."""

    def make_core(source: Source) -> ProcessCore:
        return ProcessCore(make_local_core, source.cameras, settings)

    given = ServerSettings(port=0)
    server = make_server(given, make_core)
    with listen(given) as listening:
        thread = threading.Thread(target=server.run, kwargs={"sockets": listening})
        thread.start()
        try:
            url = addresses_of(listening, given)[0].rstrip("/")
            while not server.started and thread.is_alive():
                time.sleep(0.01)
            asyncio.run(_play(url, video))
            yield url
        finally:
            server.should_exit = True
            thread.join(_HANG_S)


async def _play(url: str, video: list[Frame]) -> None:
    cameras = tuple(view.camera for view in video[0].views)
    async with connect(url, SourceHello("bench", 30.0, cameras)) as (source, _welcome):
        for frame in video:
            for view in frame.views:
                await source.send(encode_view(view, frame.index))
            while not isinstance(await source.receive(FrameDone, BufferFree), FrameDone):
                pass
