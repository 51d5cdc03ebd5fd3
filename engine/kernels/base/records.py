"""Records of a few numbers each, as sixteen lanes need them: field by field.

The numbers of a record lie together, so that one load a record, and a transposition in registers, do what otherwise
takes a gather for each field. A gather of sixteen takes a processor longer than sixteen loads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import config

__all__ = ["gather_records", "load_triples"]

if TYPE_CHECKING or config.DISABLE_JIT:
    from .records_numpy import gather_records, load_triples
else:
    from .records_llvm import gather_records, load_triples
