"""A live run over localhost with the real engine: replay, two headsets at different rates, an export midway."""

from __future__ import annotations

import asyncio
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import trimesh
from farside.clients.headset import Headset
from farside.clients.replay import Playback, Replay
from farside.engine.io.tmiv import Sequence, open_sequence
from farside.server.protocol import ViewerHello
from PIL import Image
from support.serving import running
from support.shared import SHARED

HANG_S = 540.0  # the first run compiles every kernel


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Atrium if the shared material is there, otherwise a small twin."""
    atrium = SHARED / "sequences" / "Atrium"
    if atrium.is_dir():
        return open_sequence(atrium)
    from farside.engine.synth import write_twin

    folder = tmp_path_factory.mktemp("twin") / "museum"
    write_twin("museum", folder, 0.06, 6)
    return open_sequence(folder)


def fetch(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=HANG_S) as answer:
        return answer.read()


def headset(rate: float, out: Path | None = None, **hello: str) -> Headset:
    viewer = ViewerHello.symmetric(160, 120, 1.2, axes="openxr", **hello)
    return Headset(viewer, rate=rate, seconds=3.0, out=out)


async def compiled(url: str) -> None:
    """Wait until a first viewer has seen several frames: if kernels must be compiled, that takes minutes."""
    scout = headset(5.0)
    scout.seconds = HANG_S
    watching = asyncio.create_task(scout.run(url))
    while len(set(scout.frames)) < 3:
        if watching.done():
            watching.result()
        await asyncio.sleep(0.05)
    watching.cancel()
    await asyncio.gather(watching, return_exceptions=True)


def test_a_live_run(sequence: Sequence, tmp_path: Path) -> None:
    sources = sequence.source_names[:4]
    fast, slow = headset(30.0, tmp_path), headset(5.0, encoding="raw")
    replay = Replay(Playback(sequence, sources, sequence.fps, loop=True))
    meshes: list[bytes] = []

    async def export(url: str) -> None:
        while len(fast.frames) < 2:
            await asyncio.sleep(0.05)
        meshes.append(await asyncio.to_thread(fetch, f"{url}/mesh.glb"))

    async def scenario(url: str) -> dict[str, object]:
        playing = asyncio.create_task(replay.run(url))
        async with asyncio.timeout(HANG_S):
            await compiled(url)
        watching = asyncio.gather(fast.run(url), slow.run(url), export(url))
        async with asyncio.timeout(HANG_S):
            await asyncio.wait((playing, asyncio.ensure_future(watching)), return_when=asyncio.FIRST_COMPLETED)
            if playing.done():
                playing.result()
            await watching
            status = json.loads(await asyncio.to_thread(fetch, f"{url}/status"))
        playing.cancel()
        await asyncio.gather(playing, return_exceptions=True)
        return status

    with running(quality="fast") as url:
        status = asyncio.run(scenario(url))

    assert replay.outcomes["updated"] >= 2
    assert replay.shared
    for viewer in (fast, slow):
        assert viewer.frames == sorted(viewer.frames)  # never back in time
        assert len(viewer.frames) >= 2
    assert fast.sent > 2 * slow.sent
    assert max(fast.frames) > min(fast.frames)  # the video continued while it was watched
    assert status["frames"]["failed"] == 0
    assert status["event_loop"]["longest_stall_during_update_ms"] > 0
    assert {"update.background", "render.warp", "render.encode", "ingest"} <= set(status["stages_ms"])
    mesh = trimesh.load(io.BytesIO(meshes[0]), file_type="glb", force="mesh")
    assert len(mesh.faces) > 100
    assert np.isfinite(mesh.vertices).all()
    pictures = sorted(tmp_path.glob("*_left.png"))
    assert pictures
    with Image.open(pictures[-1]) as image:
        assert image.size == (160, 120)
        assert np.asarray(image).std() > 5


def farside(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "farside.clients.cli", *map(str, arguments)]
    everything = os.environ | environment
    return subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False, env=everything)


def test_the_commands_play_together(sequence: Sequence, tmp_path: Path) -> None:
    """replay, headset and export as typed commands, and their exit codes."""
    sources = ",".join(sequence.source_names[:2])
    with running(quality="fast") as url:
        early = farside("export", url, tmp_path / "early.glb")
        assert (early.returncode, "before the first frame" in early.stderr) == (2, True)
        replay = farside(
            "replay", sequence.folder, url, "--frames", 2, "--sources", sources, "--every-frame", "--deflate"
        )
        assert replay.returncode == 0, replay.stderr
        assert "2 frames sent, 0 skipped to keep the rate; the server took 2 and dropped 0" in replay.stdout
        seen = farside("headset", url, "--seconds", 1, "--size", "64x48", "--rate", 10, "--out", tmp_path)
        assert seen.returncode == 0, seen.stderr
        assert "video frames 1 to 1" in seen.stdout
        assert "latency" in seen.stdout
        assert list(tmp_path.glob("*_right.png"))
        faces = set()
        for name, options in {"model.ply": (), "texture.glb": (), "vertex.glb": ("--colours", "vertex")}.items():
            export = farside("export", url, tmp_path / name, *options)
            assert export.returncode == 0, export.stderr
            faces.add(len(trimesh.load(tmp_path / name, force="mesh").faces))
        assert len(faces) == 1
        assert faces.pop() > 100
    gone = farside("replay", sequence.folder, url, "--patience", 0)
    assert gone.returncode == 2
    assert gone.stderr.splitlines()[-1].startswith(f"farside: no server at {url}")


def test_a_sequence_exports_without_a_server(sequence: Sequence, tmp_path: Path) -> None:
    sources = ",".join(sequence.source_names[:2])
    counts = set()
    for name, colours, attribute in (("a", (), "TEXCOORD_0"), ("b", ("--colours", "vertex"), "COLOR_0")):
        path = tmp_path / f"{name}.glb"
        done = farside("export", sequence.folder, path, "--frames", 1, "--sources", sources, *colours)
        assert done.returncode == 0, done.stderr
        assert "making the file" in done.stderr
        assert f'"{attribute}"'.encode() in path.read_bytes()
        counts.add(len(trimesh.load(path, force="mesh").faces))
    assert len(counts) == 1
    assert counts.pop() > 100


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("model.obj", (), "mesh: model.obj: expected a name that ends in .glb or .ply"),
        ("nowhere/model.glb", (), "model.glb: expected a file in a folder that exists"),
        ("model.glb", ("--colours", "sepia"), "colours: 'sepia': expected one of texture, vertex"),
        ("model.ply", ("--colours", "texture"), "colours: 'texture': expected vertex for ply, which holds no pictures"),
    ],
)
def test_an_export_that_cannot_be_is_refused_at_once(
    name: str, options: tuple[str, ...], message: str, sequence: Sequence, tmp_path: Path
) -> None:
    wrong = farside("export", sequence.folder, tmp_path / name, *options)
    assert wrong.returncode == 2
    assert message in wrong.stderr
    assert "building the model" not in wrong.stderr


def test_the_demo_runs_and_stops(tmp_path: Path) -> None:
    cache = tmp_path / "a cache"
    folder = cache / "museum-0.03-2"
    arguments = ["--scale", 0.03, "--frames", 2, "--port", 0, "--cache", cache]
    command = [sys.executable, "-m", "farside.clients.cli", "demo", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while not folder.is_dir() and process.poll() is None:  # the twin is complete
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        out, error = process.communicate()
    first = subprocess.CompletedProcess(command, process.returncode, out, error)
    assert first.returncode == 0, first.stderr
    assert "watch at http://127.0.0.1:" in first.stdout
    assert list(cache.iterdir()) == [folder]
    size = sum(path.stat().st_size for path in folder.rglob("*"))
    told = re.search(r"the twin will take (\S+) GB in (.+); to remove it: (.+)\n", first.stdout)
    assert told is not None
    assert float(told[1]) * 1e9 == pytest.approx(size, rel=0.1)
    assert told[2] == str(folder)
    again = farside("demo", *arguments, "--seconds", 0.5)
    assert f"the twin is in {folder}, " in again.stdout
    subprocess.run(told[3], shell=True, check=True)
    assert not folder.exists()
