"""The command line as a user meets it: a process, its output and its exit code."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from farside.clients.cli import COMMANDS, app
from support.shared import SHARED, needs_shared
from typer.testing import CliRunner


def farside(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "farside.clients.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"COLUMNS": "140", "NO_COLOR": "1"},
    )


def test_help_lists_every_command_and_imports_none() -> None:
    code = (
        "import sys; sys.argv = ['farside', '--help']\n"
        "from farside.clients.cli import main\n"
        "try: main()\n"
        "finally: assert not {'numpy', 'numba', 'farside.clients.info'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    for name in COMMANDS:
        assert f" {name} " in done.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name: str) -> None:
    done = CliRunner().invoke(app, [name, "--help"])
    assert done.exit_code == 0, done.exception
    assert "Usage: " in done.output


def test_unknown_command_and_missing_argument() -> None:
    for arguments in (("nothing",), ("info",), ("compare", "a.yuv", "b.yuv")):
        done = farside(*arguments)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
        assert "Usage: " in done.stderr


def test_bad_input_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    for arguments in (
        ("compare", tmp_path / "a.yuv", tmp_path / "b.yuv", "--size", "4x4"),
        ("compare", tmp_path / "a.yuv", tmp_path / "b.yuv", "--size", "4"),
    ):
        done = farside(*arguments)
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr.startswith("farside: ")
        assert done.stderr.count("\n") == 1


@needs_shared
def test_info_of_a_sound_sequence() -> None:
    done = farside("info", SHARED / "sequences" / "Atrium")
    assert done.returncode == 0, done.stderr
    assert "Atrium: 6 source views, 30 fps" in done.stdout
    for word in ("v5", "480x360", "yuv420p16le", "no problems found"):
        assert word in done.stdout


def test_info_lists_problems_one_line_each(tmp_path: Path) -> None:
    (tmp_path / "s.json").write_text('{"Fps": "x", "cameras": [{"Name": "v0", "Projection": "Box"}]}')
    done = farside("info", tmp_path)
    assert done.returncode == 2
    lines = [line for line in done.stdout.splitlines() if line.startswith("problem ")]
    for expected in ("Fps: ", "v0: Position: missing", 'v0: Projection: "Box"', "v0: texture: missing"):
        assert any(expected in line for line in lines), (expected, lines)


@needs_shared
def test_compare_prints_the_reference_figures() -> None:
    folder = SHARED / "metrics"
    pair = [folder / f"persp_{name}_256x192_yuv420p10le.yuv" for name in ("ref", "shift")]
    done = farside("compare", *pair, "--size", "256x192", "--format", "yuv420p10le")
    assert done.returncode == 0, done.stderr
    for figure in ("30.4953", "46.2181", "39.8086"):
        assert figure in done.stdout
