"""The level of a CPU is the highest of which it has all abilities."""

from __future__ import annotations

from pathlib import Path

import pytest
from farside.engine.support import cpu_level
from farside.engine.support.cpu_level import LEVELS

V3, V4 = (" ".join(sorted(LEVELS[level])) for level in ("x86-64-v3", "x86-64-v4"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"flags\t\t: fpu {V4} more", "x86-64-v4"),
        (f"flags\t\t: {V3} avx512f", "x86-64-v3"),
        ("flags\t\t: avx2 fma", ""),
        ("Features\t: asimd", ""),
        ("", ""),
    ],
)
def test_the_level_is_the_highest_that_the_flags_allow(tmp_path: Path, text: str, expected: str) -> None:
    info = tmp_path / "cpuinfo"
    info.write_text(f"processor : 0\n{text}\n\nprocessor : 1\n{text}\n")
    assert cpu_level.cpu_level(info) == expected
    assert cpu_level.cpu_level(tmp_path / "none") == ""


def test_the_level_counts_only_where_its_kernels_came_with_the_installation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CPU_NAME", raising=False)
    monkeypatch.setattr(cpu_level, "SHIPPED", tmp_path)
    monkeypatch.setattr(cpu_level, "cpu_level", lambda: "x86-64-v3")
    assert cpu_level.chosen_cpu() == ""
    (tmp_path / "x86-64-v3").mkdir()
    assert cpu_level.chosen_cpu() == "x86-64-v3"
    monkeypatch.setenv("NUMBA_CPU_NAME", "znver3")
    assert cpu_level.chosen_cpu() == "znver3"
