"""Names that other systems write differently, and files that only accompany others."""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from farside.engine.evaluation.twin_recording import find_recordings
from farside.engine.io.file_names import find_path, is_companion
from farside.engine.io.tmiv import TmivError, open_sequence
from farside.engine.io.tmiv_check import check_sequence
from support.sequences import edit, write

APPLE_DOUBLE = b"\0\x05\x16\x07\0\2\0\0Mac OS X        \0\2\0\0\0\x09"
TEXTURE = "v0_texture_10x6_yuv420p10le.yuv"


def litter(folder: Path) -> None:
    """What macOS and Windows leave beside the files of a folder, and what unpacking an archive of macOS leaves."""
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        (path.parent / f"._{path.name}").write_bytes(APPLE_DOUBLE)
    for name in (".DS_Store", "Thumbs.db", "desktop.ini", "._.DS_Store"):
        (folder / name).write_bytes(APPLE_DOUBLE)
    (folder / "__MACOSX").mkdir()
    (folder / "__MACOSX" / "._S.json").write_bytes(APPLE_DOUBLE)


def test_companions_are_never_taken_for_sequences_or_pictures(tmp_path: Path) -> None:
    root = tmp_path / "sequences"
    folder = write(root / "S")
    expected = open_sequence(folder).view("v1", 1)
    litter(folder)
    litter(root)
    (folder / "S.json").rename(folder / "another name.json")
    for sequence in (open_sequence(folder), *find_recordings([root])):
        np.testing.assert_array_equal(sequence.frame(1, ("v1",)).views[0].codes, expected.codes)
        assert sequence.truth_names == ("t0",)
    assert len(find_recordings([root])) == 1
    assert check_sequence(folder) == []
    with pytest.raises(TmivError, match=r"\._S\.json': a companion of macOS: expected a folder or its JSON"):
        open_sequence(folder / "._S.json")


def test_what_is_no_companion() -> None:
    assert not any(map(is_companion, ("v0.yuv", "_v0.yuv", "S.json", "MACOSX", "thumbs", "truth")))


@pytest.mark.parametrize("change", [str.upper, str.swapcase, str.title, str.lower])
def test_letter_case_of_file_names_may_differ(tmp_path: Path, change) -> None:
    folder = write(tmp_path / "S")
    edit(folder, v1__Poses="V1_Poses.CSV")
    expected = [open_sequence(folder).view(name, 2) for name in ("v0", "v1", "t0")]
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        path.rename(path.with_name(change(path.name)))
    (folder / "truth").rename(folder / change("truth"))
    assert check_sequence(folder) == []
    sequence = open_sequence(folder)
    for view in expected:
        read = sequence.view(view.camera.name, 2)
        np.testing.assert_array_equal(read.codes, view.codes)
        assert read.camera == view.camera


def test_the_exact_name_comes_first_and_two_others_are_named(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    path, other, third = folder / TEXTURE, folder / TEXTURE.upper(), folder / TEXTURE.title()
    other.write_bytes(bytes(path.stat().st_size))
    assert open_sequence(folder).texture("v0", 0).y.any()
    path.rename(third)
    message = rf"camera v0: texture: .*'{TEXTURE}': found '{other.name}' and '{third.name}': expected one"
    with pytest.raises(TmivError, match=message):
        open_sequence(folder).frame(0)
    assert any("found" in problem and third.name in problem for problem in check_sequence(folder))
    (folder / "v1_poses.csv").rename(folder / "V1_poses.csv")
    (folder / "v1_POSES.csv").write_bytes((folder / "V1_poses.csv").read_bytes())
    with pytest.raises(TmivError, match=r"Poses: .*'v1_poses.csv': found 'V1_poses.csv' and 'v1_POSES.csv'"):
        open_sequence(folder)


def test_a_camera_takes_no_file_of_another_whose_name_differs_in_case(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    document = json.loads((folder / "S.json").read_text("utf-8"))
    document["cameras"].append(document["cameras"][1] | {"Name": "V0"})
    document["sourceCameraNames"] = ["v0", "V0"]
    (folder / "S.json").write_text(json.dumps(document))
    with pytest.raises(TmivError, match="camera V0: texture: missing"):
        open_sequence(folder).frame(0)
    assert any("camera V0: texture: missing" in problem for problem in check_sequence(folder))


@pytest.mark.parametrize("on_disk", ["NFC", "NFD"])
@pytest.mark.parametrize("in_json", ["NFC", "NFD"])
def test_composed_and_decomposed_names_are_the_same(tmp_path: Path, on_disk, in_json) -> None:
    name = "Kamera é ü 1"
    folder = write(tmp_path / unicodedata.normalize(on_disk, "Müseum 2"))
    edit(folder, sourceCameraNames=[name], v0__Name=unicodedata.normalize(in_json, name))
    for path in folder.glob("v0_*"):
        path.rename(path.with_name(unicodedata.normalize(on_disk, path.name.replace("v0", name))))
    typed = tmp_path / unicodedata.normalize("NFD" if on_disk == "NFC" else "NFC", "Müseum 2")
    (folder / "other.json").write_text("{}")
    assert not typed.exists()
    for path in (folder, typed, folder / f"{typed.name}.json"):
        assert open_sequence(path).frame(0).views[0].camera.name == name
    assert check_sequence(folder) == []


def test_paths_in_the_json_may_be_those_of_windows(tmp_path: Path) -> None:
    folder = write(tmp_path / "S")
    poses = open_sequence(folder).poses("v1")
    (folder / "Poses 1").mkdir()
    (folder / "v1_poses.csv").rename(folder / "Poses 1" / "v1.csv")
    for path in (r"Poses 1\v1.csv", "Poses 1/v1.csv", r".\poses 1\V1.csv"):
        edit(folder, v1__Poses=path)
        assert open_sequence(folder).poses("v1") == poses
    for path in (r"C:\S\v1.csv", "/S/v1.csv", "../S/v1.csv", r"\\server\S\v1.csv", "", "a//b", 7):
        edit(folder, v1__Poses=path)
        with pytest.raises(TmivError, match=r"S\.json: camera v1: Poses: .*: expected a path to a file below"):
            open_sequence(folder)
    edit(folder, v1__Poses=r"Poses 2\v1.csv")
    with pytest.raises(TmivError, match=r"camera v1: Poses: Poses 2/v1.csv: missing: expected .*Poses 2"):
        open_sequence(folder)


def test_a_path_through_a_file_is_missing(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    with pytest.raises(FileNotFoundError, match="a/b: missing"):
        find_path(tmp_path, "a/b")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("v0_texture_10x6_yuv444p10le.yuv", "yuv444p10le: expected yuv420p, yuv400p or gray"),
        ("v0_texture_12x6_yuv420p10le.yuv", "12x6: expected 10x6, the JSON's Resolution"),
        ("V0_texture_10x6_nv12.YUV", "nv12: expected yuv420p, yuv400p or gray"),
        ("v0_10_6_420_yuv420p10le.yuv", "expected a name like v0_texture_10x6_FORMAT.yuv"),
        ("v0_texture.yuv", "expected a name like v0_texture_10x6_FORMAT.yuv"),
    ],
)
def test_a_file_that_cannot_be_read_is_named_where_it_is_missed(tmp_path: Path, name: str, said: str) -> None:
    folder = write(tmp_path / "S")
    (folder / TEXTURE).rename(folder / name)
    missing = rf"v0: texture: missing: expected a file like .*{TEXTURE} \(found {name}: {said}"
    with pytest.raises(TmivError, match=missing):
        open_sequence(folder).frame(0)
    assert any(f"{name}: {said}" in problem for problem in check_sequence(folder))
