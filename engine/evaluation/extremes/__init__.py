"""Numerical stability at the extremes: one table of cases, which the benchmark prints and the tests run."""

from __future__ import annotations

from .cameras import camera_cases
from .case import Case, Row, run
from .depths import depth_cases
from .growth import growth_cases, repeated_cases
from .moved import moved_cases
from .rates import rate_cases
from .rays import ray_cases

__all__ = ["Case", "Row", "all_cases", "growth_cases", "run"]


def all_cases() -> list[Case]:
    """All cases, in the order of the table."""
    pictures = [*moved_cases(), *depth_cases(), *camera_cases()]
    return [*pictures, *ray_cases(), *growth_cases(300), *rate_cases(), *repeated_cases()]
