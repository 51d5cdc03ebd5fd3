"""The measure of questions about the model: its rays stay inside the rig, and its table has every question."""

from __future__ import annotations

import re

import numpy as np
import pytest
from farside.clients.bench.queries import show_queries
from farside.engine.evaluation.queries import rays_from_inside
from farside.engine.synth import make_twin


def test_rays_start_among_the_cameras_and_go_everywhere() -> None:
    twin = make_twin("museum", 0.05)
    origins, directions = rays_from_inside(twin.sources, 4000)
    places = np.array([camera.pose.position for camera in twin.sources])
    assert (origins >= places.min(axis=0) - 0.25).all()
    assert (origins <= places.max(axis=0) + 0.25).all()
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(unit.mean(axis=0), 0.0, atol=0.05)


def test_each_question_has_its_rate(capsys: pytest.CaptureFixture[str]) -> None:
    show_queries("museum", 0.05, 2, "balanced", 1000, repeats=1)
    rows = re.findall(r"│ ([\w ,.]+?) +│ +([\d,]+) │ +([\d,]+) │ +([\d.]*) │ +([\d.]+) % │", capsys.readouterr().out)
    assert [(row[0], row[1]) for row in rows] == [
        ("nearest hit", "1,000"), ("nearest hit", "100"), ("farthest hit", "1,000"), ("any hit within 3 m", "1,000"),
        ("closest point", "100"), ("triangles within 1.5 m", "100"), ("nearest hit, HTTP, msgpack", "1,000"),
        ("nearest hit, HTTP, msgpack", "100"), ("nearest hit, HTTP, JSON", "1,000"),
    ]  # fmt: skip
    assert all(int(row[2].replace(",", "")) > 0 for row in rows)
    assert [float(rows[k][4]) > 90.0 for k in (0, 1, 2, 4, 6, 7, 8)] == [True] * 7
    assert [row[3] != "" for row in rows] == [True] * 6 + [False] * 3
