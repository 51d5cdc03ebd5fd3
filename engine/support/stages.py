"""Milliseconds per stage, as every report carries them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["Stages", "timed"]


class Stages(dict[str, float]):
    """Milliseconds of wall time per stage; `cpu` holds the CPU time of the whole process in that stage.

    `cpu` therefore includes all that other threads of the process do meanwhile: another eye, an update.
    """

    def __init__(self) -> None:
        super().__init__()
        self.cpu: dict[str, float] = {}

    def add(self, name: str, wall: float, cpu: float) -> None:
        """Add milliseconds of wall and CPU time to a stage."""
        self[name] = self.get(name, 0.0) + wall
        self.cpu[name] = self.cpu.get(name, 0.0) + cpu


@contextmanager
def timed(stages: Stages, name: str) -> Iterator[None]:
    """Add the milliseconds that the `with` block takes to the stage `name`."""
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        yield
    finally:
        stages.add(name, 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu))
