"""Sealed files: every byte is checked, a file is written as a whole or not at all, records come back as they were."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
import re

import numpy as np
import numpy.typing as npt
import pytest
from farside.engine.io.records import from_plain, to_plain
from farside.engine.io.sealed_file import MAGIC, read_sealed, write_sealed

VERSION = 3
ARRAYS = [
    ("codes", np.arange(12, dtype=np.uint16).reshape(3, 4)),
    ("none", np.empty((0, 2), np.float32)),
    ("flags", np.array([True, False, True])),
    ("numbers", np.array([[1.5, np.nan, -np.inf]])),
]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "room.farside"


def write(path, arrays=ARRAYS, content=None):
    return write_sealed(path, VERSION, {"text": "ä", "number": 0.1} if content is None else content, arrays)


def test_a_file_holds_its_content_and_its_arrays(path):
    assert write(path) == path.stat().st_size
    content, arrays = read_sealed(path, VERSION)
    assert content == {"text": "ä", "number": 0.1}
    for found, (_, expected) in zip(arrays, ARRAYS, strict=True):
        np.testing.assert_array_equal(found, expected)
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape)
        assert found.flags.writeable
    assert read_sealed(path, VERSION, arrays=False) == (content, ())
    assert os.listdir(path.parent) == [path.name]


@pytest.mark.parametrize("bit", range(8))
def test_a_bit_that_has_changed_is_found_wherever_it_is(path, bit):
    write(path)
    whole = path.read_bytes()
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << bit
        path.write_bytes(damaged)
        for arrays in (True, False):
            with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: .*: expected "):
                read_sealed(path, VERSION, arrays=arrays)


def test_a_file_of_another_length_is_refused(path):
    write(path)
    whole = path.read_bytes()
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: .*: expected "):
            read_sealed(path, VERSION)
    path.write_bytes(whole + b"\0")
    with pytest.raises(ValueError, match=rf"size: {len(whole) + 1} bytes: expected {len(whole)}; something follows"):
        read_sealed(path, VERSION)


def test_what_is_damaged_is_named(path):
    write(path)
    whole = path.read_bytes()
    place = len(whole) - 1  # in the last array
    path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]))
    with pytest.raises(ValueError, match=r"checksum of numbers: [0-9a-f]{12}: expected [0-9a-f]{12}; the file is dam"):
        read_sealed(path, VERSION)
    path.write_bytes(whole)
    with pytest.raises(ValueError, match=f"version: {VERSION}: expected {VERSION + 1}"):
        read_sealed(path, VERSION + 1)
    path.write_bytes(b"RIFF" + whole[4:])
    with pytest.raises(ValueError, match="first bytes: b'RIFFSIDE': expected"):
        read_sealed(path, VERSION)


def test_a_shape_beyond_the_file_is_refused_before_memory_is_taken(path, monkeypatch):
    write(path)

    def vast(item, array, _listed=None):
        return {"name": "codes", "dtype": "<u2", "shape": [1 << 40, 1 << 40], "sha256": ""}

    monkeypatch.setattr("farside.engine.io.sealed_file._listed", vast)
    write(path)
    with pytest.raises(ValueError, match=r"size: \d+ bytes: expected \d{20,}; it is cut short"):
        read_sealed(path, VERSION)


def test_a_folder_or_a_pipe_is_no_saved_model(path):
    os.mkfifo(path)
    holder = os.open(path, os.O_RDWR)
    try:
        with pytest.raises(ValueError, match="kind: no regular file"):
            read_sealed(path, VERSION)
    finally:
        os.close(holder)


def test_a_file_that_cannot_be_written_stays_as_it_was(path, monkeypatch):
    write(path)
    before = path.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write(path, ARRAYS[:1])
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == [path.name]


def test_an_array_of_another_type_is_refused_before_anything_is_written(path):
    with pytest.raises(ValueError, match="shorts: <i2: expected one of"):
        write(path, [("shorts", np.zeros(3, np.int16))])
    assert os.listdir(path.parent) == []


def test_what_a_killed_process_left_is_replaced_and_a_living_one_is_not_disturbed(path):
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(b"left" * 100)
    write(path)
    assert os.listdir(path.parent) == [path.name]
    with part.open("wb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(BlockingIOError, match="expected no other process to write it"):
            write(path, ARRAYS[:1])
    read_sealed(path, VERSION)
    assert len(read_sealed(path, VERSION).arrays) == len(ARRAYS)


@dataclasses.dataclass(frozen=True)
class Inner:
    name: str
    at: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Outer:
    items: tuple[Inner, ...]
    codes: npt.NDArray[np.uint16]
    chosen: int | tuple[float, ...] | None
    exact: bool


RECORD = Outer((Inner("a", (0.1, 2)), Inner("b", (-1e300, 5e-324))), ARRAYS[0][1], (1.0, 2.5), True)


def plain():
    arrays = []
    return json.loads(json.dumps(to_plain(RECORD, arrays, "it"))), [array for _, array in arrays], arrays


def test_a_record_comes_back_as_it_was():
    made, arrays, named = plain()
    assert [name for name, _ in named] == ["it.codes"]
    found = from_plain(Outer, made, arrays, "it")
    assert (found.items, found.chosen, found.exact) == (RECORD.items, RECORD.chosen, RECORD.exact)
    assert found.codes is arrays[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exact": 1}, "it.exact: 1: expected bool"),
        ({"codes": {"array": 1}}, r"it.codes: .*: expected an array's number below 1"),
        ({"codes": {"array": True}}, r"it.codes: .*: expected an array's number below 1"),
        ({"codes": [1, 2]}, "it.codes: .*: expected an array's number"),
        ({"items": [{"name": "a"}]}, r"it.items\[0\]: \['name'\]: expected the fields name, at"),
        ({"items": [{"name": 1, "at": [1.0, 2.0]}]}, r"it.items\[0\].name: 1: expected str"),
        ({"items": [{"name": "a", "at": [1.0]}]}, r"it.items\[0\].at: \[1.0\]: expected a list of 2"),
        ({"items": {}}, "it.items: {}: expected a list"),
        ({"chosen": "x"}, "it.chosen: x: expected NoneType"),
        ({"more": 1}, "it: .*: expected the fields"),
    ],
)
def test_another_record_is_refused(change, message):
    made, arrays, _ = plain()
    with pytest.raises(ValueError, match=message):
        from_plain(Outer, made | change, arrays, "it")


def test_an_array_of_another_type_is_not_taken():
    made, arrays, _ = plain()
    with pytest.raises(ValueError, match=r"it\.codes: int32: expected uint16"):
        from_plain(Outer, made, [arrays[0].astype(np.int32)], "it")


def test_the_first_byte_is_no_text():
    with pytest.raises(UnicodeDecodeError):
        MAGIC.decode()
