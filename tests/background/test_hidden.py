"""Which triangles no eye is shown: rays as another tracer casts them, and cells of a picture as boxes that touch."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.background.capture import Present
from farside.engine.background.pbs import ProbableBackgroundSurface
from farside.engine.background.ray_tracer import EmbreeTracer
from farside.engine.background.viewing_space import ViewingSpace
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.background.hidden import CELL, flag_unseen, spread_seen
from support.models import sheets
from support.rooms import camera_row, see
from support.slow_tracer import SlowTracer

SHAPE = (17, 23)  # cells


def some(seed, *, wraps):
    """Corners in a picture, some beyond its sides, and triangles of them."""
    rng = np.random.default_rng(seed)
    h, w = SHAPE
    middles = rng.uniform((-1, -1), (w + 1, h + 1), (40, 1, 2)) * CELL
    uv = (middles + rng.uniform(-1.5, 1.5, (40, 3, 2)) * CELL).reshape(-1, 2).astype(np.float32)
    if not wraps:
        uv = np.clip(uv, 0, np.array([w, h]) * CELL - 0.5, dtype=np.float32)
    return uv, np.arange(120, dtype=np.int32).reshape(-1, 3)


def touched(corners, room, *, wraps):
    """Cells that the box round some corners, and round it some room, has a part in."""
    (left, top), (right, bottom) = corners.min(axis=0) - room, corners.max(axis=0) + room
    found = np.zeros(SHAPE, bool)
    h, w = SHAPE
    for y, x in np.ndindex(h, 3 * w if wraps else w):
        x0 = x - w if wraps else x  # a turn before, the picture, a turn behind
        inside = CELL * x0 <= right and left < CELL * (x0 + 1) and CELL * y <= bottom and top < CELL * (y + 1)
        found[y, x % w] |= inside
    return found


@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_cells_and_flags_are_those_of_boxes(seed, wraps):
    uv, triangles = some(seed, wraps=wraps)
    rng = np.random.default_rng(seed + 10)
    seen, invalid = ((rng.random(len(triangles)) < 0.15).astype(np.uint8) for _ in range(2))
    cells = np.zeros(SHAPE, np.uint8)
    cells[rng.random(SHAPE) < 0.01] = 1
    boxes = uv[triangles].astype(float)
    expected = cells != 0
    for corners in boxes[seen != 0]:
        expected |= touched(corners, CELL, wraps=wraps)
    spread_seen(uv, triangles, seen, wraps, cells)
    np.testing.assert_array_equal(cells, expected)
    beside = np.array([(touched(corners, 0, wraps=wraps) & expected).any() for corners in boxes])
    flagged = invalid.copy()
    count = flag_unseen(uv, triangles, wraps, cells, flagged)
    np.testing.assert_array_equal(flagged, (invalid != 0) | ~beside)
    assert count == np.count_nonzero((invalid == 0) & ~beside) > 0


@pytest.mark.parametrize("seed", range(3))
def test_triangles_that_an_eye_is_shown_are_those_of_the_slow_tracer(seed):
    """Three rough sheets one behind the other, with gaps; some triangles are not there, some cells are known."""
    meshes = sheets(seed)
    eyes = ViewingSpace((0.2, 0.1, -0.1), 0.4).eyes()[::5]
    views = [see(camera, 0.1) for camera in camera_row(3, (24, 16))]
    table = ViewTable([PreparedView(view, TriangulationOptions(0.0, 0.1), np.zeros(3)) for view in views])
    present = Present(0.0, table, {})
    cells = np.zeros((4, 4), np.uint8)
    cells[2, 2] = 1
    found = []
    for tracer in (EmbreeTracer(), SlowTracer()):
        pbs = ProbableBackgroundSurface(3, tracer)
        rng = np.random.default_rng(seed)
        for number, mesh in enumerate(meshes):
            uv = rng.uniform(0, 4 * CELL - 1, mesh.uv.shape).astype(np.float32)
            mesh = type(mesh)(mesh.points, uv, mesh.triangles)
            pbs.set_static(number, number, mesh).invalid[:] = rng.random(len(mesh.triangles)) < 0.1
        pbs.commit()
        for surface in list(pbs.static.values()):
            seen = np.zeros(len(surface.invalid), np.uint8)
            rays = tracer.mark_seen(eyes, surface, present, (0.05, 0.0), False, cells, seen)
            assert rays > 0
            assert not seen[surface.invalid != 0].any()
            found.append(seen)
    fast, slow = np.concatenate(found[:3]), np.concatenate(found[3:])
    # Rays through the very sides of triangles may pass on either side of them.
    assert np.mean(fast != slow) < 0.01
    assert 0.1 < fast.mean() < 0.95
