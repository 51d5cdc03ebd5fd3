"""The arrays and scalars in records, so that states can be compared."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

__all__ = ["leaves"]


def leaves(record: Any, name: str = "state") -> Iterator[tuple[str, Any]]:
    """Arrays and scalars of a state, by their path in it."""
    if dataclasses.is_dataclass(record):
        for field in dataclasses.fields(record):
            yield from leaves(getattr(record, field.name), f"{name}.{field.name}")
    elif isinstance(record, tuple):
        yield f"{name}.length", len(record)
        for number, item in enumerate(record):
            yield from leaves(item, f"{name}[{number}]")
    else:
        yield name, record
