"""Raw video files that are written: errors of the file system name the file, and the others are closed."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from farside.engine.io.raw_writer import RawWriter

FULL = Path("/dev/full")  # each write to it fails as on a full disk


def test_planes_follow_one_another(tmp_path: Path) -> None:
    writer = RawWriter()
    rows = np.arange(12, dtype=np.uint16).reshape(3, 4)
    for path in (tmp_path / "a.yuv", tmp_path / "truth" / "b.yuv"):
        writer.append(path, [rows, rows[:, ::2]])
        writer.append(path, [rows.T])
    writer.close()
    for path in (tmp_path / "a.yuv", tmp_path / "truth" / "b.yuv"):
        expected = np.concatenate([rows.ravel(), rows[:, ::2].ravel(), rows.T.ravel()])
        np.testing.assert_array_equal(np.fromfile(path, np.uint16), expected)


def test_a_full_disk_is_named() -> None:
    writer = RawWriter()
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        writer.append(FULL, [np.zeros(1 << 20, np.uint8)])
    writer.close()


@pytest.mark.parametrize("order", [1, -1])
def test_what_does_not_fit_is_named_and_the_others_are_whole(tmp_path: Path, order: int) -> None:
    writer = RawWriter()
    for path in (FULL, tmp_path / "a.yuv")[::order]:
        full = pytest.raises(OSError, match="No space left on device: '/dev/full'")
        with full if path == FULL else nullcontext():
            writer.append(path, [np.ones(5, np.uint8)])  # so few that they would stay in a buffer
    assert (tmp_path / "a.yuv").read_bytes() == bytes([1] * 5)
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        writer.close()
    assert (tmp_path / "a.yuv").read_bytes() == bytes([1] * 5)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    with pytest.raises(OSError, match=r"/a'$"):
        RawWriter().append(tmp_path / "a" / "b.yuv", [])
