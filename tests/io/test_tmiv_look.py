"""The look at a first frame: what each contradiction is called, and that sound sequences cause no warning."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from farside.clients.cli import app
from farside.engine.io.tmiv import SequenceWriter
from farside.engine.io.tmiv_check import check_sequence
from farside.engine.io.tmiv_json import read_json, to_json
from farside.engine.io.tmiv_look import look_at_first_frame
from farside.engine.io.video_files import depth_path
from farside.engine.rig.depth import DepthCoding
from farside.engine.synth import TWINS, write_twin
from support.rooms import camera_row, frame
from support.sequences import edit
from support.shared import SHARED, needs_shared
from typer.testing import CliRunner

W, H = 96, 64
TEXTURE, DEPTH = f"v1_texture_{W}x{H}_yuv420p10le.yuv", f"v1_depth_{W}x{H}_yuv420p16le.yuv"
Samples = npt.NDArray[np.uint16]


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A frame of three cameras in front of a box."""
    folder, cameras = tmp_path / "Room", camera_row(3, (W, H))
    with SequenceWriter(folder, "Room", 30.0, cameras, ("v0", "v1", "v2")) as writer:
        for view in frame(0, cameras, 0.0).views:
            y = np.clip(view.texture.y, 64, 940)
            writer.write(view.camera.name, type(view.texture)(y, view.texture.cb, view.texture.cr), view.codes)
    return folder


def look(folder: Path) -> list[str]:
    assert check_sequence(folder) == []
    file = folder / f"{folder.name}.json"
    return look_at_first_frame(folder, read_json(file)[0])


def holes(samples: Samples, code: int) -> Samples:
    """Luma with holes of a few pixels, as sensors leave them."""
    luma = samples[: W * H].reshape(H, W)
    luma[np.random.default_rng(3).random((H, W)) < 0.1] = code
    return samples


def full_range(samples: Samples) -> Samples:
    samples[: W * H] = (samples[: W * H].astype(float) - 64) * 1023 / 876
    samples[:100] = 1
    return samples


CASES: list[tuple[str, Callable[[Samples], Samples], str]] = [
    (TEXTURE, lambda s: s * 4, r"samples up to \d{4}: expected at most 1023, as yuv420p10le has 10 bits$"),
    (TEXTURE, lambda s: s * 64, r"samples up to \d+: .*; they seem to be in the upper bits \(all are multiples of"),
    (TEXTURE, lambda s: s.byteswap(), r"samples up to \d+: .*; their bytes seem to be swapped"),
    (TEXTURE, lambda s: s // 4, r"no sample above \d+: expected more of yuv420p10le; they seem to have 8 bits"),
    (DEPTH, lambda s: s // 64, r"no sample above \d+: expected more of yuv420p16le; they seem to have (8|10) bits"),
    (TEXTURE, lambda s: s * 0 + 64, r"every sample of the first picture is 64$"),
    (DEPTH, lambda s: s * 0, r"every sample of the first picture is 0$"),
    (TEXTURE, full_range, r"\d+\.\d% of luma is far beyond 64 to 940: expected the limited range"),
    (DEPTH, lambda s: holes(s, 65535), r"1\d\.\d% of codes are 65535, the nearest depth, .*expected 0, with HasInv"),
    (DEPTH, lambda s: holes(s, 0), r"1\d\.\d% of codes are 0, the farthest depth, .*expected HasInvalidDepth true"),
]


@pytest.mark.parametrize(("name", "change", "said"), CASES)
def test_samples_that_contradict_the_description_are_told(
    room: Path, name: str, change: Callable[[Samples], Samples], said: str
) -> None:
    edit(room, v0__HasInvalidDepth=False, v1__HasInvalidDepth=False)
    assert look(room) == []
    change(np.fromfile(room / name, "<u2")).astype("<u2").tofile(room / name)
    (warning,) = look(room)
    assert re.match(rf"{name}: {said}", warning), warning


def test_holes_that_the_description_allows_are_none(room: Path) -> None:
    holes(np.fromfile(room / DEPTH, "<u2"), 0).tofile(room / DEPTH)
    assert look(room) == []


def test_a_wide_sky_is_no_hole(room: Path) -> None:
    codes = np.fromfile(room / DEPTH, "<u2")
    codes[: W * H // 4] = 0
    codes.tofile(room / DEPTH)
    edit(room, v1__HasInvalidDepth=False, v1__Depth_range=[0.5, "inf"])
    assert look(room) == []
    holes(codes, 0).tofile(room / DEPTH)
    (warning,) = look(room)
    assert "of codes are 0" in warning


def test_only_the_first_frame_is_looked_at(room: Path) -> None:
    for path in room.glob("*.yuv"):
        path.write_bytes(path.read_bytes() + bytes(path.stat().st_size))
    edit(room, Frames_number=2)
    assert look(room) == []


def test_files_in_each_others_place_and_copies_are_told(room: Path) -> None:
    texture, depth = (np.fromfile(room / name, "<u2") for name in (TEXTURE, DEPTH))
    depth.tofile(room / TEXTURE)
    assert any(f"{TEXTURE}, {DEPTH}: the same samples" in line for line in look(room))
    texture.tofile(room / DEPTH)
    assert f"{TEXTURE}, {DEPTH}: only the depth has colours: they seem to be swapped" in look(room)
    depth.tofile(room / DEPTH)
    np.fromfile(room / TEXTURE.replace("v1", "v0"), "<u2").tofile(room / TEXTURE)
    copy = f"{TEXTURE.replace('v1', 'v0')}, {TEXTURE}: the same first picture: expected one of each camera"
    assert look(room) == [copy]


def test_lengths_that_are_no_metres_are_told(room: Path) -> None:
    edit(room, lengthsInMeters=False)
    assert look(room) == ["lengthsInMeters: false: expected true: positions and depths are read as metres"]
    description, problems = read_json(room / "Room.json")
    assert problems == []
    assert json.loads(to_json(description))["lengthsInMeters"] is False
    edit(room, lengthsInMeters="yes")
    assert check_sequence(room) == ['Room.json: lengthsInMeters: "yes": expected true or false']


def test_info_prints_warnings_and_ends_well(room: Path) -> None:
    edit(room, lengthsInMeters=False)
    done = CliRunner().invoke(app, ["info", str(room)])
    assert done.exit_code == 0
    lines = done.output.splitlines()
    assert "warning lengthsInMeters: false: expected true: positions and depths are read as metres" in lines
    assert lines[-1] == "no problems found"
    (room / TEXTURE).unlink()
    done = CliRunner().invoke(app, ["info", str(room)])
    assert done.exit_code == 2
    assert "warning lengthsInMeters" in done.output
    assert "problem camera v1: texture: missing" in done.output


@pytest.mark.parametrize("name", TWINS)
def test_twins_are_sound(tmp_path: Path, name: str) -> None:
    write_twin(name, tmp_path / "T", 0.05, 1)
    assert look(tmp_path / "T") == []


READINGS: dict[str, Callable[[npt.NDArray[np.float64], DepthCoding], npt.NDArray[np.float64]]] = {
    "millimetres": lambda depth, coding: 1000 * depth,
    "linear in depth, the largest the farthest": lambda depth, c: c.max_code * (depth - c.near) / (c.far - c.near),
    "linear in depth, the largest the nearest": lambda depth, c: c.max_code * (c.far - depth) / (c.far - c.near),
    "linear in disparity, the largest the farthest": lambda depth, coding: coding.max_code - coding.codes(depth),
}


@pytest.mark.parametrize("name", ["museum", "painter"])
@pytest.mark.parametrize("reading", READINGS)
def test_codes_that_other_programs_mean_otherwise_are_told(tmp_path: Path, name: str, reading: str) -> None:
    folder = tmp_path / "T"
    write_twin(name, folder, 0.1, 1, depth_noise=0.0)
    description, _ = read_json(folder / "T.json")
    for source in description.source_names:
        camera = description.cameras[source]
        path = depth_path(folder, camera)
        codes = np.fromfile(path, "<u2")
        luma = codes[: camera.width * camera.height]
        luma[:] = np.rint(np.clip(READINGS[reading](camera.depth.depth(luma), camera.depth), 0, 65535))
        codes.tofile(path)
    (warning,) = look(folder)
    assert re.match(rf"depth: views differ by \d+ codes of luma, but by \d+ if depth codes are {reading}: ", warning)


@needs_shared
@pytest.mark.parametrize("name", ["Atrium", "Table"])
def test_small_sequences_are_sound(name: str) -> None:
    assert look(SHARED / "sequences" / name) == []
