"""Surfaces that no head in the viewing space can see are not kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.clients.cli import app
from farside.engine.background.viewing_space import ViewingSpace
from farside.engine.evaluation.extremes import room
from farside.engine.geometry.mesh import Mesh
from farside.engine.kernels.background.hidden import CELL
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, View
from farside.engine.settings import Settings
from support.rooms import texture_of
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
    """A camera 2 m in front of a wall across the x axis, and its view."""
    camera = Camera(f"v{yaw:.0f}", Perspective.from_fov(32, 24, 1.2), Pose.from_euler(position, yaw, 0.0, 0.0), CODING)
    codes = np.full((24, 32), CODING.codes(np.array(2.0)), np.uint16)
    return View(camera, texture_of(np.full((24, 32), 500, np.uint16)), codes)


@pytest.mark.parametrize(("ball", "sides"), [(None, 2), ((-2.0, 0.0, 0.0, 0.5), 1), ((-2.0, 0.0, 0.0, 2.5), 2)])
def test_the_far_side_of_a_wall_is_not_modelled_for_heads_on_this_side(ball, sides):
    views = (wall_between((-2.0, 0.0, 0.0), 0.0), wall_between((2.0, 0.0, 0.0), math.pi))
    engine = Engine([view.camera for view in views], Settings.preset("balanced", viewing_space=ball))
    engine.update(Frame(0, views))
    static = [surface for surface in engine.model.state().surfaces if surface.static]
    assert len(static) == 2
    assert sum(len(surface.triangles) > 0 for surface in static) == sides


# Two rooms: a partition at x = 3 that ends at y = 1. The cameras stand on both sides of its end, the heads behind it.
PARTITION, END = ((3.0, -6.0, -2.6), (3.2, 1.0, 2.8)), 1.0
CUPBOARD = ((8.4, -2.0, -2.6), (9.0, -1.0, 0.5))
BALL = (0.0, -3.0, 0.0, 0.3)
LENS = Perspective.from_fov(160, 120, 1.4)
RIG = [
    Camera(f"v{k}", LENS, room.turned((0.4, y, 0.1 * (k % 2)), -8 * y), room.CODING)
    for k, y in enumerate(np.linspace(-3.0, 3.5, 6).tolist())
]


def two_rooms(*things):
    return room.Room((room.Room().boxes[0], PARTITION, *things))


def played(*rooms, ball=BALL, **settings):
    """An engine that has seen frames of these rooms, and its reports."""
    engine = Engine(RIG, Settings.preset("balanced", viewing_space=ball, **settings))
    return engine, [engine.update(one.frame(RIG, k)).background for k, one in enumerate(rooms)]


def in_ball(count):
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((count, 3))
    directions *= rng.uniform(size=(count, 1)) ** (1 / 3) / np.linalg.norm(directions, axis=1, keepdims=True)
    return np.array(BALL[:3]) + BALL[3] * directions


def past_the_partition(engine):
    """Middles of the model's triangles that heads see before the partition or past its end (which faces away from
    them); and where, at most, the heads' lines to the others in the second room cross the partition, metres."""
    mesh, heads, (front, back) = engine.mesh(), in_ball(500), (PARTITION[0][0], PARTITION[1][0])
    middles = mesh.vertices[mesh.triangles].mean(axis=1)
    share = (front - heads[:, None, 0]) / (middles[:, 0] - heads[:, None, 0])
    crosses = (heads[:, None, 1] + share * (middles[:, 1] - heads[:, None, 1])).max(axis=0)
    rounding = 1e-3  # depth codes
    first, second = middles[:, 0] < front + rounding, middles[:, 0] > back + rounding
    return middles[first | (second & (crosses > END))], crosses[second & (crosses <= END)]


def test_what_a_wall_hides_from_all_heads_is_not_kept_and_all_else_is():
    (whole, _before), (part, after) = played(two_rooms(), ball=None), played(two_rooms())
    (seen, unseen), (still_seen, still_unseen) = past_the_partition(whole), past_the_partition(part)
    np.testing.assert_array_equal(still_seen, seen)
    assert len(unseen) > 0.5 * len(seen)
    assert len(still_unseen) < 0.2 * len(unseen)
    # Kept surfaces that are not seen lie at most a triangle and two cells from seen ones.
    beside = (whole.settings.max_block_px + 2 * CELL) / LENS.fx * PARTITION[0][0]
    assert still_unseen.min() > END - beside > unseen.min()
    assert after[0].hidden > 0
    assert part.model.memory["surfaces"] < 0.8 * whole.model.memory["surfaces"]


def test_where_the_farthest_surface_is_shown_nothing_is_hidden():
    _engine, (report,) = played(two_rooms(), backdrop="farthest")
    assert report.hidden == 0


def test_heads_in_the_space_see_the_same():
    """This holds also when a cupboard has gone and uncovered the far wall behind it."""
    rooms = [two_rooms(CUPBOARD)] * 2 + [two_rooms()] * len(RIG)
    (whole, before), (part, after) = played(*rooms, ball=None), played(*rooms)
    assert before[-1].p_pbs > after[-1].p_pbs
    assert sum(report.hidden for report in after[1:]) > 0
    rng, heads = np.random.default_rng(1), in_ball(12)
    differing = []
    for place in [*heads, np.array([0.4, 2.5, 0.0])]:
        pose = room.turned(tuple(place.tolist()), *rng.uniform((-40, -10, -5), (0, 10, 5)).tolist())
        camera = Camera("head", Perspective.from_fov(120, 90, 1.6), pose, room.CODING)
        one, other = (e.model.render_pbi(camera, e.front.content.present).view.codes for e in (whole, part))
        differing.append(np.count_nonzero(one != other))
    *inside, outside = differing
    assert max(inside) <= 0.001 * 120 * 90
    assert outside > 0.05 * 120 * 90  # heads outside the space do miss it


def test_what_a_straight_edge_hides_from_all_eyes_it_hides_from_the_ball():
    space = ViewingSpace((0.3, -0.2, 0.1), 0.4)
    eyes = space.eyes()[:, 16:19] - np.array(space.middle)
    directions = np.random.default_rng(0).standard_normal((20000, 3))
    reach = (eyes @ (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T).max(axis=0)
    assert reach.min() >= space.radius
    assert np.linalg.norm(eyes, axis=1).max() < 1.1 * space.radius
    assert len(ViewingSpace((0.0, 0.0, 0.0), 0.0).eyes()) == 1


@pytest.mark.parametrize("ball", [(0.0, 0.0, 0.0, -1.0), (0.0, math.nan, 0.0, 1.0), (0.0, 1.0, 2.0)])
def test_what_is_no_ball_is_refused(ball):
    with pytest.raises(ValueError, match="viewing_space"):
        Settings.preset("fast", viewing_space=ball)


def test_the_command_line_names_what_is_wrong(tmp_path):
    wrong = ["render", str(tmp_path), "--out", str(tmp_path / "out"), "--viewing-space", "0", "0", "x", "1"]
    done = CliRunner().invoke(app, wrong)
    assert done.exit_code == 2
    assert "viewing-space" in done.output
