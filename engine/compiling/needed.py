"""Which kernels are needed for what, as recorded in `needed.json`, in the order of their need.

The file lists kernels with the types for which they are compiled, after those that they call. `farside bench compile
--record` writes it anew; a test compares it with what a run needs.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

__all__ = ["NEEDED", "USES", "Kernel", "needed_for", "read", "write"]

NEEDED = Path(__file__).with_name("needed.json")
USES = ("synth", "picture", "fast", "balanced", "best", "paper", "effects", "seed", "beyond")
"""What kernels are needed for: making twins; a picture without a background model; each quality; 3D effects; a model
that begins with an earlier one; one that goes past the paper's limits (`Settings.beyond`)."""


@dataclass(frozen=True, slots=True)
class Kernel:
    """A kernel with the types of its arguments (`signatures`). module: below the engine's `kernels`.

    A kernel without a name stands for what its module compiles when it is imported. after: numbers, in the list, of
    those that it calls. uses: of USES.
    """

    module: str
    name: str
    types: str
    after: tuple[int, ...]
    uses: tuple[str, ...]


@functools.cache
def read(path: Path = NEEDED) -> tuple[Kernel, ...]:
    """All kernels of a list."""
    rows = json.loads(path.read_text("utf-8"))
    return tuple(Kernel(**{**row, "after": tuple(row["after"]), "uses": tuple(row["uses"])}) for row in rows)


def write(kernels: Sequence[Kernel], path: Path = NEEDED) -> None:
    """Write a list: a kernel a line."""
    path.write_text("[\n" + ",\n".join(json.dumps(asdict(kernel)) for kernel in kernels) + "\n]\n", "utf-8")


def needed_for(uses: Iterable[str]) -> list[int]:
    """Numbers of the kernels for some uses: all of the first one, then what is missing for the next, and so on.

    Raises ValueError for an unknown use.
    """
    found: dict[int, None] = {}
    for use in uses:
        if use not in USES:
            raise ValueError(f"use: {use!r}: expected one of {', '.join(USES)}")
        found |= {number: None for number, kernel in enumerate(read()) if use in kernel.uses}
    return list(found)
