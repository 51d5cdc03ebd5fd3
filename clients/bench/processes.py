"""CPU time and memory of processes, from Linux's /proc."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Usage", "cpu_of_tree_s"]


@dataclass(frozen=True, slots=True)
class Usage:
    """CPU seconds of some processes, and their resident memory in MB, now and at most; shared memory counts once."""

    cpu_s: float
    resident_mb: float
    peak_mb: float

    @classmethod
    def of(cls, *pids: int) -> Usage:
        """The use of the processes `pids` so far, from Linux's /proc."""
        processes = [Path("/proc") / str(pid) for pid in pids]
        told = [re.findall(r"(\w+):\s+(\d+) kB", (process / "status").read_text()) for process in processes]
        memory = [{name: int(value) for name, value in found} for found in told]
        shared = [used["RssShmem"] for used in memory]
        twice = sum(shared) - max(shared)
        resident, peak = (sum(used[name] for used in memory) - twice for name in ("VmRSS", "VmHWM"))
        return cls(sum(map(_cpu_s, pids)), resident / 1024, peak / 1024)


def cpu_of_tree_s(process: int) -> float:
    """CPU seconds of a process and of all below it, those that have ended included."""
    children: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            children.setdefault(int(_stat(int(path.parent.name))[_PARENT]), []).append(int(path.parent.name))
    total, left = 0.0, [process]
    while left:
        each = left.pop()
        left += children.get(each, [])
        with suppress(OSError):
            total += _cpu_s(each, ended_children=True)
    return total


def _cpu_s(process: int, *, ended_children: bool = False) -> float:
    ticks = _stat(process)[_TIMES : _TIMES + (4 if ended_children else 2)]
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


# Fields after the process's name. Times: its own, outside and inside the kernel, then those of its children that ended.
_PARENT, _TIMES = 1, 11


def _stat(process: int) -> list[str]:
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
