"""What other processes are doing, as far as Linux tells."""

from __future__ import annotations

from pathlib import Path

__all__ = ["is_gone"]


def is_gone(pid: int) -> bool:
    """Whether a process has ended; one that is stopped has not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
    except OSError:
        return True
