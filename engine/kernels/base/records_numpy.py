"""`records` by NumPy, where nothing is compiled."""

from __future__ import annotations

import numpy as np

from .live_arrays import bytes_at
from .vectors_numpy import LANES, Floats, Integers, Mask

__all__ = ["gather_records", "load_triples"]


def load_triples(address: int, index: int) -> tuple[Integers, Integers, Integers]:
    """The three int32 of each of sixteen records from address + 12 * index on, field by field."""
    records = bytes_at(address, index, 12, LANES).view(np.int32).reshape(LANES, 3)
    a, b, c = (Integers(field.copy()) for field in records.T)
    return a, b, c


def gather_records(address: int, index: Integers, mask: Mask) -> tuple[Floats, Floats, Floats, Floats]:
    """The four float32 of each lane's record at address + 16 * index, field by field; where the mask is false those of
    record 0, which must exist."""
    numbers = np.where(mask.lanes, index.lanes, 0)
    records = np.array([bytes_at(address, int(number), 16).view(np.float32) for number in numbers])
    a, b, c, d = (Floats(field.copy()) for field in records.T)
    return a, b, c, d
