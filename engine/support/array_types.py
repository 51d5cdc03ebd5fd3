"""Short names of array types, for annotations of kernels and their callers; a comment or docstring gives shapes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["B1", "F32", "F64", "I32", "I64", "U8", "U16", "U64"]

B1 = npt.NDArray[np.bool_]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
U64 = npt.NDArray[np.uint64]
