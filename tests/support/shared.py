"""The folder of shared test material: next to the checkout, or FARSIDE_SHARED. It is not part of the project."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

__all__ = ["SHARED", "needs_shared"]

SHARED = Path(os.environ.get("FARSIDE_SHARED", Path(__file__).parents[3] / "shared"))

needs_shared = pytest.mark.skipif(
    not (SHARED / "tmiv").is_dir(), reason=f"the shared sequences are not at {SHARED} (set FARSIDE_SHARED)"
)
