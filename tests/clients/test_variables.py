"""Variables of the environment that have no meaning are named, or have no effect."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from farside.engine.support.kernel_folders import user_cache


@pytest.mark.parametrize("count", ["0", "-2", "many", ""])
def test_a_number_of_threads_that_is_none_is_named(tmp_path: Path, count: str) -> None:
    command = [sys.executable, "-m", "farside.clients.cli", "info", str(tmp_path)]
    told = subprocess.run(command, env={**os.environ, "NUMBA_NUM_THREADS": count}, capture_output=True, text=True)
    assert told.returncode == 2
    assert f"NUMBA_NUM_THREADS: {count!r}: expected a whole number above 0" in told.stderr


def test_a_relative_path_for_caches_does_not_count(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    for given, expected in (("caches", tmp_path / ".cache"), ("", tmp_path / ".cache"), ("/caches", Path("/caches"))):
        monkeypatch.setenv("XDG_CACHE_HOME", given)
        assert user_cache() == expected / "farside"
