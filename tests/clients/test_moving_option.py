"""`--moving NAME=TRACE.csv` and `--draw-moving`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from farside.clients.cli import app
from farside.clients.moving import pose_files
from farside.engine.io.pose_trace import write_poses
from farside.engine.rig.camera import Pose
from farside.engine.synth import write_twin
from farside.server.settings import ServerSettings
from typer.testing import CliRunner


@pytest.fixture(scope="module")
def gymnasium(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gym") / "Gym"
    write_twin("gymnasium-a", folder, 0.03, frames=4)
    return folder


def test_files_are_named_by_camera():
    assert pose_files(None) == {}
    assert pose_files(["v4=walk.csv", "v1=/a=b.csv"]) == {"v4": Path("walk.csv"), "v1": Path("/a=b.csv")}


@pytest.mark.parametrize("text", ["v4", "=walk.csv", "v4=", ""])
def test_other_text_is_refused(text):
    with pytest.raises(ValueError, match=r"--moving: .*: expected NAME=TRACE.csv"):
        pose_files([text])


def test_a_camera_has_one_file():
    with pytest.raises(ValueError, match=r"--moving: 'v4=b.csv': expected one file for camera v4, there is a.csv"):
        pose_files(["v4=a.csv", "v4=b.csv"])


def views_of(gymnasium, out, *options):
    """The views from which each frame of t4 was rendered."""
    report = out / "report.json"
    arguments = ["render", str(gymnasium), "--out", str(out), "--camera", "t4", "--report", str(report), *options]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return [set(row["views"]["t4"]) for row in json.loads(report.read_text())["frames"]]


def test_a_moving_camera_is_drawn_or_only_updates_the_model(gymnasium, tmp_path):
    assert all("v4" in views for views in views_of(gymnasium, tmp_path))
    views = views_of(gymnasium, tmp_path, "--no-draw-moving")
    assert "v4" in views[0]  # nobody knows yet that it moves
    assert all("v4" not in later for later in views[1:])


def test_a_trace_makes_a_camera_move(gymnasium, tmp_path):
    trace = tmp_path / "v0.csv"
    write_poses(trace, [Pose.from_euler((0.3, 0.01 * k, 1.65), 0.0, 0.0, 0.0) for k in range(4)])
    views = views_of(gymnasium, tmp_path, "--no-draw-moving", "--moving", f"v0={trace}")
    assert "v0" in views[0]
    assert all(not {"v0", "v4"} & later for later in views[1:])


def test_the_server_takes_the_option_as_well():
    assert ServerSettings().engine().draw_moving
    assert not ServerSettings(draw_moving=False).engine().draw_moving
    assert ServerSettings(quality="paper", draw_moving=True).engine().draw_moving
