"""The level of this machine's CPU (x86-64 psABI): kernels that came with the installation are compiled for a level."""

from __future__ import annotations

import contextlib
import os
import platform
from pathlib import Path

from .kernel_folders import SHIPPED

__all__ = ["LEVELS", "chosen_cpu", "cpu_level", "this_cpu"]

_CPUINFO = Path("/proc/cpuinfo")
_V3 = {"avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"}
LEVELS = {"x86-64-v4": _V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}, "x86-64-v3": _V3}
"""Levels, the highest first, and the abilities that each needs, as Linux names them."""


def cpu_level(cpuinfo: Path = _CPUINFO) -> str:
    """The highest of LEVELS that this CPU has; nothing if it has none, or if the system does not tell."""
    with contextlib.suppress(OSError):
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("flags"):
                flags = set(line.partition(":")[2].split())
                return next((level for level, needed in LEVELS.items() if needed <= flags), "")
    return ""


def chosen_cpu() -> str:
    """The CPU for which kernels are compiled: $NUMBA_CPU_NAME, the level whose kernels came with the installation, or
    nothing for just this CPU."""
    if chosen := os.environ.get("NUMBA_CPU_NAME", ""):
        return chosen
    level = cpu_level()
    return level if level and (SHIPPED / level).is_dir() else ""


def this_cpu() -> str:
    """The CPU's model and abilities, as far as the system tells."""
    with contextlib.suppress(OSError):
        lines = _CPUINFO.read_text().split("\n\n")[0].splitlines()
        return "\n".join(line for line in lines if line.startswith(("model name", "flags")))
    return platform.processor()
