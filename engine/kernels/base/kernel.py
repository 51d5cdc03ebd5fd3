"""Kernels, as Numba compiles and calls them."""

from __future__ import annotations

from typing import Any

import numba.core.types as _types
from numba.core.dispatcher import Dispatcher

__all__ = ["Kernel"]

types: Any = _types  # its stubs know only a part of it


class Kernel(Dispatcher):
    """A kernel that is compiled once for all values of an argument.

    Numba compiles a kernel anew for each constant that another kernel calls it with. LLVM does so where it is of use.
    """

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """How another kernel calls it with arguments of these types."""
        named = {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(types.unliteral(kind) for kind in args), named)
