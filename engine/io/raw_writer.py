"""Raw planar video files that grow plane by plane."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

__all__ = ["RawWriter"]


class RawWriter:
    """Writes several files; each is made, or begun anew, when its first plane is appended.

    Errors of the file system are raised as OSError with the file's name.
    """

    def __init__(self) -> None:
        self._files: dict[Path, BinaryIO] = {}

    def append(self, path: Path, planes: Iterable[npt.NDArray[Any]]) -> None:
        """Append planes, each as it is in memory, row by row. From then on others can read them."""
        with _named(path):
            if path not in self._files:
                path.parent.mkdir(exist_ok=True)
                self._files[path] = path.open("wb")
            for plane in planes:
                self._files[path].write(np.ascontiguousarray(plane).data)
            self._files[path].flush()

    def close(self) -> None:
        """Close all files; raises OSError if the end of one cannot be written, after the others have been closed."""
        with contextlib.ExitStack() as closing:
            for path, file in self._files.items():
                closing.enter_context(_named(path))
                closing.callback(file.close)
        self._files.clear()


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.filename is None:
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
