"""Sequences: reading real rigs, round trips through the writer, and errors for bad input."""

from __future__ import annotations

import itertools
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from farside.engine.io.pose_trace import read_camera_poses, read_pose_trace, read_poses, write_poses
from farside.engine.io.recording import ToAndFro, playback_index
from farside.engine.io.tmiv import SequenceWriter, TmivError, open_sequence
from farside.engine.io.tmiv_check import check_sequence
from farside.engine.io.tmiv_json import parse_json
from farside.engine.io.yuv import PixelFormat, RawVideo
from farside.engine.rig.camera import Equirectangular, Perspective, Pose
from support.sequences import FRAMES, cameras, edit, pictures, write
from support.shared import SHARED, needs_shared

RIGS = {"A": (15, "ClassroomVideo"), "B": (24, "Museum"), "C": (10, "Hijack"), "D": (16, "Painter")}
RIGS |= {"E": (13, "Frog"), "L": (10, "Fencing")}


@needs_shared
@pytest.mark.parametrize("rig", RIGS)
def test_real_rigs_and_pose_traces_load(rig: str) -> None:
    sequence = open_sequence(SHARED / "tmiv" / "sequences" / f"{rig}.json")
    count, name = RIGS[rig]
    assert (len(sequence.source_names), sequence.name) == (count, name)
    assert set(sequence.source_names) < set(sequence.cameras)
    viewport = sequence.cameras["viewport"]
    for path in sorted((SHARED / "tmiv" / "pose_traces").glob(f"{rig}p*.csv")):
        poses = read_pose_trace(path, viewport)
        assert len(poses) == len(path.read_text().split()) - 1
        offsets = np.array([pose.position for pose in poses]) - viewport.pose.position
        assert np.abs(offsets).max() < 6


@needs_shared
def test_real_rig_details() -> None:
    folder = SHARED / "tmiv" / "sequences"
    classroom = open_sequence(folder / "A.json")
    description, _ = parse_json((folder / "A.json").read_text(), "A")
    assert description.frame_ranges == ((97, 23),)
    assert math.isinf(classroom.cameras["v0"].depth.far)
    assert classroom.cameras["v0"].projection == Equirectangular(
        4096, 2048, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2)
    )
    frog = open_sequence(folder / "E.json").cameras["v13"]
    assert frog.projection == Perspective(1920, 1080, 1546.74, 1547.76, 980.168, 534.722)
    assert not frog.depth.has_invalid


@needs_shared
@pytest.mark.parametrize("name", ["Atrium", "Table"])
def test_small_sequences_open_and_are_clean(name: str) -> None:
    sequence = open_sequence(SHARED / "sequences" / name)
    assert check_sequence(SHARED / "sequences" / name) == []
    frame = sequence.frame(sequence.frame_count - 1)
    assert [view.camera.name for view in frame.views] == list(sequence.source_names)
    view = frame.views[0]
    assert not view.texture.y.flags.owndata  # mapped, not copied
    assert view.texture.y.max() < 1024
    path = sequence.video("v0", "texture").path
    assert path.name == f"{view.camera.name}_texture_{view.camera.width}x{view.camera.height}_yuv420p10le.yuv"
    luma = np.fromfile(path, "<u2")[-3 * view.texture.y.size // 2 :][: view.texture.y.size]
    np.testing.assert_array_equal(view.texture.y.ravel(), luma)
    assert sequence.texture("t0", 0).y.shape == view.texture.y.shape


@pytest.mark.parametrize(
    ("depth", "texture"),
    [
        ("yuv420p16le", "yuv420p10le"),
        ("yuv400p16le", "yuv420p"),
        ("gray16le", "yuv420p12le"),
        ("yuv420p10le", "yuv420p9le"),
        ("yuv420p", "yuv420p16le"),
        ("yuv400p", "yuv420p10le"),
    ],
)
def test_round_trip(tmp_path: Path, depth: str, texture: str) -> None:
    sequence = open_sequence(write(tmp_path / "S", depth=depth, texture=texture))
    bits = PixelFormat(depth).bits
    step = 1 << max(0, 10 - PixelFormat(texture).bits)
    assert (sequence.name, sequence.fps, sequence.frame_count) == ("Made", 25.0, FRAMES)
    assert sequence.source_names == ("v0", "v1")
    for camera in cameras(bits):
        read = sequence.cameras[camera.name]
        assert (read.projection, read.depth) == (camera.projection, camera.depth)
        np.testing.assert_allclose(read.pose.rotation(), camera.pose.rotation(), atol=1e-12)
        assert read.pose.position == camera.pose.position
    for frame in range(FRAMES):
        for index, name in enumerate(("v0", "v1", "t0")):
            expected, codes = pictures(sequence.cameras[name], 10 * frame + index, bits, step)
            view = sequence.view(name, frame)
            for plane in ("y", "cb", "cr"):
                np.testing.assert_array_equal(getattr(view.texture, plane), getattr(expected, plane))
            np.testing.assert_array_equal(view.codes, codes)
            assert view.codes.dtype == view.texture.cb.dtype == np.uint16
    assert check_sequence(tmp_path / "S") == []
    assert (tmp_path / "S" / "truth" / f"t0_texture_10x6_{texture}.yuv").is_file()


def test_moving_camera_has_a_pose_a_frame(tmp_path: Path) -> None:
    sequence = open_sequence(write(tmp_path / "S"))
    assert [sequence.view("v1", frame).camera.pose.position[0] for frame in range(3)] == [0.0, 1.0, 2.0]
    assert sequence.poses("v0") is None
    (tmp_path / "S" / "v1_poses.csv").write_text("X,Y,Z,Yaw,Pitch,Roll\n0,0,0,0,0,0\n")
    with pytest.raises(TmivError, match=r"v1: Poses: no row for frame 1: the file has 1"):
        open_sequence(tmp_path / "S").view("v1", 1)
    assert any("v1: Poses" in line for line in check_sequence(tmp_path / "S"))


def test_pose_file_round_trip_and_wrapped_yaw(tmp_path: Path) -> None:
    poses = [Pose.from_euler((1, 2, 3), 4.0, p, 1.0) for p in (0.5, math.pi / 2, -math.pi / 2, -1.0)]
    write_poses(tmp_path / "p.csv", poses)
    for read, pose in zip(read_poses(tmp_path / "p.csv"), poses, strict=True):
        np.testing.assert_allclose(read.rotation(), pose.rotation(), atol=1e-7)
    (tmp_path / "q.csv").write_text("X,Y,Z,Yaw,Pitch,Roll\n1,2,3,190,0,0\n\n0,0,0,-170,0,0\n")
    first, second = read_pose_trace(tmp_path / "q.csv", cameras()[1])
    np.testing.assert_allclose(first.rotation(), second.rotation(), atol=1e-12)
    np.testing.assert_allclose(first.position, (1.1, 0.0, 3e5 + 3))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "header"),
        ("X,Y,Z,Yaw,Pitch\n", "header"),
        ("X,Y,Z,Yaw,Pitch,Roll\n", "0 rows"),
        ("X,Y,Z,Yaw,Pitch,Roll\n1,2,3,4,5\n", "line 2: Roll: ''"),
        ("X,Y,Z,Yaw,Pitch,Roll\n1,2,3,4,5,6\n1,nan,3,4,5,6\n", "line 3: Y: 'nan'"),
    ],
)
def test_bad_pose_file(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_poses(tmp_path / "p.csv")


def test_json_is_found(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    (folder / "S.json").rename(folder / "x.json")
    assert open_sequence(folder).name == "Made"  # the only one
    (folder / "other.json").write_text("{}")
    with pytest.raises(TmivError, match="2 JSON files"):
        open_sequence(folder)
    (folder / "x.json").rename(folder / "Made.json")
    assert open_sequence(folder).name == "Made"
    with pytest.raises(TmivError, match="nowhere"):
        open_sequence(tmp_path / "nowhere")


def test_playback_goes_to_and_fro() -> None:
    assert [playback_index(i, 2) for i in range(7)] == [0, 1, 1, 0, 0, 1, 1]
    assert [playback_index(i, 3) for i in range(8)] == [0, 1, 2, 2, 1, 0, 0, 1]
    assert playback_index(5, 1) == 0
    with pytest.raises(ValueError, match="frame"):
        playback_index(0, 0)


def test_playing_to_and_fro_goes_on_where_it_is_while_the_recording_grows() -> None:
    for count in (1, 2, 3, 7):
        order = ToAndFro()
        assert [order.index(i, count) for i in range(40)] == [playback_index(i, count) for i in range(40)]
        skipping = ToAndFro()
        some = range(0, 100, 7)
        assert [skipping.index(i, count) for i in some] == [playback_index(i, count) for i in some]
    order, counts = ToAndFro(), [1, 1, 2, 3, 3, 3, 4, 9, 9, 9, 9, 9, 9, 9]
    indices = [order.index(i, count) for i, count in enumerate(counts)]
    assert all(abs(b - a) <= 1 for a, b in itertools.pairwise(indices))
    assert max(indices) > 3


def test_default_sources_are_the_numbered_cameras(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    edit(folder, sourceCameraNames=None, v1__HasInvalidDepth=None, v1__BitDepthDepth=None)
    sequence = open_sequence(folder)
    assert sequence.source_names == ("v0", "v1")
    assert not sequence.cameras["v1"].depth.has_invalid


def test_codes_above_the_range_do_no_harm(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    path = folder / "v0_texture_10x6_yuv420p10le.yuv"
    np.full(3 * 90, 65535, "<u2").tofile(path)
    assert open_sequence(folder).view("v0", 2).texture.y.max() == 65535


BAD_JSON = [
    ({"v0__Focal": "8"}, r'camera v0: Focal: "8": expected two numbers'),
    ({"v0__Focal": [0, 1]}, r"camera v0: fx: 0.0: expected a finite number of at least"),
    ({"v0__Focal": None}, r"camera v0: Focal: missing: expected two numbers"),
    ({"v0__Resolution": [10, -6]}, r"camera v0: Resolution: \[10, -6\]: expected two positive"),
    ({"v0__Depth_range": [5, 5]}, r"camera v0: Depth_range: .*expected 0 < near < far"),
    ({"v0__Depth_range": [5, "infinite"]}, r"camera v0: Depth_range: .*expected two numbers"),
    ({"v0__Projection": "Fisheye"}, r'camera v0: Projection: "Fisheye": expected Perspective or Equi'),
    ({"v0__HasInvalidDepth": "no"}, r'camera v0: HasInvalidDepth: "no": expected true or false'),
    ({"v0__BitDepthDepth": 17}, r"camera v0: BitDepthDepth: 17: expected a whole number from 8 to 16"),
    ({"v0__Position": [0, 0, math.nan]}, r"camera v0: Position: .*expected three numbers"),
    ({"v1__Ver_range": [90, -90]}, r"camera v1: ver_range: .*expected min < max"),
    ({"v0__Name": 7}, r"cameras\[1\]: Name: 7: expected a name"),
    ({"v0__Name": "../v0"}, r"cameras\[1\]: Name: .*expected a name"),
    ({"v1__Name": "v0"}, r"camera v0: Name: .*twice"),
    ({"sourceCameraNames": ["v0", "v7"]}, r"sourceCameraNames: 'v7': no camera has this name"),
    ({"sourceCameraNames": ["v0", "v0"]}, r"sourceCameraNames: 'v0': named 2 times"),
    ({"sourceCameraNames": []}, r"sourceCameraNames: no source view"),
    ({"Fps": 0}, r"Fps: 0: expected a positive number"),
    ({"frameRanges": [{"startFrame": 3}]}, r"frameRanges: .*expected a list of"),
    ({"frameRanges": 7}, r"frameRanges: 7: expected a list of"),
    ({"cameras": {}}, r"cameras: {}: expected a list of at least one camera"),
]


@pytest.mark.parametrize(("changes", "message"), BAD_JSON)
def test_bad_json(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    folder = write(tmp_path / "S")
    edit(folder, **changes)
    with pytest.raises(TmivError, match=message):
        open_sequence(folder)
    assert check_sequence(folder)


def test_no_value_of_any_field_is_more_than_a_problem(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    file = folder / "S.json"
    whole = json.loads(file.read_text())
    whole["frameRanges"] = [{"maxNumberOfFrames": 3, "startFrame": 1}]
    whole["cameras"][1]["Poses"] = "v1_poses.csv"
    refused = 0
    for number in (None, 1, 2):  # the top level, a perspective and an equirectangular camera
        for key in whole if number is None else whole["cameras"][number]:
            for value in (None, True, 7, -1, "x", "", [], {}, [None], [[1]], {"a": []}, [1, "inf"], 10**400):
                document = json.loads(json.dumps(whole))
                (document if number is None else document["cameras"][number])[key] = value
                file.write_text(json.dumps(document))
                check_sequence(folder)
                try:
                    open_sequence(folder)
                except TmivError:
                    refused += 1
    assert refused > 200


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"JSON: line 1, column 2: the end of the file: expected property name"),
        ('{\n "Fps": 30\n "cameras": []}', r"""JSON: line 3, column 2: '"cameras": \[\]}': expected ',' delimiter"""),
        ('{"Fps": ,}', r"JSON: line 1, column 9: ',}': expected value"),
        ("{} x", r"JSON: line 1, column 4: 'x': extra data"),
        ("[]", r"JSON: list: expected an object"),
        ("[" * 100000, r"JSON: "),
        ("\x00", r"line 1, byte 0: 0x00: expected UTF-8 or"),
        ("", r"JSON: line 1, column 1: the end of the file: expected value"),
    ],
)
def test_json_that_is_none(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(TmivError, match=rf"^a\.json: {message}"):
        open_sequence(tmp_path)
    (problem, *_) = check_sequence(tmp_path)
    assert re.match(rf"a\.json: {message}", problem)


def test_missing_and_short_files(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    depth = folder / "v0_depth_10x6_yuv420p16le.yuv"
    depth.write_bytes(depth.read_bytes()[:-1])
    sequence = open_sequence(folder)
    assert sequence.frame_count == 2
    sequence.view("v0", 1)
    with pytest.raises(ValueError, match="holds 2 whole frames of 10x6 yuv420p16le and 179"):
        sequence.view("v0", 2)
    with pytest.raises(ValueError, match="frame: -1"):
        sequence.view("v0", -1)
    depth.unlink()
    with pytest.raises(TmivError, match=r"camera v0: depth: missing: expected a file like .*v0_depth_10x6"):
        open_sequence(folder).frame(0)
    with pytest.raises(TmivError, match=r"camera: 'v9': expected one of viewport, v0"):
        sequence.view("v9", 0)


def test_frames_that_are_left_out_are_told_with_the_short_files(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write(tmp_path / "S")
    assert (open_sequence(folder).frame_count, caplog.messages) == (3, [])
    texture, depth = folder / "v0_texture_10x6_yuv420p10le.yuv", folder / "v1_depth_12x8_yuv420p16le.yuv"
    texture.write_bytes(texture.read_bytes()[:-100])
    assert open_sequence(folder).frame_count == 2
    cut = "1 of 3 frames left out: v0_texture_10x6_yuv420p10le.yuv holds 2 and 80 bytes of 180, a frame of 10x6 yuv4"
    assert caplog.messages[-1].startswith(f"{folder}: {cut}")
    depth.write_bytes(depth.read_bytes()[: 2 * 12 * 8 * 3 // 2])
    assert open_sequence(folder).frame_count == 1
    assert "2 of 3 frames left out: v0_texture" in caplog.messages[-1]
    assert caplog.messages[-1].endswith("; v1_depth_12x8_yuv420p16le.yuv holds 1")
    depth.write_bytes(b"12")
    with pytest.raises(TmivError, match=r"^v1_depth_.*yuv: 2 bytes: expected at least 288, a frame of 12x8"):
        _ = open_sequence(folder).frame_count


def test_frames_without_a_pose_are_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write(tmp_path / "S")
    poses = folder / "v1_poses.csv"
    poses.write_text("".join(poses.read_text().splitlines(keepends=True)[:2]))
    assert open_sequence(folder).frame_count == 1
    assert caplog.messages == [f"{folder}: 2 of 3 frames left out: v1_poses.csv has 1 rows"]


def test_files_that_are_all_cut_in_their_last_frame(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write(tmp_path / "S")
    for path in folder.glob("v*_*.yuv"):
        path.write_bytes(path.read_bytes()[:-2])
    assert open_sequence(folder).frame_count == 2
    assert caplog.messages[0].count("holds 2 and") == 4


def test_check_lists_everything_at_once(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    edit(folder, Frames_number=7, v1__Rotation="none", v1__Depth_range=[3, 2], t0__Projection="Fisheye")
    texture = folder / "v0_texture_10x6_yuv420p10le.yuv"
    texture.write_bytes(texture.read_bytes()[:-100])
    (folder / "v0_depth_10x6_yuv420p16le.yuv").unlink()
    problems = check_sequence(folder)
    for expected in (
        "v1: Rotation", "v1: Depth_range", "t0: Projection", "v0_texture_10x6_yuv420p10le.yuv: 440 bytes",
        "v0: depth: missing", "Frames_number: 7",
    ):  # fmt: skip
        assert any(expected in line for line in problems), (expected, problems)
    assert not any("\n" in line for line in problems)


def test_check_names_wrong_resolution_and_counts(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    depth = folder / "v0_depth_10x6_yuv420p16le.yuv"
    depth.rename(folder / "v0_depth_12x6_yuv420p16le.yuv")
    texture = folder / "v1_texture_12x8_yuv420p10le.yuv"
    texture.write_bytes(texture.read_bytes()[: 2 * 12 * 8 * 3])
    problems = check_sequence(folder)
    assert any("v0_depth_12x6_yuv420p16le.yuv: 12x6: expected 10x6" in line for line in problems), problems
    assert any("v1" in line and "2 frames" in line for line in problems), problems


def test_check_looks_at_the_files_of_a_camera_it_cannot_read(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    edit(folder, v0__Depth_range=[3, 3])
    texture = folder / "v0_texture_10x6_yuv420p10le.yuv"
    texture.write_bytes(texture.read_bytes()[:-1])
    (folder / "v0_depth_10x6_yuv420p16le.yuv").unlink()
    problems = check_sequence(folder)
    assert len(problems) == 4
    expected = ("expected 0 < near < far", "539 bytes", "v0: depth: missing", "2 frames")
    assert all(part in line for line, part in zip(problems, expected, strict=True)), problems


def test_writer_refuses(tmp_path: Path) -> None:
    rig = cameras()
    with pytest.raises(ValueError, match="source_names: 'v8'"):
        SequenceWriter(tmp_path, "x", 30, rig, ("v8",))
    with pytest.raises(ValueError, match="format: 'yuv444p'"):
        SequenceWriter(tmp_path, "x", 30, rig, ("v0",), texture_format="yuv444p")
    with pytest.raises(ValueError, match="v0: depth bits: 16: expected 10"):
        SequenceWriter(tmp_path, "x", 30, rig, ("v0",), depth_format="yuv420p10le").write(
            "v0", *pictures(rig[1], 0)
        )
    with pytest.raises(ValueError, match="frames written"), SequenceWriter(
        tmp_path, "x", 30, rig, ("v0", "v1")
    ) as writer:
        writer.write("v0", *pictures(rig[1], 0))


def test_raw_video_without_chroma_is_grey(tmp_path: Path) -> None:
    path = tmp_path / "a.yuv"
    np.arange(12, dtype=np.uint8).tofile(path)
    video = RawVideo(path, 4, 3, "gray")
    texture = video.texture(0)
    np.testing.assert_array_equal(texture.y.ravel(), np.arange(12) * 4)
    assert (texture.cb == 512).all()
    with pytest.raises(ValueError, match="plane: 1: gray has 1"):
        video.plane(0, 1)


HEADER = "X,Y,Z,Yaw,Pitch,Roll\n"
LOST = {
    "not a number": "nan,nan,nan,nan,nan,nan",
    "infinite": "-inf,-inf,-inf,nan,nan,nan",
    "one cell": "0,1,2,0,NaN,0",
    "no cell filled": ",,,,,",
    "one cell empty": "0,1,,0,0,0",
    "cut short": "0,1",
    "a jump": "0,1e6,2,0,0,0",
    "beyond what is finite": "0,Infinity,2,0,0,0",
}


@pytest.mark.parametrize("frame", range(3))
@pytest.mark.parametrize("row", LOST.values(), ids=LOST)
def test_a_row_that_is_no_pose_leaves_its_view_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, row: str, frame: int
) -> None:
    folder = write(tmp_path / "S")
    rows = [f"{x},1,2,0,0,0" for x in (0.0, 0.25, 0.5)]
    poses = folder / "v1_poses.csv"
    poses.write_text(HEADER + "\n".join([*rows[:frame], row, *rows[frame + 1 :]]) + "\n,,,,,\n")
    if row == LOST["no cell filled"] and frame == 2:  # as a spreadsheet ends a table
        assert open_sequence(folder).frame_count == 2
        return
    if row == LOST["a jump"] and frame == 0:
        frame = 1  # the second pose jumps; the third one confirms it
    sequence = open_sequence(folder)
    assert sequence.frame_count == 3
    assert len(caplog.messages) == 1
    assert re.search(rf"v1: Poses: v1_poses\.csv: 1 of 3 rows are no pose.*the first is of frame {frame}", caplog.text)
    assert len(sequence.poses("v1")) == 3
    for index, one in enumerate(sequence.frames()):
        assert [view.there for view in one.views] == [True, index != frame]
        assert one.faults.keys() == ({"v1"} if index == frame else set())
        assert np.isfinite(sequence.camera("v1", index).pose.position).all()
    (problem,) = check_sequence(folder)
    assert f"the first is of frame {frame}" in problem
    assert sequence.frame(frame, ["v0"]).there == [0]


def test_rows_that_are_no_pose_take_the_last_one_before(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text(HEADER + "nan,0,0,0,0,0\n1,0,0,0,0,0\n,,,,,\n2,0,0,0,0,0\n3,0,0,inf,0,0\n")
    read = read_camera_poses(path)
    assert [pose.position[0] for pose in read.poses] == [1.0, 1.0, 1.0, 2.0, 2.0]
    assert list(read.faults) == [0, 2, 4]
    assert all(fault.reason == "pose" for fault in read.faults.values())


@pytest.mark.parametrize(("text", "message"), [("nan,0,0,0,0,0\n", "1 rows, none with a pose"), ("", "0 rows")])
def test_a_camera_needs_one_pose(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "p.csv"
    path.write_text(HEADER + text)
    with pytest.raises(ValueError, match=rf"p\.csv: {message}"):
        read_camera_poses(path)


def test_a_cell_of_other_words_is_still_wrong(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    path.write_text(HEADER + "0,0,0,0,0,-\n")
    with pytest.raises(ValueError, match="line 2: Roll: '-': expected a finite number"):
        read_camera_poses(path)


def test_a_virtual_camera_may_jump(tmp_path: Path) -> None:
    """Films are cut."""
    folder = write(tmp_path / "S")
    edit(folder, t0__Poses="t0.csv")
    (folder / "t0.csv").write_text(HEADER + "0,0,0,0,0,0\n900,0,0,0,0,0\n0,0,0,0,0,0\n")
    assert [open_sequence(folder).camera("t0", frame).pose.position[0] for frame in range(3)] == [0.0, 900.0, 0.0]
    assert check_sequence(folder) == []
