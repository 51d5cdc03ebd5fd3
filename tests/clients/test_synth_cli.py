"""`farside synth`: the folder that it writes is whole or absent, and nothing else is touched."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from farside.clients.cli import app
from farside.engine.io.tmiv import open_sequence
from farside.engine.io.tmiv_check import check_sequence
from typer.testing import CliRunner

HANG_S = 540.0
SYNTH = [sys.executable, "-m", "farside.clients.cli", "synth", "hijack"]


def synth(out: Path, *options: str) -> str:
    """Run the command for two small frames; returns its error."""
    done = CliRunner().invoke(app, ["synth", "hijack", str(out), "--scale", "0.02", "--frames", "2", *options])
    return str(done.exception) if done.exception else ""


def test_the_json_is_named_after_the_folder(tmp_path: Path) -> None:
    assert synth(tmp_path / "My twin") == ""
    assert (tmp_path / "My twin" / "My twin.json").is_file()
    assert open_sequence(tmp_path / "My twin").name == "hijack"
    assert check_sequence(tmp_path / "My twin") == []
    assert [path.name for path in tmp_path.iterdir()] == ["My twin"]


def test_without_truth_there_are_the_same_views_and_no_virtual_cameras_but_the_viewport(tmp_path: Path) -> None:
    assert synth(tmp_path / "whole") == synth(tmp_path / "views", "--no-truth") == ""
    whole, views = open_sequence(tmp_path / "whole"), open_sequence(tmp_path / "views")
    assert views.source_names == whole.source_names
    assert set(whole.camera_names) - set(views.camera_names) == set(whole.truth_names)
    assert "viewport" in views.camera_names
    assert not (tmp_path / "views" / "truth").exists()
    assert check_sequence(tmp_path / "views") == []
    for one, other in zip(whole.frame(1).views, views.frame(1).views, strict=True):
        assert (one.codes == other.codes).all()


def test_a_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert synth(out) == ""
    (texture,) = out.glob("v0_texture_*.yuv")
    first = texture.read_bytes()
    assert synth(out, "--seed", "1").endswith("expected a new or an empty folder (--overwrite replaces a sequence)")
    assert texture.read_bytes() == first
    assert synth(out, "--seed", "1", "--overwrite") == ""
    assert texture.read_bytes() != first
    (out / "holiday.txt").write_text("dear diary")
    refused = synth(out, "--overwrite")
    assert refused.startswith(f"{out}: holds 'holiday.txt': expected nothing but a sequence in a folder that is to be")
    assert (out / "holiday.txt").read_text() == "dear diary"


@pytest.mark.parametrize("options", [("--scale", "9"), ("--frames", "0"), ("--depth-noise", "-1")])
def test_bad_options_leave_nothing(tmp_path: Path, options: tuple[str, str]) -> None:
    assert "expected" in synth(tmp_path / "out", *options)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    assert synth(tmp_path / "first") == ""  # kernels are compiled and kept: they do not fit, either
    done = subprocess.run(
        [*SYNTH, str(tmp_path / "out"), "--scale", "0.1", "--frames", "2"],
        capture_output=True,
        text=True,
        timeout=HANG_S,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000)),
    )
    assert done.returncode == 2, done.stderr
    assert "File too large" in done.stderr.splitlines()[-1]
    assert ".yuv" in done.stderr.splitlines()[-1]
    assert [path.name for path in tmp_path.iterdir()] == ["first"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_interrupted_one_leaves_nothing_that_the_next_does_not_remove(
    number: signal.Signals, tmp_path: Path
) -> None:
    command = [*SYNTH, str(tmp_path / "out"), "--scale", "0.02", "--frames", "1000000"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        while not list(tmp_path.glob(".out*/v0_texture*")):
            assert process.poll() is None
        process.send_signal(number)
        assert process.wait(HANG_S) in (128 + number, -number)
    assert not (tmp_path / "out").exists()
    assert len(list(tmp_path.iterdir())) == (number == signal.SIGKILL)
    if number == signal.SIGKILL:
        assert synth(tmp_path / "out") == ""
        assert [path.name for path in tmp_path.iterdir()] == ["out"]
