"""How many questions about the background model are answered in a second (`background.queries`)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..background.queries import ModelQueries
from ..rig.camera import Camera
from ..support.array_types import F64

__all__ = ["QueryRow", "measure_queries", "rays_from_inside", "timed_best"]

_NEAR_M = 1.5  # radius of spheres


@dataclass(frozen=True, slots=True)
class QueryRow:
    """A question, how many were asked at once, how many are answered in a second, the CPU time of all threads for one,
    microseconds (NaN: not known), and the share of them that found something."""

    question: str
    count: int
    per_second: float
    cpu_us: float
    found: float


def rays_from_inside(cameras: tuple[Camera, ...], count: int, seed: int = 0) -> tuple[F64, F64]:
    """Origins and directions [count, 3] of rays in all directions, from anywhere in the box that holds the cameras, a
    quarter of a metre around it included: no two of them are alike."""
    rng, places = np.random.default_rng(seed), np.array([camera.pose.position for camera in cameras])
    origins = rng.uniform(places.min(axis=0) - 0.25, places.max(axis=0) + 0.25, (count, 3))
    directions: F64 = rng.normal(size=(count, 3))
    return origins, directions


def timed_best(ask: Callable[[], Any], repeats: int) -> tuple[float, float]:
    """The least wall time and the least CPU time of all threads, seconds, of some runs after a first one."""
    ask()
    walls, cpus = [], []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        ask()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return min(walls), min(cpus)


def measure_queries(
    queries: ModelQueries, origins: F64, directions: F64, repeats: int, advance: Callable[[], None]
) -> Iterator[QueryRow]:
    """Each question with all rays or with a tenth of their origins, in one call; `advance` is called after each. The
    first is asked once more with few rays, as a robot would in each step."""
    few, count, tenth = 100, len(origins), origins[: max(1, len(origins) // 10)]
    asked: tuple[tuple[str, int, Callable[[], Any]], ...] = (
        ("nearest hit", count, lambda: queries.cast_rays(origins, directions).hit),
        ("nearest hit", few, lambda: queries.cast_rays(origins[:few], directions[:few]).hit),
        ("farthest hit", count, lambda: queries.cast_rays(origins, directions, farthest=True).hit),
        ("any hit within 3 m", count, lambda: ~queries.are_free(origins, directions, 3.0)),
        ("closest point", len(tenth), lambda: queries.closest_points(tenth).hit),
        (f"triangles within {_NEAR_M:g} m", len(tenth), lambda: queries.overlaps(tenth, _NEAR_M).counts > 0),
    )
    for question, number, ask in asked:
        found = float(np.mean(ask()))
        wall, cpu = timed_best(ask, repeats)
        yield QueryRow(question, number, number / wall, 1e6 * cpu / number, found)
        advance()
