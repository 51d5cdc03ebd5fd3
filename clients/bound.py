"""`python -m farside.clients.bound PARENT MODULE ...`: run a module in a process that ends when its parent does.

It also does if the parent is killed and this one stands still. PARENT: the process id of the parent.
"""

from __future__ import annotations

import ctypes
import os
import runpy
import signal
import sys

__all__ = ["end_with_parent"]

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def end_with_parent(parent: int) -> None:
    """From now on the kernel kills this process when the thread that started it ends; on Linux only.

    parent: the process id that it had; if it has another parent already, this process ends at once.
    """
    if prctl := getattr(ctypes.CDLL(None), "prctl", None):
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


if __name__ == "__main__":
    end_with_parent(int(sys.argv[1]))
    sys.argv = sys.argv[2:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
