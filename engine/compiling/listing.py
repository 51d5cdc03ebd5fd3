"""Makes the list of needed kernels anew: records each use in a process of its own, and joins what they compiled."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ..support.cores import core_count
from .needed import USES, Kernel
from .recorder import Compiled

__all__ = ["Recording", "join", "record"]

Recording = tuple[list[Compiled], list[str]]
"""The kernels of one use in the order in which they were compiled, and modules that compile when they are imported."""


def record(uses: Sequence[str] = USES, told: Callable[[str], None] = lambda use: None) -> dict[str, Recording]:
    """What is compiled for each use, from nothing. Twins are always made, as the other uses show them.

    Calls `told` with each use before it. Raises RuntimeError if a use cannot be recorded.
    """
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(core_count()) as pool:

        def one(use: str) -> Recording:
            told(use)
            return _record(use, Path(folder))

        synth = one("synth")
        others = [use for use in uses if use != "synth"]
        found = {"synth": synth, **dict(zip(others, pool.map(one, others), strict=True))}
    return {use: found[use] for use in uses}


def _record(use: str, folder: Path) -> Recording:
    out, kernels = folder / f"{use}.json", folder / f"kernels for {use}"
    kernels.mkdir()
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(kernels)}
    command = [sys.executable, "-m", f"{__package__}.recorder", use, str(folder / "twins"), str(out)]
    ended = subprocess.run(command, env=environment, stderr=subprocess.PIPE, text=True)
    if ended.returncode:
        raise RuntimeError(f"use: {use}: expected to be recorded: {ended.stderr.strip().splitlines()[-1:]}")
    read = json.loads(out.read_text("utf-8"))
    return [Compiled(**each) for each in read["kernels"]], read["modules"]


def join(found: dict[str, Recording]) -> list[Kernel]:
    """One list from the recordings of several uses, each kernel after those that it calls."""
    uses: dict[tuple[str, str, str], list[str]] = {}
    for use, (kernels, modules) in found.items():
        for key in [*((module, "", "") for module in modules), *((k.module, k.name, k.types) for k in kernels)]:
            if use not in uses.setdefault(key, []):
                uses[key].append(use)
    # A kernel that one use compiles late may be needed early by a later one: callees first.
    ordered: dict[tuple[str, str, str], None] = {}

    def put(key: tuple[str, str, str]) -> None:
        if key not in ordered:
            for callee in _callees(key, uses):
                put(callee)
            ordered[key] = None

    for key in uses:
        put(key)
    numbers = {key: number for number, key in enumerate(ordered)}
    return [
        Kernel(*key, after=tuple(sorted(numbers[callee] for callee in _callees(key, uses))), uses=tuple(uses[key]))
        for key in ordered
    ]


def _callees(key: tuple[str, str, str], among: Any) -> list[tuple[str, str, str]]:
    """Kernels, with whatever types, that a kernel's function or one that becomes a part of it mentions."""
    module, name, _ = key
    if not name:
        return []
    called = _called(module, name)
    return [other for other in among if other[:2] in called and other[:2] != (module, name)]


def _called(module: str, name: str) -> set[tuple[str, str]]:
    """Module and name of all kernels that a kernel's function mentions, directly or by way of others."""
    prefix = f"{__package__.removesuffix('.compiling')}.kernels."
    found: set[tuple[str, str]] = set()
    left = [getattr(importlib.import_module(prefix + module), name)]
    while left:
        function = getattr(left.pop(), "py_func", None)
        if function is None:
            continue
        own = (function.__module__.removeprefix(prefix), function.__name__)
        if not function.__module__.startswith(prefix) or own in found:
            continue
        found.add(own)
        left += [function.__globals__.get(used) for used in function.__code__.co_names]
    return found
