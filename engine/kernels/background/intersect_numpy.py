"""`intersect` where nothing is compiled: Embree through ctypes."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.callbacks import raise_what_callbacks_did
from .ray_hit import ALIGNMENT, DIR_X, GEOM_ID, INST_ID, INST_PRIM_ID, MASK, ORG_X, PRIM_ID, TFAR, TNEAR, WORDS, U, V

__all__ = ["intersect1"]

Single = np.floating[Any]
_Function = Callable[[int, int, int], None]  # of a scene, an RTCRayHit and a query


@functools.cache
def _function(address: int) -> _Function:
    pointer = ctypes.c_void_p
    function: _Function = ctypes.CFUNCTYPE(None, pointer, pointer, pointer)(address)
    return function


def intersect1(
    function: int,
    scene: int,
    query: int,
    ox: Single, oy: Single, oz: Single,
    dx: Single, dy: Single, dz: Single,
    near: Single,
    far: Single,
) -> tuple[float, float, float, int, int]:  # fmt: skip
    """rtcIntersect1: (distance, u, v, geometry, primitive); the geometry is INVALID_ID where nothing was hit.

    `function`, `scene` and `query` (RTCIntersectArguments or 0) are addresses; origin, direction and the
    interval of distances (in lengths of the direction) are float32. Raises what a callback raised meanwhile.
    """
    memory = np.zeros(WORDS + ALIGNMENT // 4, np.uint32)
    start = -memory.ctypes.data % ALIGNMENT // 4
    words = memory[start : start + WORDS]
    floats = words.view(np.float32)
    floats[ORG_X : ORG_X + 3], floats[DIR_X : DIR_X + 3] = (ox, oy, oz), (dx, dy, dz)
    floats[TNEAR], floats[TFAR] = near, far
    words[[MASK, GEOM_ID, INST_ID, INST_PRIM_ID]] = 0xFFFFFFFF
    _function(int(function))(int(scene), words.ctypes.data, int(query))
    raise_what_callbacks_did()
    # NumPy numbers: what is computed with them is in single precision, too.
    return floats[TFAR], floats[U], floats[V], int(words[GEOM_ID]), int(words[PRIM_ID])
