"""New sequences appear as a whole or not at all, and replace nothing but a sequence."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from farside.engine.io.tmiv import open_sequence
from farside.engine.io.whole_sequence import NewSequence
from support.sequences import write

HANG_S = 120.0


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def make(path: Path, overwrite: bool = False) -> None:
    with NewSequence(path, overwrite=overwrite) as new:
        write(new.folder, json_name=new.path.name)
        new.finish()


@pytest.mark.parametrize("there", ["nothing", "no parent", "an empty folder", "a link", "a desktop's file"])
def test_a_sequence_appears_where_it_was_wanted(tmp_path: Path, there: str) -> None:
    path = tmp_path / "a" / "b" / "S" if there == "no parent" else tmp_path / "S"
    if there == "a link":
        (tmp_path / "T").mkdir()
        path.symlink_to(tmp_path / "T")
    elif there not in ("nothing", "no parent"):
        path.mkdir()
    if there == "a desktop's file":
        (path / ".DS_Store").write_bytes(b"")
    make(path)
    assert open_sequence(path).frame_count == 3
    expected = contents(write(tmp_path / "expected"))
    name = "T" if there == "a link" else "S"
    expected[f"{name}.json"] = expected.pop("expected.json")
    found = contents(path)
    found.pop(".DS_Store", None)
    assert found == expected
    assert not list(path.parent.glob(".*"))


@pytest.mark.parametrize("exists", [False, True])
def test_after_an_error_nothing_is_left(tmp_path: Path, exists: bool) -> None:
    path = tmp_path / "a" / "S"
    if exists:
        path.mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))

    def interrupted() -> None:
        with NewSequence(path) as new:
            write(new.folder)
            assert new.folder.name.startswith(".")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("moves", range(9))
def test_after_an_error_while_it_is_put_in_place_the_old_one_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: int
) -> None:
    make(tmp_path / "S")
    before, rename, left = contents(tmp_path), Path.rename, [moves]

    def failing(path: Path, target: Path) -> Path:
        if not left[0]:
            left[0] = 1000
            raise OSError("disk")
        left[0] -= 1
        return rename(path, target)

    def replace() -> None:
        with NewSequence(tmp_path / "S", overwrite=True) as new:
            (new.folder / "S.json").write_text("{}")
            (new.folder / "v0_texture_10x6_yuv420p10le.yuv").write_bytes(b"new")
            new.finish()

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OSError, match="disk"):
        replace()
    assert contents(tmp_path) == before


def test_only_a_sequence_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "S"
    make(path)
    (path / "v9_texture_10x6_yuv420p10le.yuv").write_bytes(b"of an older one")
    with pytest.raises(FileExistsError, match=r"S: holds 'S\.json', 'truth', .*, \.\.\.: expected a new or an empty"):
        NewSequence(path)
    for name in ("notes.txt", "report.json", "truth/notes.txt", "v0_texture_10x6_yuv444p.yuv"):
        (path / name).write_text("{}")
        before = contents(path)
        with pytest.raises(FileExistsError, match="expected nothing but a sequence"):
            NewSequence(path, overwrite=True)
        assert contents(path) == before
        (path / name).unlink()
    make(path, overwrite=True)
    expected = contents(write(tmp_path / "expected"))
    expected["S.json"] = expected.pop("expected.json")
    assert contents(path) == expected
    (tmp_path / "file").write_text("")
    for overwrite in (False, True):
        with pytest.raises(FileExistsError, match="file: a file: expected a new or an empty folder"):
            NewSequence(tmp_path / "file", overwrite=overwrite)


KILLED = """
import os, signal, sys
from farside.engine.io.whole_sequence import NewSequence
from support.sequences import write
from pathlib import Path
with NewSequence(sys.argv[1], overwrite=True) as new:
    write(new.folder, json_name=new.path.name)
    if sys.argv[2] == "moving":
        rename = Path.rename
        def dying(path, target):
            rename(path, target)
            if path.name.startswith("v1"):
                os.kill(os.getpid(), signal.SIGKILL)
        Path.rename = dying
        new.finish()
    elif sys.argv[2] == "waiting":
        print("ready", flush=True)
        sys.stdin.read()
    os.kill(os.getpid(), signal.SIGKILL)
"""
PATHS = os.pathsep.join(sys.path)


@pytest.mark.parametrize("when", ["writing", "moving"])
@pytest.mark.parametrize("there", ["nothing", "an empty folder"])
def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path: Path, when: str, there: str) -> None:
    path = tmp_path / "S"
    if there == "an empty folder":
        path.mkdir()
    command = [sys.executable, "-c", KILLED, str(path), when]
    subprocess.run(command, env=os.environ | {"PYTHONPATH": PATHS}, timeout=HANG_S, check=False)
    if when == "writing":
        (hidden,) = tmp_path.glob("**/.S.farside-unfinished")
        assert (hidden / "S.json").is_file()
    if there == "an empty folder":
        assert not list(path.glob("*.json"))
        make(path)
    else:
        make(path, overwrite=path.exists())
    assert open_sequence(path).frame_count == 3
    assert list(tmp_path.glob("**/.*")) == []


def test_two_processes_do_not_write_the_same_sequence(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "S"), "waiting"]
    environment = os.environ | {"PYTHONPATH": PATHS}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment) as other:
        assert other.stdin is not None
        assert other.stdout is not None
        assert other.stdout.readline() == b"ready\n"
        with pytest.raises(BlockingIOError, match="another process is writing"):
            NewSequence(tmp_path / "S")
        other.stdin.close()
    make(tmp_path / "S")
