"""Text files as other systems write them: encodings, ends of lines, and tables of numbers from spreadsheets."""

from __future__ import annotations

import codecs
import json
from pathlib import Path

import numpy as np
import pytest
from farside.engine.io.number_table import read_numbers
from farside.engine.io.pose_trace import read_poses
from farside.engine.io.text import read_text
from farside.engine.io.tmiv import open_sequence
from farside.engine.rig.camera import Pose
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.sequences import write

BOMS = {"utf-8": codecs.BOM_UTF8, "utf-16-le": codecs.BOM_UTF16_LE, "utf-16-be": codecs.BOM_UTF16_BE}
BOMS |= {"utf-32-le": codecs.BOM_UTF32_LE, "utf-32-be": codecs.BOM_UTF32_BE}
ENDS = {"LF": "\n", "CRLF": "\r\n", "CR": "\r"}
FORMS = [(encoding, marked, end) for encoding in BOMS for marked in (True, False) for end in ENDS]
HEADER = "X,Y,Z,Yaw,Pitch,Roll\n"


def stored(text: str, encoding: str, marked: bool, end: str) -> bytes:
    return (BOMS[encoding] if marked else b"") + text.replace("\n", ENDS[end]).encode(encoding)


@pytest.mark.parametrize(("encoding", "marked", "end"), FORMS)
def test_sequences_and_poses_are_read_in_every_encoding(
    tmp_path: Path, encoding: str, marked: bool, end: str
) -> None:
    folder = write(tmp_path / "S")
    before = open_sequence(folder)
    description = folder / "S.json"
    document = json.loads(description.read_text("utf-8")) | {"Content_name": "Мюзеум é 部屋"}
    text = json.dumps(document, indent=1, ensure_ascii=False) + "  \n\n"
    description.write_bytes(stored(text, encoding, marked, end))
    poses = folder / "v1_poses.csv"
    poses.write_bytes(stored(poses.read_text("utf-8") + " \n", encoding, marked, end))
    sequence = open_sequence(folder)
    assert sequence.name == "Мюзеум é 部屋"
    assert sequence.cameras == before.cameras
    assert sequence.poses("v1") == before.poses("v1")


# A text whose characters are mostly ASCII, as in every file that we read; it holds no zero and no byte order mark.
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0\r\ufeff"), max_size=30).map(
    lambda text: "{" + text + "x" * (len(text) + 1) + "\n"
)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=TEXTS, form=st.sampled_from(FORMS))
def test_what_was_written_is_read(tmp_path: Path, text: str, form: tuple[str, bool, str]) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(stored(text, *form))
    assert read_text(path) == text


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"a\r\nb: \xe9\n", "p.csv: line 2, byte 6: 0xe9: expected UTF-8 text"),
        (codecs.BOM_UTF16_LE + b"a\0\n\0b", "p.csv: line 2, byte 6: 0x62: expected UTF-16 LE text"),
        (codecs.BOM_UTF16_BE + b"\0a\0\0", "p.csv: line 1, byte 4: 0x00: expected UTF-16 BE text"),
        (b"ab\n\0\0\0\0", "p.csv: line 2, byte 3: 0x00: expected UTF-8 or UTF-16 LE or .* or UTF-32 BE text"),
        (b"\0\x05\x16\x07\0\2\0\0Mac OS X", "p.csv: line 1, byte 0: 0x00: expected UTF-8 or UTF-16 LE"),
    ],
)
def test_what_is_no_text_is_named_with_its_place(tmp_path: Path, data: bytes, message: str) -> None:
    path = tmp_path / "p.csv"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=f"^{message}"):
        read_poses(path)
    path.rename(tmp_path / "p.json")
    with pytest.raises(ValueError, match=message.replace("csv", "json")):
        open_sequence(tmp_path)


def test_a_video_given_by_mistake_is_not_read_into_memory(tmp_path: Path) -> None:
    path = tmp_path / "v0.yuv"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ValueError, match=r"v0\.yuv: 1099511627776 bytes: expected a text file of at most"):
        read_text(path)


@pytest.mark.parametrize(
    "text",
    [
        "X,Y,Z,Yaw,Pitch,Roll\n0.5,-1,2e1,90,0,0\n",
        "X;Y;Z;Yaw;Pitch;Roll\n0,5;-1;2e1;90;0;0\n",
        "X;Y;Z;Yaw;Pitch;Roll\n0.5;-1;20;90;0;0\n",
        "X\tY\tZ\tYaw\tPitch\tRoll\n0,5\t-1\t20\t90\t0\t0\n",
        "sep=;\nX;Y;Z;Yaw;Pitch;Roll\n0,5;-1,0;2,0E+01;90,0;,0;0,\n",
        '"X","Y","Z","Yaw","Pitch","Roll"\n"0.5","-1","20","90","0","0"\n',
        "\nx, y, z, YAW, pitch, roll,\n 0.5 , \N{MINUS SIGN}1,20, +90.0, 0, 0,,\n\n,,,,,\n",
        "Frame,Roll,Pitch,Yaw,Z,Y,X\n7,0,0,90,20,-1,.5",
        "X;Y;Z;Yaw;Pitch;Roll;Note\n0,5;-1;20;90;0;0;lost at 1.5, once\n",
    ],
)
def test_tables_of_other_programs_mean_the_same(tmp_path: Path, text: str) -> None:
    (tmp_path / "p.csv").write_text(text, "utf-8")
    assert read_poses(tmp_path / "p.csv") == [Pose.from_euler((0.5, -1.0, 20.0), np.pi / 2, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "header: '': expected X,Y,Z,Yaw,Pitch,Roll"),
        ("X Y Z Yaw Pitch Roll\n", "header: 'X Y Z Yaw Pitch Roll': expected X,Y,Z,Yaw,Pitch,Roll"),
        ("X,Y,Z,Yaw,Pitch,Roll,x\n", "header: .*: expected one column X"),
        (HEADER + "0,05,0,1,0,90,0,0,0\n", "line 2: 9 cells: '0,05,.*: expected 6, as in the header; decimal commas"),
        (HEADER + '"0,05",0,1,0,0,0\n', "line 2: X: '0,05': expected a decimal point"),
        (HEADER + "1,2,3,4,5,6\n\n1,2,3,4,5,6,7\n", "line 4: 7 cells"),
        ("X;Y;Z;Yaw;Pitch;Roll\n0;0;0;1.234,5;0;0\n", "line 2: Yaw: '1.234,5': expected a finite number"),
        ("X;Y;Z;Yaw;Pitch;Roll\n0,5;0;0;0;0;0\n0;0;1.5;0;0;0\n", "line 3: Z: '1.5': .* mark of line 2, ','"),
        ("X;Y;Z;Yaw;Pitch;Roll\n0.5;0;0;1,5;0;0\n", "line 2: Yaw: '1,5': .* mark of line 2, '.'"),
        ("X;Y;Z;Yaw;Pitch;Roll\n0;0;0;0;0;0;1\n", "line 2: 7 cells: .*: expected 6, as in the header$"),
        (HEADER + "1,2,3,1_0,0,0\n", "line 2: Yaw: '1_0': expected a finite number"),
        (HEADER + "1,2,3,1.#IND,0,0\n", "line 2: Yaw: '1.#IND': expected a finite number"),
        (HEADER + "1,2,3,1e999,0,0\n", "line 2: Yaw: '1e999': expected a finite number"),
        (HEADER + '1,2,"3,4,5,6\n', "line 2: Z: '3,4,5,6': expected"),
        (HEADER + "1,2,3," + 200000 * "4" + ",5,6\n", r"line 2: '1,2,3,4*\.\.\.': expected cells that a comma"),
    ],
)
def test_tables_that_could_mean_two_things_are_refused_with_the_place(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "p.csv").write_text(text, "utf-8")
    with pytest.raises(ValueError, match=rf"^p\.csv: {message}"):
        read_poses(tmp_path / "p.csv")


NUMBERS = st.floats(-1e6, 1e6) | st.integers(-1000, 1000).map(float)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=st.lists(st.tuples(NUMBERS, NUMBERS), max_size=5), form=st.sampled_from(FORMS), kind=st.integers(0, 4))
def test_numbers_come_back_exactly_from_every_kind_of_table(
    tmp_path: Path, rows: list[tuple[float, float]], form: tuple[str, bool, str], kind: int
) -> None:
    delimiter, mark = ((",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","))[kind]
    lines = [("a", "b"), *((repr(a).replace(".", mark), repr(b).replace(".", mark)) for a, b in rows)]
    path = tmp_path / "n.csv"
    path.write_bytes(stored("".join(delimiter.join(line) + "\n" for line in lines), *form))
    assert read_numbers(path, ("b", "a")) == [(b, a) for a, b in rows]
