"""Threads follow a container's quota, not the cores that it sees."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from farside.engine.support.cores import core_count

SEEN = len(os.sched_getaffinity(0))


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, SEEN),
        ({"cpu.max": "max 100000"}, SEEN),
        ({"cpu.max": "100000 100000"}, 1),
        ({"cpu.max": "150000 100000"}, min(SEEN, 2)),
        ({"cpu.max": "1000 100000"}, 1),
        ({"cpu.max": f"{100000 * (SEEN + 8)} 100000"}, SEEN),
        ({"cpu.max": "nonsense"}, SEEN),
        ({"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, SEEN),
        ({"cpu/cpu.cfs_quota_us": "50000", "cpu/cpu.cfs_period_us": "100000"}, 1),
    ],
)
def test_cores_are_those_that_the_quota_allows(tmp_path: Path, files: dict[str, str], expected: int) -> None:
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text + "\n")
    assert core_count(tmp_path) == expected
