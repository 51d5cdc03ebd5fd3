"""The project's own files, as a fresh clone has them."""

from __future__ import annotations

import shutil
from pathlib import Path

__all__ = ["ROOT", "copy_checkout"]

ROOT = Path(__file__).parents[2]

_NOT_SOURCES = shutil.ignore_patterns(
    ".git", ".venv", "build", "dist", "*.egg-info", "__pycache__", ".*_cache", ".hypothesis", "*.yuv"
)


def copy_checkout(target: Path) -> Path:
    """A copy without the files that building and testing leave behind, so that nothing stale gets into a wheel."""
    shutil.copytree(ROOT, target, symlinks=True, ignore=_NOT_SOURCES)
    return target
