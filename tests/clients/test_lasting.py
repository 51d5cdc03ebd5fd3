"""A server that keeps its model: it is killed and started again; other rigs, damaged files and full disks."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from farside.clients.cli import app
from farside.clients.connection import RefusedError
from farside.clients.replay import Playback, Replay
from farside.engine.background.saved_model import SavedModel
from farside.engine.io.recording import open_recording
from farside.engine.io.tmiv import SequenceWriter
from farside.engine.rig.camera import Pose
from support.rooms import camera_row, frame
from typer.testing import CliRunner

HANG_S = 540.0  # the first run compiles every kernel
FRAMES = 6


def room(folder: Path, spacing: float = 0.4, start: float | None = None) -> Path:
    """A sequence of three cameras before which a box moves. start: where, on the row, the first one begins to move,
    metres; None: it stands still."""
    sources = camera_row(3, (48, 32), spacing)
    with SequenceWriter(folder, folder.name, 30.0, sources, ("v0", "v1", "v2")) as writer:
        for index in range(FRAMES):
            here = list(sources)
            if start is not None:
                here[0] = dataclasses.replace(sources[0], pose=Pose((0.0, start - 0.05 * index, 0.0)))
            for view in frame(index, here, 0.1 * index - 0.3).views:
                pose = None if start is None or view.camera.name != "v0" else view.camera.pose
                writer.write(view.camera.name, view.texture, view.codes, pose)
    return folder


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return room(tmp_path_factory.mktemp("room") / "Room")


@contextmanager
def serving(*options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`farside serve` in a process of its own, and its address."""
    command = [sys.executable, "-m", "farside.clients.cli", "serve", "--port", "0", "--quality", "fast", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().split()[2].rstrip("/")
        finally:
            process.kill()


def play(sequence: Path, url: str, frames: int = FRAMES) -> Replay:
    recording = open_recording(sequence)
    replay = Replay(Playback(recording, recording.source_names, 100.0, frames=frames, every_frame=True))
    asyncio.run(asyncio.wait_for(replay.run(url), HANG_S))
    return replay


def fetch(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=HANG_S) as answer:
        return bytes(answer.read())


def engine_of(url: str) -> dict[str, Any]:
    status: dict[str, Any] = json.loads(fetch(f"{url}/status"))["engine"]
    return status


def saved_of(url: str) -> dict[str, Any]:
    status: dict[str, Any] = engine_of(url)["saved"]
    return status


def wait_for(condition: Any) -> None:
    deadline = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def run(*arguments: Any) -> tuple[int, str]:
    command = [sys.executable, "-m", "farside.clients.cli", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S)
    return done.returncode, done.stdout + done.stderr


def test_a_killed_server_goes_on_where_it_was_saved(sequence: Path, tmp_path: Path) -> None:
    file = tmp_path / "room.farside"
    options = ("--model", str(file), "--save-interval-s", "0.02")
    with serving(*options) as (process, url):
        play(sequence, url)
        wait_for(lambda: file.exists() and SavedModel.read(file).frame == FRAMES - 1)
        before = fetch(f"{url}/mesh.glb")
        process.kill()  # it has no time for anything
        process.wait(HANG_S)
    assert os.listdir(tmp_path) == [file.name]
    code, text = run("export", file, tmp_path / "out.glb")
    assert (code, "bytes" in text) == (0, True)
    assert (tmp_path / "out.glb").read_bytes() == before  # bit for bit
    code, text = run("info", file)
    assert code == 0
    assert "no problems found" in text
    assert f"newest frame          │ {FRAMES - 1}" in text
    with serving(*options) as (process, url):
        play(sequence, url, 1)
        assert SavedModel.read(file).model.frames >= FRAMES - 1  # it has not begun anew
        process.send_signal(signal.SIGTERM)
        assert process.wait(HANG_S) == 0
    assert SavedModel.read(file).frame == 0  # the newest frame's number is that of the second source


def test_a_server_that_ends_saves_first_even_if_it_is_not_time(sequence: Path, tmp_path: Path) -> None:
    file = tmp_path / "room.farside"
    with serving("--model", str(file)) as (process, url):
        play(sequence, url)
        assert not file.exists()
        process.send_signal(signal.SIGINT)
        assert process.wait(HANG_S) == 0
    assert SavedModel.read(file).frame == FRAMES - 1


def test_another_rig_is_refused_and_the_service_goes_on(sequence: Path, tmp_path: Path) -> None:
    file = tmp_path / "room.farside"
    other = room(tmp_path / "Other", 0.5)
    with serving("--model", str(file)) as (process, url):
        play(sequence, url, 2)
        with pytest.raises(RefusedError, match=r"model room\.farside: camera v0: position: .*as the source has it"):
            play(other, url, 1)
        play(sequence, url, 2)
        process.send_signal(signal.SIGTERM)
        assert process.wait(HANG_S) == 0
    whole = file.read_bytes()
    with serving("--model", str(file)) as (process, url):
        with pytest.raises(RefusedError, match=r"model room\.farside: camera v0: position: .*as the source has it"):
            play(other, url, 1)
        assert file.read_bytes() == whole
        play(sequence, url, 1)
        process.kill()


def test_a_camera_that_moves_may_come_back_anywhere(sequence: Path, tmp_path: Path) -> None:
    file = tmp_path / "room.farside"
    first, again = room(tmp_path / "First", start=-0.4), room(tmp_path / "Again", start=-0.9)
    other = room(tmp_path / "Other", 0.5, start=-0.4)  # the cameras that stand still are elsewhere
    with serving("--model", str(file)) as (process, url):
        play(first, url)
        pid = engine_of(url)["pid"]
        with pytest.raises(RefusedError, match=r"model room\.farside: camera v2: position: .*as the source has it"):
            play(other, url, 1)
        play(again, url, 2)
        assert engine_of(url)["pid"] == pid
        process.send_signal(signal.SIGTERM)
        assert process.wait(HANG_S) == 0
    saved = SavedModel.read(file)
    assert saved.model.frames == FRAMES + 1  # after the first one: it has not begun anew
    assert saved.moving == (0,)
    assert saved.placed[0].position == pytest.approx((0.0, -0.95, 0.0))
    with serving("--model", str(file)) as (process, url):  # also before any frame has shown that it moves
        play(first, url, 1)
        play(again, url, 1)
        process.send_signal(signal.SIGTERM)
        assert process.wait(HANG_S) == 0
    assert SavedModel.read(file).model.frames == FRAMES + 3


def test_a_folder_that_is_gone_is_counted_and_the_service_goes_on(sequence: Path, tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    with serving("--model", str(folder / "room.farside"), "--save-interval-s", "0.01") as (process, url):
        play(sequence, url, 1)
        wait_for(lambda: list(folder.iterdir()) and (folder / "room.farside").exists())
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()
        wait_for(lambda: play(sequence, url, 2) and saved_of(url)["failures"] > 0)
        assert "FileNotFoundError" in saved_of(url)["error"]
        assert 'farside_model_saves_total{outcome="failed"}' in fetch(f"{url}/metrics").decode()
        folder.mkdir()
        wait_for(lambda: play(sequence, url, 2) and saved_of(url)["error"] == "")
        process.kill()
        assert process.stderr is not None
        assert "could not be saved: FileNotFoundError" in process.stderr.read()


@pytest.mark.parametrize("field", ["--model", "--seed-model"])
@pytest.mark.parametrize("damage", ["cut", "bit", "other", "empty"])
def test_a_damaged_file_ends_with_one_line_that_names_it(tmp_path: Path, field: str, damage: str) -> None:
    file = tmp_path / "room.farside"
    make_saved(file)
    data = bytearray(file.read_bytes())
    if damage == "cut":
        del data[-1:]
    elif damage == "bit":
        data[len(data) // 3] ^= 16
    elif damage == "other":
        data = bytearray(b"PK\3\4" + bytes(100))
    else:
        data.clear()
    file.write_bytes(data)
    for command in (("serve", "--port", "0", field, file), ("info", file), ("export", file, tmp_path / "out.glb")):
        code, text = run(*command)
        assert code == 2
        (line,) = text.strip().splitlines()
        assert str(file) in line
        assert ": expected " in line
    assert file.read_bytes() == data
    assert not (tmp_path / "out.glb").exists()


def make_saved(file: Path) -> None:
    from farside.engine.pipeline.engine import Engine
    from farside.engine.settings import Settings

    cameras = camera_row(3, (48, 32))
    engine = Engine(cameras, Settings.preset("fast"))
    engine.update(frame(0, cameras, 0.0))
    state = engine.state()
    assert state is not None
    state.write(file)
    engine.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--model", "{file}", "--quality", "balanced"), "--model: {file}: setting tolerance_px: 0.5: expected 0.25"),
        (("--model", "{folder}/no/room.farside"), "--model: '{folder}/no/room.farside': expected a file in"),
        (("--seed-model", "{folder}/none.glb"), "--seed-model: "),
        (("--model", "{file}", "--no-background"), "--model: '{file}': expected none without a background model"),
    ],
)
def test_options_that_do_not_fit_are_refused(tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    file = tmp_path / "room.farside"
    make_saved(file)
    names = {"file": file, "folder": tmp_path}
    code, text = run("serve", "--port", "0", *(option.format(**names) for option in options))
    assert code == 2
    assert message.format(**names) in text


def test_render_begins_with_an_earlier_model(sequence: Path, tmp_path: Path) -> None:
    file, report = tmp_path / "room.glb", tmp_path / "report.json"
    for arguments in (
        ("export", sequence, file, "--quality", "fast"),
        ("render", sequence, "--out", tmp_path / "out", "--camera", "v1", "--frames", "0:1", "--quality", "fast",
         "--seed-model", file, "--report", report),
        ("export", sequence, tmp_path / "again.glb", "--quality", "fast", "--seed-model", file, "--frames", "1"),
    ):  # fmt: skip
        done = CliRunner().invoke(app, list(map(str, arguments)), catch_exceptions=False)
        assert done.exit_code == 0, done.output
    assert json.loads(report.read_text())["frames"][0]["triangles"]["s_pbs"] > 0
    assert (tmp_path / "again.glb").stat().st_size > 0
