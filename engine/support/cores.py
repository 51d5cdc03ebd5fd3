"""How many cores this process may use: those that it may run on, and no more than its share of time allows."""

from __future__ import annotations

import contextlib
import math
import os
from pathlib import Path

__all__ = ["core_count"]

_CGROUP = Path("/sys/fs/cgroup")


def core_count(cgroup: Path = _CGROUP) -> int:
    """Cores that threads can keep busy, at least 1; a container's quota of CPU time (Linux' cgroups) counts in full."""
    seen = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(seen, _quota(cgroup))))


def _quota(cgroup: Path) -> float:
    """CPU seconds a second that the process's control group may use; infinite without a limit."""
    with contextlib.suppress(OSError, ValueError):  # version 2: "max 100000", or "150000 100000"
        most, period = (cgroup / "cpu.max").read_text().split()
        return math.inf if most == "max" else int(most) / int(period)
    with contextlib.suppress(OSError, ValueError):  # version 1: -1 for no limit
        most = (cgroup / "cpu" / "cpu.cfs_quota_us").read_text()
        period = (cgroup / "cpu" / "cpu.cfs_period_us").read_text()
        return int(most) / int(period) if int(most) > 0 else math.inf
    return math.inf
