"""The Recording protocol: its implementations, reading in order, and that nobody uses anything beyond the protocol."""

from __future__ import annotations

import asyncio
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from farside.clients.replay import Playback, Replay, parse_sources
from farside.engine.evaluation.accuracy import Plan, judge_pictures
from farside.engine.evaluation.background import compare_model, inside_rig
from farside.engine.evaluation.twin_recording import TwinRecording
from farside.engine.io.pose_trace import write_poses
from farside.engine.io.recording import Playhead, Recording, open_recording
from farside.engine.pipeline.offline import OfflineRenderer, RenderJob
from farside.engine.rig.camera import Pose
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, write_twin
from support.doubles import FakeCore
from support.recordings import NAMES, Bare, MemoryRecording
from support.rooms import camera_row, frame, see
from support.serving import running

HANG_S = 60.0
BOXES = (-0.4, 0.0, 0.4)


def make_recording() -> MemoryRecording:
    cameras = camera_row(3, (48, 32))
    target = dataclasses.replace(cameras[1], name="t0")
    truth = {"t0": [see(target, box).texture for box in BOXES]}
    return MemoryRecording([frame(index, cameras, box) for index, box in enumerate(BOXES)], [target], truth)


def job(recording: Recording, start: int, stop: int) -> RenderJob:
    target = recording.camera("t0")
    return RenderJob(recording, recording.source_names, lambda index: {"t0": target}, start, stop)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("twin") / "hijack"
    write_twin("hijack", path, 0.02, 3)
    return path


@pytest.mark.parametrize("index", range(3))
def test_a_twin_reads_the_same_from_disk_and_from_memory(folder: Path, index: int) -> None:
    disk, memory = open_recording(folder), TwinRecording(make_twin("hijack", 0.02))
    assert disk.source_names == memory.source_names
    assert disk.camera_names == memory.camera_names
    assert disk.truth_names == memory.truth_names != ()
    assert set(disk.truth_names) < set(disk.camera_names)
    assert disk.fps == memory.fps
    names = disk.source_names[1:3]
    for read in (disk.frame(index, names), *disk.frames(index, index + 1, names)):
        assert read.index == index
        for got, want in zip(read.views, memory.frame(index, names).views, strict=True):
            np.testing.assert_array_equal(got.codes, want.codes)
            np.testing.assert_array_equal(got.texture.y, want.texture.y)
    name = disk.truth_names[0]
    np.testing.assert_array_equal(disk.texture(name, index).y, memory.texture(name, index).y)
    assert len(list(disk.frames(index))) == 3 - index


def test_poses_are_those_of_the_moving_cameras() -> None:
    recording = TwinRecording(make_twin("gymnasium-a", 0.01))
    moving = [name for name in recording.source_names if recording.poses(name) is not None]
    assert len(moving) == 1
    poses = recording.poses(moving[0])
    assert poses is not None
    assert len(poses) == recording.frame_count
    assert poses[0] != poses[7] == recording.camera(moving[0], 7).pose


def test_a_folder_of_no_known_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"expected one, .*json"):
        open_recording(tmp_path)


def test_a_playhead_reads_in_order_where_it_can() -> None:
    recording = make_recording()
    playhead = Playhead(recording, ["v0", "v2"])
    asked = [0, 1, 2, 2, 1, 0, 0, 1, 2, 0, 2]
    frames = [playhead.frame(index) for index in asked]
    assert [f.index for f in frames] == asked
    assert all([view.camera.name for view in f.views] == ["v0", "v2"] for f in frames)
    # Earlier frames and repetitions are looked up; following frames are read in order, and only when requested.
    assert recording.sought == [2, 1, 0, 0, 0]
    assert recording.played == [0, 1, 2, 1, 2, 2]
    for outside in (3, -1):
        with pytest.raises(ValueError, match=f"frame: {outside}: expected 0 to 2"):
            Playhead(make_recording()).frame(outside)


def test_offline_rendering_needs_no_more_than_the_protocol() -> None:
    """The pictures equal those of a TMIV-like class with these frames; frames before the first are played in order."""
    recording = make_recording()
    settings = Settings.preset("fast", n_render=2)
    (row,) = OfflineRenderer(job(Bare(recording), 2, 3), settings).frames()
    index, pictures, _ = row
    assert index == 2
    assert recording.sought == []  # never out of order
    assert recording.played == [0, 1, 2]
    error = pictures["t0"].texture.y.astype(float) - recording.texture("t0", 2).y
    assert np.median(np.abs(error)) <= 2
    assert np.mean(np.abs(error) > 50) < 0.1


def test_played_to_and_fro_after_the_end() -> None:
    recording = make_recording()
    rows = list(OfflineRenderer(job(Bare(recording), 0, 5), Settings.preset("fast", background=False)).frames())
    assert [index for index, _, _ in rows] == [0, 1, 2, 3, 4]
    assert recording.sought == [2, 1]
    first, back = rows[1][1]["t0"], rows[4][1]["t0"]
    np.testing.assert_array_equal(first.texture.y, back.texture.y)


def test_replay_needs_no_more_than_the_protocol(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = make_recording()
    bare = Bare(recording)
    seen: list[int] = []
    original = FakeCore.update

    def update(self: FakeCore, got, *others):
        seen.append(sum(int(view.codes.sum()) for view in got.views))
        return original(self, got, *others)

    monkeypatch.setattr(FakeCore, "update", update)
    names = parse_sources(bare, "v2,v0")
    replay = Replay(Playback(bare, names, 100.0, frames=5, loop=True, every_frame=True, depth="zlib"))

    async def scenario(url: str) -> None:
        async with asyncio.timeout(HANG_S):
            await replay.run(url)

    with running(FakeCore) as url:
        asyncio.run(scenario(url))
    assert replay.outcomes == {"updated": 5}
    expected = [sum(int(v.codes.sum()) for v in recording._named(i, names).views) for i in (0, 1, 2, 2, 1)]
    assert seen == expected


def test_the_benchmarks_need_no_more_than_the_protocol() -> None:
    bare = Bare(make_recording())
    assert inside_rig(bare) == ["t0"]
    plan = Plan(qualities=("fast",), views=(2,), model=(True,), frames=2, every=1)
    judged = list(judge_pictures(bare, ["t0"], plan))
    assert [j.sample.frame for j in judged] == [0, 1]
    samples = list(compare_model(bare, ["t0"], 2, 1, "fast", 2))
    assert {s.mode for s in samples} == {"model", "few", "all"}


def test_more_than_the_protocol_is_noticed() -> None:
    assert "frames" in NAMES
    assert "view" not in NAMES
    with pytest.raises(AssertionError, match="folder"):
        _ = Bare(make_recording()).folder


def test_poses_of_a_camera_that_moves_may_be_given(tmp_path):
    folder, trace = tmp_path / "seq", tmp_path / "elsewhere" / "trace.csv"
    write_twin("gymnasium-a", folder, 0.03, frames=3, truth=False)
    trace.parent.mkdir()
    poses = [Pose.from_euler((0.1 * k, 0.2, 1.5), 0.3 * k, 0.0, 0.0) for k in range(3)]
    write_poses(trace, poses)
    assert open_recording(folder).poses("v0") is None
    assert open_recording(folder).poses("v4") is not None
    recording = open_recording(folder, {"v0": trace, "v4": trace})  # goes before the file that the JSON names
    for name in ("v0", "v4"):
        for k, pose in enumerate(poses):
            np.testing.assert_allclose(recording.camera(name, k).pose.position, pose.position)
        assert len(recording.poses(name)) == 3
    assert recording.frame(2).views[0].camera.pose.position[0] == pytest.approx(0.2)
    write_poses(trace, poses[:2])
    assert open_recording(folder, {"v0": trace}).frame_count == 2
    with pytest.raises(ValueError, match="moving camera: 'v9': expected one of v0, v1"):
        open_recording(folder, {"v9": trace})
    with pytest.raises(ValueError, match=r"camera v0: Poses: .*missing.csv"):
        open_recording(folder, {"v0": tmp_path / "missing.csv"})
