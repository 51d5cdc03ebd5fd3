"""The command line as a user meets it: a process, its output and its exit code."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from farside.clients.cli import COMMANDS, app
from support.shared import SHARED, needs_shared
from typer.testing import CliRunner, Result


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


def test_info_loads_no_compiler() -> None:
    code = "import sys, farside.clients.info; assert 'numba' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


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


def compared(tmp_path: Path, names: tuple[str, str], *options: str, size: int = 2 * 96) -> Result:
    """The command's result for two files of that many bytes: two frames of 8x8 with 8 bits, or one with 16."""
    for name in names:
        (tmp_path / name).write_bytes(bytes(size))
    return CliRunner().invoke(app, ["compare", *(str(tmp_path / name) for name in names), *options])


CONTRADICTIONS = [
    (("a_16x4_yuv420p.yuv", "b.yuv"), ["8x8"], "a_16x4_yuv420p.yuv: --size: 8x8: expected 16x4, as in the name"),
    (("a.yuv", "b_16x4.yuv"), ["8x8"], "b_16x4.yuv: --size: 8x8: expected 16x4, as in the name"),
    (("a_8x8_yuv420p.yuv", "b.yuv"), ["8x8", "--format", "yuv420p10le"],
     "a_8x8_yuv420p.yuv: --format: yuv420p10le: expected yuv420p, as in the name"),
    (("a_8x8_yuv444p.yuv", "b.yuv"), ["8x8", "--format", "yuv420p"],
     "a_8x8_yuv444p.yuv: --format: yuv420p: expected yuv444p, as in the name"),
    (("a_16x4_yuv420p10le.yuv", "b.yuv"), ["8x8", "--format", "yuv420p"],
     "a_16x4_yuv420p10le.yuv: --size: 8x8: expected 16x4, as in the name; --format: yuv420p: expected yuv420p10le, as"),
    (("a_8x8_yuv420p.yuv", "b_8x8_yuv420p10le.yuv"), ["8x8"],
     "--format: missing: the names tell different ones, a_8x8_yuv420p.yuv: yuv420p and b_8x8_yuv420p10le.yuv: yuv420p"),
    (("a_8x8_rgb24.yuv", "b.yuv"), ["8x8"], "format: 'rgb24': expected yuv420p"),
    (("a.yuv", "b.yuv"), ["8x10"], "a.yuv: 192 bytes: expected a multiple of 240, a frame of 8x10 yuv420p10le"),
]  # fmt: skip


@pytest.mark.parametrize(("names", "options", "said"), CONTRADICTIONS)
def test_compare_refuses_what_the_names_or_lengths_contradict(
    tmp_path: Path, names: tuple[str, str], options: list[str], said: str
) -> None:
    done = compared(tmp_path, names, "--size", *options)
    assert str(done.exception).startswith(said)


@pytest.mark.parametrize(
    ("names", "options"),
    [
        (("a_8x8_yuv420p.yuv", "b.yuv"), ()),  # the format is that of the name
        (("a_8X8_YUV420P.yuv", "of_16x4_scaled_to_8x8_yuv420p.yuv"), ()),
        (("a_8x8_30fps_420_8bit.yuv", "b.yuv"), ("--format", "yuv420p")),
    ],
)
def test_compare_takes_what_fits_the_names(tmp_path: Path, names: tuple[str, str], options: tuple[str, ...]) -> None:
    done = compared(tmp_path, names, "--size", "8x8", *options)
    assert (done.exit_code, done.stderr) == (0, ""), done.exception
    assert re.search(r"^ +1 ", done.stdout, re.MULTILINE)  # two frames, so samples have 8 bits


def test_compare_only_warns_if_the_length_contradicts_the_name_too(tmp_path: Path) -> None:
    done = compared(tmp_path, ("a_32x32_yuv420p.yuv", "b.yuv"), "--size", "8x8", "--format", "yuv420p")
    assert done.exit_code == 0, done.exception
    assert done.stderr == (
        "a_32x32_yuv420p.yuv: --size: 8x8: expected 32x32, as in the name; but its 192 bytes are no whole number of "
        "such frames\n"
    )


def test_compare_of_different_numbers_of_frames_names_both(tmp_path: Path) -> None:
    (tmp_path / "b.yuv").write_bytes(bytes(96))
    (tmp_path / "a.yuv").write_bytes(bytes(192))
    files = [str(tmp_path / name) for name in ("a.yuv", "b.yuv")]
    done = CliRunner().invoke(app, ["compare", *files, "--size", "8x8", "--format", "yuv420p"])
    assert str(done.exception) == "frames: a.yuv has 2, b.yuv has 1: expected the same number"
    assert re.findall(r"^ +(\d+) ", done.stdout, re.MULTILINE) == ["0"]


def test_a_user_without_home_is_told_what_the_demo_needs() -> None:
    """As the system answers for a user whom it does not know."""
    code = (
        "import pwd, sys; from pathlib import Path\n"
        "def unknown(number): raise KeyError(number)\n"
        "pwd.getpwuid = unknown\n"
        "sys.argv = ['farside', 'demo', '--port', '0']\n"
        "from farside.clients.cli import main; main()\n"
    )
    environment = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 2, done.stderr
    assert "--cache: this user has no home folder: expected a folder for the twin" in done.stderr
    assert "Traceback" not in done.stderr
