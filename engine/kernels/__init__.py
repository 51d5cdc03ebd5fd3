"""Compiled kernels over plain arrays and scalars; they hold no state and import no other room than `support`.

Importing any of them first sets up Numba's threading layer.
"""

from ..support import runtime as _runtime  # noqa: F401 (the threading layer, before the first parallel kernel)
