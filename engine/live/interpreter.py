"""Python where threads must not wait long for one another: turns at the interpreter, and collections of garbage."""

from __future__ import annotations

import gc

__all__ = ["SETTLES_AFTER", "SWITCH_S", "set_aside"]

SWITCH_S = 0.0003  # how long a thread may keep the interpreter while another wants it; Python's default is 5 ms
SETTLES_AFTER = (1, 2, 4, 8, 16)  # frames, after which objects are set aside: by then every kernel has been loaded


def set_aside() -> None:
    """Let no collection look at the objects that there are: a full one would look through all that start-up made, the
    compiler's and its kernels' too, tens of milliseconds with everything else at a stop."""
    gc.collect()
    gc.freeze()
