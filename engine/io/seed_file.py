"""Files of earlier models that a new one may begin with: saved models, and GLB files."""

from __future__ import annotations

from pathlib import Path

from .saved_file import is_saved, read_about

__all__ = ["check_seed"]


def check_seed(path: Path) -> None:
    """Checks a file as far as that is possible without its pictures; loads no compiler.

    Raises OSError, and ValueError, which names the file, the field, its value and what was expected.
    """
    if is_saved(path):
        read_about(path)
    else:
        from .glb_scene import read_glb  # late: it loads a library for pictures

        read_glb(path, pictures=False)
