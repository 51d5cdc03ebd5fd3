"""Functions of kernels that C calls: compiled, or by ctypes where nothing is compiled (NUMBA_DISABLE_JIT=1).

C knows no exceptions. Compiled callbacks raise none; the others keep the first one for `raise_what_callbacks_did`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numba
from numba import config
from numba.core.typing.ctypes_utils import to_ctypes

from .kernel_cache import keeping

__all__ = ["Callback", "callback", "raise_what_callbacks_did"]

_RAISED: list[BaseException] = []


class Callback(Protocol):
    """A function that C can call."""

    @property
    def address(self) -> int:
        """Where it is, as long as this object lives."""


class _Uncompiled:
    """A function that C calls through ctypes, from any thread."""

    def __init__(self, function: Callable[..., Any], signature: Any) -> None:
        def call(*arguments: int) -> Any:
            try:
                return function(*arguments)
            except BaseException as error:  # whatever it is, a debugger's end among them
                _RAISED.append(error)
                return 0

        kind = ctypes.CFUNCTYPE(to_ctypes(signature.return_type), *map(to_ctypes, signature.args))
        self._called = kind(call)  # C keeps nothing alive
        self.address = int(ctypes.cast(self._called, ctypes.c_void_p).value or 0)


def callback(signature: Any) -> Callable[[Callable[..., Any]], Callback]:
    """A decorator that makes a kernel a callback of a signature (of Numba's types)."""

    def decorate(function: Callable[..., Any]) -> Callback:
        if config.DISABLE_JIT:
            return _Uncompiled(function, signature)
        with keeping(Path(function.__code__.co_filename)) as kept:
            compiled: Callback = numba.cfunc(signature, cache=kept)(function)
        return compiled

    return decorate


def raise_what_callbacks_did() -> None:
    """Raise the first exception of callbacks since the last call; those after it may follow from it."""
    if _RAISED:
        error = _RAISED[0]
        _RAISED.clear()
        raise error
