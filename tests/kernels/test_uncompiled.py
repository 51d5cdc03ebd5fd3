"""Kernels run without a compiler, too (NUMBA_DISABLE_JIT=1): they come to the same, and addresses are checked."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from farside.engine.kernels.base import lanes_numpy, live_arrays, memory_numpy, simd_numpy
from support import uncompiled_cases

KERNELS = Path(live_arrays.__file__).parents[1]
TESTS = Path(uncompiled_cases.__file__).parents[1]
# What cannot run so: Embree is called, and calls back, by code of LLVM's.
COMPILED_ONLY = ("background/", "evaluation/leaks", "base/callbacks")


@pytest.fixture(scope="module")
def uncompiled(tmp_path_factory):
    """Arrays of all cases, and the files of kernels of which something ran, without a compiler."""
    path = tmp_path_factory.mktemp("uncompiled") / "arrays.npz"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(TESTS)}
    subprocess.run([sys.executable, "-m", "support.uncompiled_cases", path], check=True, env=environment)
    with np.load(path) as arrays:
        return dict(arrays)


@pytest.fixture(scope="module")
def compiled():
    return uncompiled_cases.run()


@pytest.mark.parametrize("case", [case.__name__ for case in uncompiled_cases.CASES])
def test_kernels_come_to_the_same_without_a_compiler(case, compiled, uncompiled):
    names = [name for name in compiled if name.startswith(f"{case}: ")]
    assert names
    for name in names:
        found, expected = uncompiled[name], compiled[name]
        assert found.shape == expected.shape, name
        assert found.dtype == expected.dtype, name
        # Compiled code rounds some sums of products once instead of twice: in a few pixels another surface wins by it.
        same = np.isclose(found.astype(float), expected.astype(float), rtol=1e-4, atol=1e-3, equal_nan=True)
        assert same.mean() >= 0.995, (name, same.mean())


def test_every_file_of_kernels_has_run(uncompiled):
    ran = set(uncompiled["modules"].tolist())
    sources = [path for path in KERNELS.rglob("*.py") if "def " in path.read_text()]
    files = {str(path.relative_to(KERNELS))[: -len(".py")] for path in sources} - {"base/jit"}  # runs at import only
    wanted = {name for name in files if not name.startswith(COMPILED_ONLY) and not name.endswith("_llvm")}
    assert len(wanted) > 40
    assert wanted - ran == set()


def test_what_lies_beyond_an_array_is_refused_by_name_and_index():
    codes = np.empty((5, 7), np.uint16)
    codes.ravel()[:] = np.arange(35)
    address = codes.ctypes.data
    assert memory_numpy.load_u16(address, 34) == 34
    with pytest.raises(IndexError, match=r"codes in test_what_lies.*uint16 \[5, 7\].*index 35 of 2 bytes"):
        memory_numpy.load_u16(address, 35)
    with pytest.raises(IndexError, match="index -1 of 2 bytes"):
        memory_numpy.load_u16(address, -1)
    everywhere, first = simd_numpy.Mask(np.ones(16, bool)), simd_numpy.Mask(np.arange(16) == 0)
    index = simd_numpy.to_integers(simd_numpy.lane_numbers() + 20.0)
    with pytest.raises(IndexError, match="index 34 of 2 bytes each from byte 0 on, 2 of them"):
        memory_numpy.gather_halves(address, index, everywhere)
    assert memory_numpy.gather_halves(address, index, first).lanes[0] == 20 | 21 << 16
    with pytest.raises(IndexError, match="beyond"):
        lanes_numpy.codes_there(address)


def test_an_array_that_is_gone_is_refused():
    def used() -> int:
        array = np.zeros(9, np.int64)
        assert memory_numpy.load_i64(array.ctypes.data, 8) == 0
        return int(array.ctypes.data)

    address = used()
    with pytest.raises(IndexError, match="in no array that is alive"):
        memory_numpy.load_i64(address, 0)
