"""Sequences with views that show nothing or have no pose: every command goes on without them, and says so."""

from __future__ import annotations

import asyncio
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from farside.clients.cli import app
from farside.clients.replay import Playback, Replay
from farside.engine.io.recording import open_recording
from farside.engine.io.tmiv import SequenceWriter
from farside.engine.live.core import Source
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame, Texture
from support.doubles import FakeCore
from support.rooms import camera_row, frame
from support.serving import running
from typer.testing import CliRunner

W, H, FRAMES = 48, 32, 4
BLACK_POSE = "-inf,-inf,-inf,nan,nan,nan"


def write(folder: Path, dark: dict[int, tuple[str, ...]], lost: dict[int, str] | None = None) -> Path:
    """A room of three cameras and a virtual one; `dark` cameras show nothing in a frame, v1 has no pose in `lost`
    ones."""
    sources = camera_row(3, (W, H))
    target = dataclasses.replace(sources[1], name="t0", pose=Pose((0.1, 0.25, 0.05)))
    with SequenceWriter(folder, "Room", 30.0, [*sources, target], ("v0", "v1", "v2")) as writer:
        for index in range(FRAMES):
            for view in frame(index, sources, 0.4 * index - 0.4).views:
                name, codes, texture = view.camera.name, view.codes, view.texture
                if name in dark.get(index, ()):
                    codes = np.zeros_like(codes)
                    texture = Texture(np.full_like(texture.y, 64), *(np.full_like(texture.cb, 512) for _ in range(2)))
                moves = lost is not None and name == "v1"
                pose = view.camera.pose.translated((0.0, 1e-3 * index, 0.0)) if moves else None
                writer.write(name, texture, codes, pose=pose)
    if lost is not None:
        file = folder / "v1_poses.csv"
        rows = file.read_text().splitlines()
        file.write_text("\n".join(lost.get(number - 1, row) for number, row in enumerate(rows)) + "\n")
    return folder


@pytest.fixture
def dark(tmp_path: Path) -> Path:
    """The first frame is black; v2 shows nothing in the third one."""
    return write(tmp_path / "Dark", {0: ("v0", "v1", "v2"), 2: ("v2",)})


@pytest.fixture
def lost(tmp_path: Path) -> Path:
    """A tracker that lost itself in the second frame."""
    return write(tmp_path / "Lost", {}, {1: BLACK_POSE})


def run(*arguments: object) -> str:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


def luma(folder: Path) -> np.ndarray:
    samples = np.fromfile(folder / f"t0_texture_{W}x{H}_yuv420p10le.yuv", "<u2").reshape(-1, W * H * 3 // 2)
    return samples[:, : W * H]


def test_render_goes_on_without_views_that_show_nothing(dark: Path, tmp_path: Path) -> None:
    said = run("render", dark, "--out", tmp_path / "all", "--camera", "t0")
    assert "views left out of frames: v0 1x (no depth); v1 1x (no depth); v2 2x (no depth)" in said
    pictures = luma(tmp_path / "all")
    assert len(pictures) == FRAMES
    assert len(np.unique(pictures[0])) == 1  # there is nothing to see yet
    assert all(len(np.unique(picture)) > 1 for picture in pictures[1:])
    assert "v2 2x" in run("render", dark, "--out", tmp_path / "later", "--camera", "t0", "--frames", "1:4")
    np.testing.assert_array_equal(luma(tmp_path / "later"), pictures[1:])
    run("render", dark, "--out", tmp_path / "fresh", "--camera", "t0", "--frames", "1:4", "--no-history")
    np.testing.assert_array_equal(luma(tmp_path / "fresh"), pictures[1:])
    assert "left out" not in run("render", dark, "--out", tmp_path / "one", "--camera", "t0", "--frames", "1:2",
                                 "--no-history")  # fmt: skip


def test_render_goes_on_without_views_that_have_no_pose(lost: Path, tmp_path: Path) -> None:
    assert "views left out of frames: v1 1x (pose)" in run("render", lost, "--out", tmp_path / "a", "--camera", "t0")
    assert len(luma(tmp_path / "a")) == FRAMES
    run("render", lost, "--out", tmp_path / "b", "--camera", "t0", "--frames", "0:1")
    np.testing.assert_array_equal(luma(tmp_path / "b")[0], luma(tmp_path / "a")[0])


@pytest.mark.parametrize("name", ["dark", "lost"])
def test_export_goes_on(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    said = run("export", request.getfixturevalue(name), tmp_path / "m.ply", "--quality", "fast")
    expected = "v2 2x (no depth)" if name == "dark" else "v1 1x (pose)"
    assert expected in said
    assert (tmp_path / "m.ply").stat().st_size > 1000


def test_info_names_them(dark: Path, lost: Path) -> None:
    said = run("info", dark)
    where = "frames, of which it is left out (the first is 0)"
    assert f"camera v0: no depth: no pixel has depth in 1 of 4 {where}" in said
    assert f"camera v2: no depth: no pixel has depth in 2 of 4 {where}" in said
    done = CliRunner().invoke(app, ["info", str(lost)])
    assert done.exit_code == 2
    expected = "camera v1: Poses: v1_poses.csv: 1 of 4 rows are no pose of the camera, which is left out"
    assert expected in " ".join(done.output.split())


def test_info_names_a_picture_that_is_black_while_others_are_not(tmp_path: Path) -> None:
    folder = write(tmp_path / "Room", {})
    file = folder / f"v1_texture_{W}x{H}_yuv420p10le.yuv"
    samples = np.fromfile(file, "<u2").reshape(FRAMES, -1)
    samples[3, : W * H] = 64
    samples.tofile(file)
    said = run("info", folder)
    assert "camera v1: black: the picture is black, but another view's is not in 1 of 4 frames" in said
    assert "left out" not in run("info", write(tmp_path / "Sound", {}))


class Watching(FakeCore):
    """Notes which views are there."""

    there: list[tuple[int, list[int]]] = []  # noqa: RUF012 (of the class: the server makes the core)

    def update(self, frame: Frame, *others: object) -> object:
        self.there.append((frame.index, frame.there))
        return super().update(frame, *others)  # type: ignore[arg-type]


@pytest.fixture
def watching() -> list[tuple[int, list[int]]]:
    Watching.there = []
    return Watching.there


@pytest.mark.parametrize("texture", ["raw", "jpeg"])
def test_replay_says_which_views_are_missing(
    lost: Path, watching: list[tuple[int, list[int]]], texture: str
) -> None:
    recording = open_recording(lost)
    replay = Replay(Playback(recording, recording.source_names, 100.0, every_frame=True, texture=texture))

    def core(source: Source) -> FakeCore:
        return Watching(source)

    with running(core) as url:
        asyncio.run(replay.run(url))
    assert replay.shared is (texture == "raw")
    assert watching == [(0, [0, 1, 2]), (1, [0, 2]), (2, [0, 1, 2]), (3, [0, 1, 2])]
    assert replay.left_out.counts() == {"v1": {"missing": 1}}
    assert replay.outcomes == {"updated": 4}
