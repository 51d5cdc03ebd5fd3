"""Commands run as another user than the installer's, without a home, where nothing but the output is writable."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import astuple
from functools import partial
from pathlib import Path

import pytest
from farside.clients.cli import COMMANDS
from farside.engine.compiling.needed import needed_for, read
from farside.engine.io.tmiv import open_sequence
from farside.engine.support.kernel_folders import base_folder
from support.checkout import ROOT
from support.sequences import write

HANG_S = 540.0
# May read everything and write nothing that is not its own: the installation is that of another user.
OTHER_USER = [
    "setpriv", "--reuid=12345", "--regid=12345", "--clear-groups", "--inh-caps=-all,+dac_read_search",
    "--ambient-caps=-all,+dac_read_search", "--bounding-set=-all,+dac_read_search",
]  # fmt: skip
MOUNT = 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" && exec "$@"'
READ_ONLY = ["unshare", "-m", "sh", "-c", MOUNT, str(ROOT)]
TOLD = "farside: no place for compiled kernels is writable"


def can(prefix: list[str]) -> bool:
    """Whether a prefix keeps a process from writing to the checkout, and lets it do all else."""
    try:
        reads = subprocess.run([*prefix, sys.executable, "-c", ""], capture_output=True, check=False).returncode == 0
        write_there = [*prefix, "touch", str(ROOT / "README.md")]
        return reads and subprocess.run(write_there, capture_output=True, check=False).returncode != 0
    except OSError:
        return False


needs_root = pytest.mark.skipif(not can(OTHER_USER), reason="needs setpriv and the right to become another user")
needs_mounts = pytest.mark.skipif(not can(READ_ONLY), reason="needs unshare and the right to mount")


def farside(prefix: list[str], *arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command without a home."""
    ours = ("NUMBA_", "XDG_", "_FARSIDE", "PYTHONDONTWRITEBYTECODE")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    return subprocess.run(
        [*prefix, sys.executable, "-m", "farside.clients.cli", *map(str, arguments)],
        capture_output=True, text=True, timeout=HANG_S, env=kept | {"HOME": "/dev/null/x"} | environment, cwd="/",
        check=False,
    )  # fmt: skip


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder in which every user may write; pytest's own are closed to others."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o777)
        yield Path(name)


@pytest.fixture
def room(place: Path) -> Path:
    return write(place / "Room")


@needs_root
@pytest.mark.parametrize("name", [None, *COMMANDS])
def test_help_needs_no_place_to_write(name: str | None) -> None:
    done = farside(OTHER_USER, *([name] if name else []), "--help")
    assert done.returncode == 0, done.stderr
    assert all(line.startswith(TOLD) for line in done.stderr.splitlines())
    assert "Usage: " in done.stdout


@needs_root
def test_info_needs_no_place_to_write(room: Path) -> None:
    done = farside(OTHER_USER, "info", room)
    assert done.returncode == 0, done.stderr
    assert all(line.startswith(TOLD) for line in done.stderr.splitlines())
    assert "Made: 2 source views, 25 fps" in done.stdout


@needs_root
def test_compare_says_once_that_kernels_are_not_kept(place: Path) -> None:
    video = place / "a.yuv"
    video.write_bytes(bytes(range(96)))
    done = farside(OTHER_USER, "compare", video, video, "--size", "8x8", "--format", "yuv420p")
    assert done.returncode == 0, done.stderr
    assert "66.19" in done.stdout  # 10 log10(64 255^2)
    assert done.stderr.startswith(TOLD)
    assert done.stderr.count("\n") == 1


@needs_root
def test_synth_writes_where_it_may(place: Path, tmp_path: Path) -> None:
    done = farside(OTHER_USER, "synth", "hijack", place / "out", "--scale", "0.02", "--frames", "1")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(TOLD) == 1
    assert open_sequence(place / "out").frame_count == 1
    refused = farside(OTHER_USER, "synth", "hijack", tmp_path / "out", "--scale", "0.02", "--frames", "1")
    assert refused.returncode == 2
    assert refused.stderr.startswith("farside: [Errno 13] Permission denied: ")
    assert str(tmp_path) in refused.stderr


@needs_mounts
def test_render_from_a_read_only_installation(room: Path, tmp_path: Path) -> None:
    kept = base_folder()
    assert kept is not None
    options = ("--out", tmp_path / "out", "--camera", "v0", "--frames", "0:1", "--no-background")
    assert farside([], "render", room, *options, NUMBA_CACHE_DIR=str(kept)).returncode == 0
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    done = farside(READ_ONLY, "render", room, *options, NUMBA_CACHE_DIR=str(kept))
    assert done.returncode == 0, done.stderr
    assert TOLD not in done.stderr
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


@needs_root
def test_kernels_in_a_folder_of_somebody_else_are_used(place: Path) -> None:
    kernel = read()[needed_for(["synth"])[0]]
    code = f"from farside.engine.compiling.worker import compile_kernel as c; print(c{astuple(kernel)[:3]!r})"
    environment = {"NUMBA_CACHE_DIR": str(place / "filled"), "HOME": "/dev/null/x"}
    run = partial(subprocess.run, stdout=subprocess.PIPE, text=True, check=True, cwd="/")
    assert run([sys.executable, "-c", code], env=os.environ | environment).stdout == "compiled\n"
    assert run([*OTHER_USER, sys.executable, "-c", code], env=os.environ | environment).stdout == "known\n"
