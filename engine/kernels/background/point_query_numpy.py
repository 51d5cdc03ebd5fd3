"""`point_query` where nothing is compiled: Embree through ctypes."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.callbacks import raise_what_callbacks_did
from .point_query_llvm import CONTEXT_WORDS, INSTANCE_WORDS, QUERY_WORDS, RADIUS
from .ray_hit import ALIGNMENT

__all__ = ["point_query", "read_query", "shrink_query"]

Single = np.floating[Any]


@functools.cache
def _function(address: int) -> Callable[..., bool]:
    function: Callable[..., bool] = ctypes.CFUNCTYPE(ctypes.c_bool, *[ctypes.c_void_p] * 5)(address)
    return function


def _room(words: int) -> Any:
    """Memory of words of four bytes, all zeros, as Embree wants it aligned."""
    memory = np.zeros(words + ALIGNMENT // 4, np.uint32)
    start = -memory.ctypes.data % ALIGNMENT // 4
    return memory[start : start + words]


def point_query(
    function: int, scene: int, callback: int, user: int, x: Single, y: Single, z: Single, radius: Single
) -> Any:
    """rtcPointQuery: searches what is within `radius` of a point; returns the radius that the callback has left.

    `function`, `scene`, `callback` and `user`, which the callback is given, are addresses; the rest is float32. Raises
    what a callback raised meanwhile.
    """
    query, about = _room(QUERY_WORDS), _room(CONTEXT_WORDS)
    numbers = query.view(np.float32)
    numbers[:3], numbers[RADIUS] = (x, y, z), radius
    about[list(INSTANCE_WORDS)] = 0xFFFFFFFF
    _function(int(function))(int(scene), query.ctypes.data, about.ctypes.data, int(callback), int(user))
    raise_what_callbacks_did()
    return numbers[RADIUS]


def _query(address: int) -> Any:
    return (ctypes.c_float * QUERY_WORDS).from_address(int(address))


def read_query(address: int) -> tuple[Any, Any, Any, Any]:
    """x, y, z and radius of an RTCPointQuery."""
    x, y, z, _time, radius, *_rest = map(np.float32, _query(address))
    return x, y, z, radius


def shrink_query(address: int, radius: Single) -> None:
    """Sets the radius (float32) of an RTCPointQuery: from now on only what is nearer counts."""
    _query(address)[RADIUS] = float(radius)
