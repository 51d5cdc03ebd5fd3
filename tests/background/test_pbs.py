"""The two parts of the PBS, and the triangles in them."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.background.pbs import ProbableBackgroundSurface
from support.models import sheets


@pytest.mark.parametrize("culled", [0.02, 0.5])
def test_a_surface_is_compacted_where_much_of_it_is_culled(culled):
    pbs = ProbableBackgroundSurface(1)
    mesh = sheets(2)[0]
    pbs.set_static(0, 0, mesh)
    surface = pbs.static[0]
    surface.marks[:, 0] = np.arange(len(surface.marks))
    surface.invalid[: int(culled * len(surface.invalid))] = 1
    valid = surface.invalid == 0
    pbs.compact_static()
    pbs.commit()
    left = pbs.static[0]
    assert left.valid_count == valid.sum()
    assert len(left.invalid) == (len(valid) if culled < 0.1 else valid.sum())
    for after, before in ((left.mesh.points, mesh.points), (left.mesh.uv, mesh.uv)):
        np.testing.assert_array_equal(after[left.mesh.triangles[left.invalid == 0]], before[mesh.triangles[valid]])
    if culled > 0.1:
        assert len(np.unique(left.mesh.triangles)) == len(left.mesh.points)
    np.testing.assert_array_equal(left.marks[left.invalid == 0], surface.marks[valid])
