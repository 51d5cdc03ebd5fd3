"""What no head in the viewing space can see is not kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.clients.cli import app
from farside.engine.background.viewing_space import ViewingSpace
from farside.engine.camera import Camera, Perspective, Pose
from farside.engine.depth import DepthCoding
from farside.engine.engine import Engine
from farside.engine.frame import Frame, View
from farside.engine.mesh import Mesh
from farside.engine.settings import Settings
from rooms import texture_of
from typer.testing import CliRunner

CODING = DepthCoding(0.5, 50.0, 16)


def test_a_triangle_is_kept_while_a_point_of_the_ball_is_before_it():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (600, 3)).astype(np.float32)
    mesh = Mesh(points, np.zeros((600, 2), np.float32), np.arange(600, dtype=np.int32).reshape(-1, 3))
    space = ViewingSpace((0.3, -0.2, 0.1), 0.4)
    directions = rng.standard_normal((20000, 3))
    ball = np.array(space.middle) + space.radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    a, b, c = points.reshape(-1, 3, 3).astype(float).transpose(1, 0, 2)
    before = (np.cross(b - a, c - a) @ ball.T - np.einsum("ij,ij->i", np.cross(b - a, c - a), a)[:, None]).max(axis=1)
    sure = np.abs(before) > 1e-2 * np.linalg.norm(np.cross(b - a, c - a), axis=1)  # 20000 points leave small gaps
    assert sure.mean() > 0.9
    np.testing.assert_array_equal(space.sees(mesh)[sure], before[sure] > 0)
    assert len(space.seen(mesh).triangles) == space.sees(mesh).sum()


def wall_between(position, yaw):
    """A camera 2 m before a wall across the x axis, and what it sees."""
    camera = Camera(f"v{yaw:.0f}", Perspective.from_fov(32, 24, 1.2), Pose.from_euler(position, yaw, 0.0, 0.0), CODING)
    codes = np.full((24, 32), CODING.codes(np.array(2.0)), np.uint16)
    return View(camera, texture_of(np.full((24, 32), 500, np.uint16)), codes)


@pytest.mark.parametrize(("ball", "sides"), [(None, 2), ((-2.0, 0.0, 0.0, 0.5), 1), ((-2.0, 0.0, 0.0, 2.5), 2)])
def test_the_far_side_of_a_wall_is_not_modelled_for_heads_on_this_side(ball, sides):
    views = (wall_between((-2.0, 0.0, 0.0), 0.0), wall_between((2.0, 0.0, 0.0), math.pi))
    engine = Engine([view.camera for view in views], Settings.preset("balanced", viewing_space=ball))
    engine.update(Frame(0, views))
    assert len(engine.model._pbs.static) == 2
    assert sum(len(surface.mesh.triangles) > 0 for surface in engine.model._pbs.static.values()) == sides


@pytest.mark.parametrize("ball", [(0.0, 0.0, 0.0, -1.0), (0.0, math.nan, 0.0, 1.0), (0.0, 1.0, 2.0)])
def test_what_is_no_ball_is_refused(ball):
    with pytest.raises(ValueError, match="viewing_space"):
        Settings.preset("fast", viewing_space=ball)


def test_the_command_line_names_what_is_wrong(tmp_path):
    wrong = ["render", str(tmp_path), "--out", str(tmp_path / "out"), "--viewing-space", "0", "0", "x", "1"]
    done = CliRunner().invoke(app, wrong)
    assert done.exit_code == 2
    assert "viewing-space" in done.output
