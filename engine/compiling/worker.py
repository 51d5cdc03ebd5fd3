"""A process that compiles kernels: `python -m farside.engine.compiling.worker` (see `pool`).

It reads a kernel a line, as JSON: module, name, types. It answers each with a line: "compiled", "known" (it was kept
already) or "failed: ...". It ends with its input.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import sys

__all__ = ["compile_kernel", "main"]

# Compiling makes many objects that live until its end: looking through them as often as usual takes 8 % of the time.
_SELDOM = 100_000, 20, 100


def compile_kernel(module: str, name: str, types: str) -> str:
    """Compile a kernel, or load it; tells which it was. module: below `kernels`; name: empty for the module alone."""
    from ..support import runtime  # noqa: F401  # before anything of Numba's is used
    from .signatures import from_text

    found = importlib.import_module(f"..kernels.{module}", __package__)
    if not name:
        return "compiled"
    kernel = getattr(found, name)
    kernel.compile(from_text(types))
    return "known" if sum(kernel.stats.cache_hits.values()) else "compiled"


def main() -> None:
    """Answer until the input ends."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # nothing but answers goes there
    gc.set_threshold(*_SELDOM)
    for line in sys.stdin:
        try:
            answer = compile_kernel(**json.loads(line))
        except Exception as error:  # a boundary: whoever needs the kernel will meet the error
            answer = f"failed: {type(error).__name__}: {error}".split("\n")[0]
        print(answer, file=answers)


if __name__ == "__main__":
    main()
