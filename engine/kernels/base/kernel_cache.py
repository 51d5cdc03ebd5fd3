"""Where compiled kernels are kept from run to run.

Numba notices that a kernel's own file has changed. It does not notice a change of a function in another file that has
become a part of the kernel, its folders hang on the path of the installation, and of two processes that keep kernels of
one function at the same time, one is forgotten. So we keep them ourselves: each kernel, with its types and the CPU, in
a file of its own, in a folder named after the contents of all files that the kernel's file imports, directly or not.
These folders can be moved and copied. They are below the user's cache folder, as an installation is often not writable.
Folders that came with the installation are read, too.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
import os
import pickle
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.serialize import dumps

from ...support.kernel_folders import SHIPPED, base_folder, bases, folder_of, tell_once

__all__ = ["keeping"]

_DIGEST_BYTES = hashlib.sha256().digest_size


@contextlib.contextmanager
def keeping(source: Path) -> Iterator[bool]:
    """While the block runs, Numba's decorators keep the kernels of a file; gives False if they are not kept.

    Other functions of the process that Numba compiles are kept where they were.
    """
    own, shipped = _folders(base_folder(), source)
    if own is None and not shipped:
        yield False
        return
    before = numba.config.CACHE_LOCATOR_CLASSES, caching.IndexDataCacheFile
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.Place"
    caching.IndexDataCacheFile = functools.partial(Kept, own, shipped)
    try:
        yield True
    finally:
        numba.config.CACHE_LOCATOR_CLASSES, caching.IndexDataCacheFile = before


@functools.cache
def _folders(base: Path | None, source: Path) -> tuple[Path | None, list[Path]]:
    """The folder into which kernels of a file are written, if there is one, and folders that are only read: those that
    came with Farside, or that somebody else has filled."""
    name = folder_of(source)
    others = [each / name for each in itertools.takewhile(lambda each: each != base, bases())]
    shipped = [folder for folder in (*others, *SHIPPED.glob(f"*/{name}")) if folder.is_dir()]
    if base is not None:
        with contextlib.suppress(OSError):
            (base / name).mkdir(exist_ok=True)
            os.utime(base / name)  # it is in use
            return base / name, shipped
    return None, shipped


class Place(caching._CacheLocator):  # type: ignore[misc]
    """What Numba asks about the place of a function's kernels; `Kept` knows the rest."""

    def __init__(self, line: int) -> None:
        self._line = line

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Place:
        """Of a function."""
        return cls(py_func.__code__.co_firstlineno)

    def ensure_cache_path(self) -> None:
        """There is one."""

    def get_cache_path(self) -> str:
        """Not used."""
        return ""

    def get_source_stamp(self) -> str:
        """Nothing: the folder is named after the contents of the files."""
        return ""

    def get_disambiguator(self) -> str:
        """Tells functions of one name apart."""
        return str(self._line)


class Kept:
    """The kept kernels of one function."""

    def __init__(
        self, own: Path | None, shipped: list[Path], cache_path: str, filename_base: str, source_stamp: str
    ) -> None:
        self._own, self._name = own, filename_base
        self._folders = [*([own] if own else []), *shipped]

    def _file(self, key: Any) -> str:
        """The name of a kernel's file; key: types, CPU, hashes of the function."""
        return f"{self._name}.{hashlib.sha256(str(key).encode()).hexdigest()[:16]}.nbc"

    def load(self, key: Any) -> Any:
        """A kernel as Numba keeps it, or None: there is none, or it is damaged."""
        for folder in self._folders:
            with contextlib.suppress(OSError):
                whole = (folder / self._file(key)).read_bytes()
                known, data = whole[:_DIGEST_BYTES], whole[_DIGEST_BYTES:]
                if known == _sum_of(key, data):
                    return pickle.loads(data)
        return None

    def save(self, key: Any, data: Any) -> None:
        """Keep a kernel, if that is possible now. Other processes see all of it or nothing."""
        if self._own is None:
            return
        packed = dumps(data)
        try:
            with (
                tempfile.NamedTemporaryFile(dir=self._own, prefix=".", delete=False) as file,
                _gone_after_errors(file.name),
            ):
                file.write(_sum_of(key, packed) + packed)
                file.flush()
                os.chmod(file.name, 0o644)
                os.replace(file.name, self._own / self._file(key))
        except OSError as error:
            tell_once(f"a kernel is not kept: {error}")

    def flush(self) -> None:
        """Forget the kernels of the function."""
        for path in self._own.glob(f"{self._name}.*.nbc") if self._own else ():
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def _gone_after_errors(path: str) -> Iterator[None]:
    try:
        yield
    except BaseException:
        os.unlink(path)
        raise


def _sum_of(key: Any, data: bytes) -> bytes:
    return hashlib.sha256(str(key).encode() + b"\0" + data).digest()
