"""Compiled kernels over plain arrays and scalars; they hold no state and import nothing of ours.

Importing one of them sets up Numba's threading layer first, once for all.
"""

from ..support import runtime as _runtime  # noqa: F401 (the threading layer, before the first parallel kernel)
