"""Memory that ends where an array ends: a process that reads or writes a byte beyond it is killed at once.

Kernels access planes by address, and an index that is off by one reads whatever happens to be there: mostly other
pictures, sometimes no memory, and then the process dies. `guarded` puts an array between two forbidden pages, so that
any such access is a fault, and `guarding` does it for whole pipelines:

- what the engine's modules allocate through `np` (codes, cuts, levels, canvases, maximum depth images, ...) is guarded:
  kernels reach these arrays through tables of addresses;
- every array that is handed to a compiled kernel is replaced by a guarded copy for the length of the call.

A fault kills the process. Cases run in a child process (`guard_cases`), which is sent the name of each case first.
Memory that kernels allocate for themselves (rooms, rows, scratch) is not guarded.
"""

from __future__ import annotations

import ast
import ctypes
import mmap
import sys
import types
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from farside.engine.kernels.base.memory import BEYOND
from numba.core.dispatcher import Dispatcher

__all__ = ["FLUSHES", "guarded", "guarding", "kernels_of_engine"]

FLUSHES = ("start", "end")  # which end of an array borders on a page that may not be touched
_PAGE = mmap.PAGESIZE
_KERNELS = "farside.engine.kernels."
_MAKERS = (
    "arange", "array", "ascontiguousarray", "concatenate", "empty", "empty_like", "full", "full_like", "linspace",
    "ones", "ones_like", "repeat", "stack", "tile", "where", "zeros", "zeros_like",
)  # fmt: skip
# The service, evaluation and twins are left out: they read planes by address only through these modules.
_TILES: dict[int, weakref.ref[np.ndarray]] = {}  # arrays of `tiles.new_tiles`, by id
_APART = ("farside.engine.evaluation", "farside.engine.synth", "farside.engine.kernels")


def guarded(array: np.ndarray, flush: str = "end") -> np.ndarray:
    """A C-contiguous array of the same content, next to a page that must not be touched.

    flush: "end": the page comes right behind the last byte; "start": it ends right before the first one. The other end
    is up to a page away from such a page, too. The memory is given back when the array and its views are dropped.
    """
    if flush not in FLUSHES:
        raise ValueError(f"flush: {flush!r}: expected one of {', '.join(FLUSHES)}")
    if array.nbytes == 0:
        return np.array(array, order="C")
    length = -(-array.nbytes // _PAGE) * _PAGE
    region = mmap.mmap(-1, length + 2 * _PAGE)
    whole = np.frombuffer(region, np.uint8)  # keeps the region
    for page in (0, _PAGE + length):
        _forbid(whole.ctypes.data + page)
    first = _PAGE if flush == "start" else _PAGE + length - array.nbytes
    out = whole[first : first + array.nbytes].view(array.dtype).reshape(array.shape)
    out[...] = array
    return out


_mprotect = ctypes.CDLL(None, use_errno=True).mprotect
_mprotect.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)


def _forbid(address: int) -> None:
    if _mprotect(address, _PAGE, 0):  # PROT_NONE
        raise OSError(ctypes.get_errno(), "mprotect")


class _Numpy:
    """NumPy whose new arrays are guarded."""

    def __init__(self, flush: str) -> None:
        self._flush = flush
        for name in _MAKERS:
            setattr(self, name, self._maker(getattr(np, name)))

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    def _maker(self, make: Callable[..., Any]) -> Callable[..., Any]:
        def made(*arguments: Any, **options: Any) -> Any:
            array = make(*arguments, **options)
            given = any(array is argument for argument in arguments)  # `ascontiguousarray` may copy nothing
            plain = isinstance(array, np.ndarray) and array.ndim > 0 and not array.dtype.hasobject
            return guarded(array, self._flush) if plain and not given and array.flags.c_contiguous else array

        return made


class _Kernel:
    """A compiled kernel that is given guarded copies of its arrays."""

    def __init__(self, kernel: Dispatcher, flush: str, called: set[str]) -> None:
        self._kernel, self._flush, self._called = kernel, flush, called

    def __call__(self, *arguments: Any) -> Any:
        self._called.add(_name(self._kernel))
        copies: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        result = self._kernel(*[self._placed(argument, copies) for argument in arguments])
        for given, copy in copies.values():
            if given.flags.writeable and given.nbytes and not _same(given, copy):
                given[...] = copy
        return result

    def _placed(self, argument: Any, copies: dict[int, tuple[np.ndarray, np.ndarray]]) -> Any:
        if isinstance(argument, tuple):
            parts = [self._placed(part, copies) for part in argument]
            return type(argument)(*parts) if hasattr(argument, "_fields") else tuple(parts)
        if not (isinstance(argument, np.ndarray) and argument.flags.c_contiguous):
            return argument
        if id(argument) not in copies:
            copies[id(argument)] = argument, _copy(argument, self._flush)
        return copies[id(argument)][1]


def _copy(array: np.ndarray, flush: str) -> np.ndarray:
    known = _TILES.get(id(array))
    if known is None or known() is not array:
        return guarded(array, flush)
    # Tiles have a few extra bytes at the end, which kernels may read (`tiles.new_tiles`).
    room = guarded(np.zeros(array.size + BEYOND, np.uint8), flush)
    room[: array.size] = array.ravel()
    return room[: array.size].reshape(array.shape)


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.array_equal(a.view(np.uint8).ravel(), b.view(np.uint8).ravel())) if a.ndim else bool(a == b)


def _name(kernel: Dispatcher) -> str:
    function = kernel.py_func
    return f"{function.__module__.removeprefix(_KERNELS)}.{function.__name__}"


def _modules() -> Iterator[types.ModuleType]:
    for name, module in sorted(sys.modules.items()):
        if name.startswith("farside.engine.") and not name.startswith(_APART):
            yield module


def _is_module(value: Any) -> bool:
    return isinstance(value, types.ModuleType)


def _is_kernels(value: Any) -> bool:
    return _is_module(value) and value.__name__.startswith(_KERNELS)


def kernels_of_engine() -> set[str]:
    """Names (module.function) of all compiled kernels that modules of the engine, as far as imported, can call."""
    found = set()
    for module in _modules():
        for value in list(vars(module).values()):
            parts = value if isinstance(value, tuple) else [value]
            found |= {_name(part) for part in parts if isinstance(part, Dispatcher)}
    return found | _reached_through_modules()


def _reached_through_modules() -> set[str]:
    """Kernels that an engine's module names as `kernels.function`."""
    found = set()
    for module in _modules():
        names = _attributes_of(module)
        for label, value in vars(module).items():
            if _is_kernels(value):
                for name in names.get(label, ()):
                    part = getattr(value, name, None)
                    found |= {_name(part)} if isinstance(part, Dispatcher) else set()
    return found


def _attributes_of(module: types.ModuleType) -> dict[str, set[str]]:
    """Which attributes of which names a module's source mentions."""
    found: dict[str, set[str]] = {}
    with open(str(module.__file__), encoding="utf-8") as file:
        for node in ast.walk(ast.parse(file.read())):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                found.setdefault(node.value.id, set()).add(node.attr)
    return found


@contextmanager
def guarding(flush: str, called: set[str]) -> Iterator[None]:
    """Guard the engine's arrays and the arguments of its kernels; names of called kernels are added to `called`.

    All modules that are to be guarded must have been imported.
    """
    numpy = _Numpy(flush)
    replaced: list[tuple[types.ModuleType, str, Any]] = []

    def wrapped(value: Any) -> Any:
        if value is np:
            return numpy
        if isinstance(value, Dispatcher):
            return _Kernel(value, flush, called)
        if _is_kernels(value):
            parts = vars(value).items()
            return types.SimpleNamespace(**{name: wrapped(part) for name, part in parts if not _is_module(part)})
        if isinstance(value, tuple) and any(isinstance(part, Dispatcher) for part in value):
            parts = [wrapped(part) for part in value]
            return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
        return value

    try:
        for module in _modules():
            for name, value in list(vars(module).items()):
                if (other := wrapped(value)) is not value:
                    replaced.append((module, name, value))
                    setattr(module, name, other)
        with _known_arrays(flush):
            yield
    finally:
        for module, name, value in replaced:
            setattr(module, name, value)


@contextmanager
def _known_arrays(flush: str) -> Iterator[None]:
    """Guard the flags that triangulators copy, and record which arrays are tiles."""
    from farside.engine.geometry.triangulator import Triangulator
    from farside.engine.rendering import tiles, warping

    triangulate, new_tiles = Triangulator.triangulate, tiles.new_tiles

    def guarded_cuts(self: Any, *arguments: Any, **options: Any) -> Any:
        mesh, cuts = triangulate(self, *arguments, **options)
        self._flags = guarded(cuts, flush)  # it knows its rims by these
        return mesh, self._flags

    def noted(height: int, width: int) -> np.ndarray:
        made = new_tiles(height, width)
        _TILES[id(made)] = weakref.ref(made)
        return made

    Triangulator.triangulate = guarded_cuts  # type: ignore[method-assign]
    tiles.new_tiles = warping.new_tiles = noted
    try:
        yield
    finally:
        Triangulator.triangulate = triangulate  # type: ignore[method-assign]
        tiles.new_tiles = warping.new_tiles = new_tiles
        _TILES.clear()
