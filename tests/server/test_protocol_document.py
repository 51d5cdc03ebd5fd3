"""PROTOCOL.md says what the code does: its bytes decode, its client runs, its tables are complete."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
from pathlib import Path

import pytest
from farside.clients.cli import app
from farside.clients.connection import connect
from farside.server import protocol
from farside.server.pictures import encode_view
from PIL import Image
from support.doubles import CAMERAS, FakeCore, a_view
from support.serving import running
from typer.testing import CliRunner

DOCUMENT = (Path(__file__).parents[2] / "server" / "PROTOCOL.md").read_text("utf-8")


def block(language: str) -> str:
    found = re.findall(rf"```{language}\n(.*?)```", DOCUMENT, re.DOTALL)
    assert len(found) == 1
    return found[0]


def test_the_example_bytes_are_the_pose_that_they_are_said_to_be() -> None:
    update = protocol.decode(bytes.fromhex(block("hex")), protocol.PoseUpdate)
    assert update == protocol.PoseUpdate(7, 1.5, (0.0, 1.6, 0.25), (0.0, 0.0, 0.0, 1.0))


def test_the_options_that_it_names_exist() -> None:
    named = set(re.findall(r"`(--[a-z-]+)", DOCUMENT))
    assert named >= {"--root-path", "--allow-host", "--allow-origin", "--ca-file"}
    helps = [CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "500"}).output for name in ("serve", "replay")]
    assert [name for name in named if not re.search(rf"{name}\b", "".join(helps))] == []


@pytest.mark.parametrize("code", list(protocol.CloseCode))
def test_every_close_code_is_listed(code: protocol.CloseCode) -> None:
    assert f"| {code.value} |" in DOCUMENT


@pytest.mark.parametrize(
    "message",
    [
        protocol.ViewerHello.symmetric(64, 48, 1.0),
        protocol.SourceHello("s", 30.0, CAMERAS),
        protocol.Welcome("s", "c", {}, 3, 1),
        protocol.SharedMemory(1, "m", (4,)),
        protocol.BufferFree(0),
        protocol.Scene("s", 30.0, 2, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        encode_view(a_view(CAMERAS[0]), 0),
        protocol.FrameDone(0, "updated"),
        protocol.PoseUpdate(0, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        protocol.EffectUpdate("e", "mesh", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        protocol.EffectUpdate("e", "projector", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        protocol.EffectRemoval("e"),
        protocol.Error(4400, "a", "b", "c"),
    ],
    ids=lambda message: type(message).__name__,
)
def test_every_field_is_described(message: protocol.Message) -> None:
    assert all(f"`{name}`" in DOCUMENT for name in message._fields())


def test_the_client_in_the_document_runs(tmp_path: Path) -> None:
    """Against a server with a source: it saves pictures of the size it asked for, and ends."""
    (tmp_path / "client.py").write_text(block("python"))

    async def scenario(url: str) -> str:
        async with connect(url, protocol.SourceHello("walls", 30.0, CAMERAS)) as (source, _):
            for camera in CAMERAS:
                await source.send(encode_view(a_view(camera), 4))
            await source.receive(protocol.FrameDone)
            arguments = [sys.executable, "client.py", url.replace("http", "ws"), "3"]
            process = await asyncio.to_thread(
                subprocess.run, arguments, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
            )
            assert process.returncode == 0, process.stderr
            return process.stdout

    with running(FakeCore) as url:
        lines = asyncio.run(scenario(url)).splitlines()
    assert [line.split(":")[0] for line in lines] == ["frame 4"] * 3
    for number in (1, 2, 3):
        with Image.open(tmp_path / f"left{number}.jpg") as picture:
            assert picture.size == (320, 240)
