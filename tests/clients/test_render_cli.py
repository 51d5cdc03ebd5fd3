"""`farside render` and `farside bench --peers`: files, sizes, report keys, and errors for bad options."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from farside.clients.cli import app
from farside.engine.io.pose_trace import write_poses
from farside.engine.io.tmiv import SequenceWriter
from farside.engine.rig.camera import Pose
from support.effects import cube_glb, png, white
from support.rooms import camera_row, frame
from typer.testing import CliRunner

STAGES = {"ingest", "triangulate", "background", "pbi", "warp", "fill", "total"}
HOLES = {"before_backdrop", "after_backdrop", "after_filling"}
TRIANGLES = {"s_pbs", "p_pbs", "warped"}
W, H, COUNT = 48, 32, 3


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A sequence of three source cameras and two virtual ones, in which a box moves."""
    folder = tmp_path_factory.mktemp("room") / "Room"
    sources = camera_row(3, (W, H))
    virtual = [dataclasses.replace(sources[1], name=name) for name in ("viewport", "t0")]
    virtual[1] = dataclasses.replace(virtual[1], pose=Pose((0.1, 0.25, 0.05)))
    with SequenceWriter(folder, "Room", 30.0, [*sources, *virtual], ("v0", "v1", "v2")) as writer:
        for index in range(COUNT):
            for view in frame(index, sources, 0.4 * index - 0.4).views:
                writer.write(view.camera.name, view.texture, view.codes)
    return folder


@pytest.fixture
def effects(tmp_path):
    """A file with a projector and a cube."""
    posed = {"position": [0.0, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
    (tmp_path / "white.png").write_bytes(png(white()))
    (tmp_path / "cube.glb").write_bytes(cube_glb())
    cube = {"kind": "mesh", **posed, "position": [3.0, 1.0, 0.0], "scale": 0.15, "mesh": "cube.glb"}
    screen = {"kind": "projector", **posed, "fov": 0.4, "picture": "white.png"}
    path = tmp_path / "effects.json"
    path.write_text(json.dumps({"screen": screen, "cube": cube}))
    return path


@pytest.fixture
def trace(tmp_path):
    path = tmp_path / "walk.csv"
    write_poses(path, [Pose.from_euler((0.02 * k, 0.05 * k, 0.0), 0.02 * k, 0.0, 0.0) for k in range(COUNT)])
    return path


def render(room, out, *options):
    """Run the command; returns the files written and their sizes in bytes."""
    done = CliRunner().invoke(app, ["render", str(room), "--out", str(out), *map(str, options)])
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return {path.name: path.stat().st_size for path in sorted(out.iterdir())}


def yuv_files(name, frames, w=W, h=H):
    """File sizes of a texture of 10 bits and a depth of 16 bits, both 4:2:0 with two bytes for each sample."""
    size = frames * 2 * (w * h + 2 * ((w + 1) // 2) * ((h + 1) // 2))
    return {
        f"{name}_texture_{w}x{h}_yuv420p10le.yuv": size,
        f"{name}_depth_{w}x{h}_yuv420p16le.yuv": size,
    }


def test_cameras_are_rendered_to_files_of_their_names(room, tmp_path):
    files = render(room, tmp_path / "out", "--camera", "t0", "--camera", "v1")
    assert files == yuv_files("t0", COUNT) | yuv_files("v1", COUNT)


def test_a_reference_camera_is_rendered_as_it_was_seen(room, tmp_path):
    render(room, tmp_path / "out", "--camera", "v1", "--views", 1, "--no-background")
    for kind, form, error in (("texture", "yuv420p10le", 1), ("depth", "yuv420p16le", 3)):
        name = f"v1_{kind}_{W}x{H}_{form}.yuv"
        was, now = (np.fromfile(folder / name, "<u2").astype(int) for folder in (room, tmp_path / "out"))
        was, now = (a.reshape(COUNT, -1)[:, : W * H].reshape(COUNT, H, W)[:, 1:-1, 1:-1] for a in (was, now))
        assert np.median(np.abs(was - now)) <= error
        assert np.mean(np.abs(was - now) <= error) > 0.97


def test_report_has_every_frames_and_the_summarys_figures(room, tmp_path):
    path = tmp_path / "report.json"
    render(room, tmp_path / "out", "--camera", "t0", "--report", path, "--views", 2, "--init", 2, "--update", 3)
    report = json.loads(path.read_text("utf-8"))
    assert [row["frame"] for row in report["frames"]] == [0, 1, 2]
    for row in report["frames"]:
        assert set(row["stages"]) == STAGES
        assert row["stages"]["total"] == pytest.approx(sum(row["stages"][k] for k in STAGES - {"total"}))
        assert set(row["hole_fraction"]) == HOLES
        assert set(row["triangles"]) == TRIANGLES
        fractions = [row["hole_fraction"][key] for key in ("before_backdrop", "after_backdrop", "after_filling")]
        assert 1 >= fractions[0] >= fractions[1] >= fractions[2] == 0
        assert row["triangles"]["s_pbs"] > 0
        assert row["triangles"]["warped"] > 0
    for group, keys in (("stages", STAGES), ("hole_fraction", HOLES), ("triangles", TRIANGLES)):
        assert set(report["summary"][group]) == keys
        for key in keys:
            values = [row[group][key] for row in report["frames"]]
            assert report["summary"][group][key]["median"] == pytest.approx(np.median(values))
            assert report["summary"][group][key]["p95"] == pytest.approx(np.percentile(values, 95))
    used = report["settings"]
    assert (used["n_render"], used["n_init"], used["n_update"], used["background"]) == (2, 2, 3, True)


def test_quality_and_switches_reach_the_settings(room, tmp_path):
    path = tmp_path / "report.json"
    options = ("--quality", "fast", "--no-background", "--no-fill", "--sources", "v2,v0", "--frames", "0:1")
    files = render(room, tmp_path / "out", "--camera", "t0", "--report", path, *options)
    assert files == yuv_files("t0", 1)
    report = json.loads(path.read_text("utf-8"))
    assert (report["settings"]["background"], report["settings"]["fill"]) == (False, "none")
    assert report["settings"]["blend"] == 1
    (row,) = report["frames"]
    assert set(row["views"]["t0"]) <= {"v0", "v2"}
    assert row["triangles"]["s_pbs"] == row["triangles"]["p_pbs"] == 0
    assert row["hole_fraction"]["after_filling"] == row["hole_fraction"]["before_backdrop"]


def test_a_source_left_out_is_a_virtual_camera(room, tmp_path):
    path = tmp_path / "report.json"
    render(room, tmp_path / "out", "--camera", "v1", "--sources", "v0,v2", "--report", path)
    for row in json.loads(path.read_text("utf-8"))["frames"]:
        assert set(row["views"]["v1"]) == {"v0", "v2"}


@pytest.mark.parametrize(("frames", "expected"), [("1:3", [1, 2]), ("2:", [2]), (":2", [0, 1])])
def test_frame_ranges(room, tmp_path, frames, expected):
    path = tmp_path / "report.json"
    files = render(room, tmp_path / "out", "--camera", "t0", "--frames", frames, "--report", path)
    assert files == yuv_files("t0", len(expected))
    assert [row["frame"] for row in json.loads(path.read_text("utf-8"))["frames"]] == expected


def test_later_frames_are_the_same_whether_earlier_ones_are_written(room, tmp_path):
    name = f"t0_texture_{W}x{H}_yuv420p10le.yuv"
    render(room, tmp_path / "all", "--camera", "t0")
    render(room, tmp_path / "last", "--camera", "t0", "--frames", "2:3")
    last = (tmp_path / "last" / name).read_bytes()
    assert (tmp_path / "all" / name).read_bytes()[-len(last) :] == last


def test_pictures_and_masks(room, tmp_path):
    options = ("--camera", "t0", "--frames", "1:2", "--png", "--ppm-masks", "--no-fill", "--sources", "v1")
    files = render(room, tmp_path / "out", *options)
    assert set(files) == {*yuv_files("t0", 1), "t0_0001.png", "t0_0001_mask.ppm"}
    assert (tmp_path / "out" / "t0_0001.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    mask = (tmp_path / "out" / "t0_0001_mask.ppm").read_bytes()
    header = b"P6\n%d %d\n255\n" % (W, H)
    assert mask.startswith(header)
    pixels = np.frombuffer(mask[len(header) :], np.uint8).reshape(H, W, 3)
    holes = (pixels == (128, 200, 255)).all(-1)
    assert 0 < holes.mean() < 0.5  # where v1 saw nothing


def test_pose_trace(room, tmp_path, trace):
    assert render(room, tmp_path / "one", "--pose-trace", trace) == yuv_files("walk", COUNT)
    files = render(room, tmp_path / "two", "--pose-trace", trace, "--stereo", "--ipd", 0.1)
    assert files == yuv_files("walk_left", COUNT) | yuv_files("walk_right", COUNT)
    textures = (tmp_path / "two" / f"walk_{eye}_texture_{W}x{H}_yuv420p10le.yuv" for eye in ("left", "right"))
    left, right = (path.read_bytes() for path in textures)
    assert left != right


def test_pose_trace_with_its_own_picture(room, tmp_path, trace):
    options = ("--pose-trace", trace, "--stereo", "--size", "31x21", "--fov", 80)
    files = render(room, tmp_path / "out", *options)
    assert files == yuv_files("walk_left", COUNT, 31, 21) | yuv_files("walk_right", COUNT, 31, 21)
    files = render(room, tmp_path / "mono", "--pose-trace", trace, "--size", "20x30")
    assert files == yuv_files("walk", COUNT, 20, 30)


def test_a_trace_longer_than_the_sequence_plays_it_to_and_fro(room, tmp_path):
    path, count = tmp_path / "still.csv", 2 * COUNT + 1
    write_poses(path, [Pose()] * count)
    options = ("--pose-trace", path, "--views", 1, "--no-background")
    assert render(room, tmp_path / "out", *options) == yuv_files("still", count)
    texture = np.fromfile(tmp_path / "out" / f"still_texture_{W}x{H}_yuv420p10le.yuv", "<u2").reshape(count, -1)
    assert (texture[0] != texture[1]).any()
    assert (texture[1] != texture[2]).any()
    order = [int(np.argmin([(texture[k] != texture[j]).sum() for j in range(COUNT)])) for k in range(count)]
    assert order == [0, 1, 2, 2, 1, 0, 0]


BAD = {
    "--camera: unknown": (["--camera", "t9"], "t9"),
    "--sources: unknown": (["--camera", "t0", "--sources", "v0,v9"], "--sources: 'v9'"),
    "--sources: virtual": (["--camera", "t0", "--sources", "t0"], "--sources: 't0'"),
    "--size": (["--pose-trace", "TRACE", "--size", "31by21"], "--size: '31by21'"),
    "--size: nothing": (["--pose-trace", "TRACE", "--size", "0x21"], "--size: '0x21'"),
    "--fov": (["--pose-trace", "TRACE", "--fov", "180"], "field of view: 180"),
    "--frames": (["--camera", "t0", "--frames", "2"], "--frames: '2'"),
    "--frames: too many": (["--camera", "t0", "--frames", "0:4"], "--frames: '0:4'"),
    "--frames: none": (["--camera", "t0", "--frames", "2:2"], "--frames: '2:2'"),
    "--frames: words": (["--camera", "t0", "--frames", "a:b"], "--frames: 'a:b'"),
    "both": (["--camera", "t0", "--pose-trace", "TRACE"], "--camera, --pose-trace"),
    "neither": ([], "--camera, --pose-trace"),
    "--stereo without a trace": (["--camera", "t0", "--stereo"], "--stereo"),
    "--quality": (["--camera", "t0", "--quality", "good"], "quality: 'good'"),
    "--views": (["--camera", "t0", "--views", "0"], "n_render: 0"),
    "--ipd": (["--pose-trace", "TRACE", "--stereo", "--ipd", "-1"], "ipd: -1"),
    "missing trace": (["--pose-trace", "nowhere.csv"], "nowhere.csv"),
}


@pytest.mark.parametrize(("options", "said"), BAD.values(), ids=BAD.keys())
def test_bad_options_are_named_and_nothing_is_written(room, tmp_path, trace, options, said):
    options = [str(trace) if option == "TRACE" else option for option in options]
    done = CliRunner().invoke(app, ["render", str(room), "--out", str(tmp_path / "out"), *options])
    assert isinstance(done.exception, (ValueError, OSError))  # one line and exit code 2: see the next test
    assert said in str(done.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("what", ["camera", "sequence"])
def test_bad_input_is_one_line_and_exit_code_2(room, tmp_path, what):
    folder, camera = (room, "t9") if what == "camera" else (tmp_path / "nowhere", "t0")
    options = ["render", folder, "--out", tmp_path / "out", "--camera", camera]
    command = [sys.executable, "-m", "farside.clients.cli", *map(str, options)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stderr.startswith("farside: ")
    assert done.stderr.count("\n") == 1
    assert ("t9" if what == "camera" else "nowhere") in done.stderr


@pytest.mark.parametrize("name", ["render", "export", "bench", "replay"])
def test_frames_that_are_left_out_are_told(room, tmp_path, name):
    short = tmp_path / "Room"
    shutil.copytree(room, short)
    depth = short / f"v1_depth_{W}x{H}_yuv420p16le.yuv"
    depth.write_bytes(depth.read_bytes()[: -W * H])
    options = {
        "render": ["render", short, "--out", tmp_path / "out", "--camera", "t0", "--no-background"],
        "export": ["export", short, tmp_path / "model.ply", "--quality", "fast"],
        "bench": ["bench", "stages", short, "--frames", "1"],
        "replay": ["replay", short, "http://127.0.0.1:9", "--patience", "0"],  # nobody is there
    }
    command = [sys.executable, "-m", "farside.clients.cli", *map(str, options[name])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == (0 if name != "replay" else 2), done.stderr
    assert f"{short}: 1 of 3 frames left out: {depth.name} holds 2 and 3072 bytes of 4608, a frame" in done.stderr


def test_a_sequence_without_a_whole_frame_is_refused(room, tmp_path):
    short = tmp_path / "Room"
    shutil.copytree(room, short)
    (short / f"v1_depth_{W}x{H}_yuv420p16le.yuv").write_bytes(b"")
    done = CliRunner().invoke(app, ["render", str(short), "--out", str(tmp_path / "out"), "--camera", "t0"])
    assert re.match(r"v1_depth_\S+: 0 bytes: expected at least 4608, a frame of 48x32", str(done.exception))


TABLE = """# Rooms

| sequence | target | nearest views given | frame | Other | Third 1.0 |
|---|---|---|---|---|---|
| Room | v1 | 3 | 0 | 33.60 / 38.89 | - |
| Room | v1 | 2 | 2 | 31.00 / 35.50 | 30.25 / 33.00 |
"""


def test_bench_with_peers_prints_their_figures_and_ours(room, monkeypatch):
    (room.parent / "README.md").write_text(TABLE, "utf-8")
    monkeypatch.setenv("COLUMNS", "150")
    done = CliRunner().invoke(app, ["bench", "--peers", str(room.parent), "--no-background"])
    assert done.exit_code == 0, done.exception
    rows = [line for line in done.output.splitlines() if "Room" in line]
    assert len(rows) == 2
    assert "33.60 / 38.89" in rows[0]
    assert "30.25 / 33.00" in rows[1]
    ours = [float(row.split("│")[7].split("/")[0]) for row in rows]
    assert min(ours) > 30  # the target is one of the views


def test_bench_without_a_table_says_so(tmp_path):
    (tmp_path / "README.md").write_text("nothing here\n", "utf-8")
    done = CliRunner().invoke(app, ["bench", "--peers", str(tmp_path)])
    assert isinstance(done.exception, ValueError)
    assert "no table" in str(done.exception)


def test_effects_of_a_file_are_rendered_and_the_report_has_the_same_keys(room, tmp_path, effects):
    reports = {}
    for name, options in (("bare", ()), ("with", ("--effects", effects))):
        report = tmp_path / f"{name}.json"
        render(room, tmp_path / name, "--camera", "viewport", "--frames", "1:2", "--report", report, *options)
        reports[name] = json.loads(report.read_text())["frames"][0]
    assert {key: set(reports["with"][key]) for key in ("stages", "hole_fraction", "triangles")} == {
        key: set(reports["bare"][key]) for key in ("stages", "hole_fraction", "triangles")
    }
    lumas = [np.fromfile(next((tmp_path / name).glob("*_texture_*")), np.uint16, W * H) for name in ("bare", "with")]
    bare, shown = (luma.reshape(H, W).astype(int) for luma in lumas)
    change = shown - bare
    assert (shown[14:18, 18] > 900).all()  # beside the box
    assert np.abs(change[:, :4]).max() == 0  # neither is there
    assert 0.05 < (change != 0).mean() < 0.5


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "effects.json: .*: expected JSON"),
        ("[]", "effects.json: list: expected an object"),
        ('{"a": 1}', "effects.json: a: message: int: expected a map"),
        ('{"a": {"kind": "mesh", "position": [0, 0, 0], "orientation": [1, 0, 0, 0]}}', "a: mesh: missing: expected"),
    ],
)
def test_a_file_of_no_effects_is_refused(room, tmp_path, text, said):
    path = tmp_path / "effects.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        render(room, tmp_path / "out", "--camera", "t0", "--effects", path)


def test_a_content_that_is_none_is_refused_with_its_file(room, tmp_path, effects):
    (tmp_path / "cube.glb").write_bytes(b"no")
    with pytest.raises(ValueError, match=r"cube\.glb: mesh: first bytes: b'no'"):
        render(room, tmp_path / "out", "--camera", "t0", "--effects", effects)
