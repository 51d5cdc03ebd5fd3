"""Kernels also run without a compiler (NUMBA_DISABLE_JIT=1): results are the same, and addresses are checked."""

from __future__ import annotations

import ast
import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from farside.engine.geometry.embree import intersect_address
from farside.engine.kernels.background import intersect_llvm, intersect_numpy
from farside.engine.kernels.base import (
    callbacks,
    lanes_numpy,
    live_arrays,
    memory,
    memory_numpy,
    memory_scalars_llvm,
    simd_numpy,
)
from numba import types
from support import uncompiled_background, uncompiled_cases
from support.rooms import camera_row

KERNELS = Path(live_arrays.__file__).parents[1]
TESTS = Path(uncompiled_cases.__file__).parents[1]


@pytest.fixture(scope="module")
def uncompiled(tmp_path_factory):
    """Arrays of all cases run without a compiler, and the kernel files of which any function ran."""
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
        # Compiled code rounds some sums of products only once, so that another surface wins in a few pixels.
        same = np.isclose(found.astype(float), expected.astype(float), rtol=1e-4, atol=1e-3, equal_nan=True)
        assert same.mean() >= 0.995, (name, same.mean())


def test_every_file_of_kernels_has_run(uncompiled):
    ran = set(uncompiled["modules"].tolist())
    sources = [path for path in KERNELS.rglob("*.py") if "def " in path.read_text()]
    files = {str(path.relative_to(KERNELS))[: -len(".py")] for path in sources}
    at_import = {"jit", "kernel", "kernel_cache", "outline", "private", "share"}  # these run at import only
    files -= {f"base/{name}" for name in at_import}
    wanted = {name for name in files if not name.endswith("_llvm")}
    assert len(wanted) > 60
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


def test_single_numbers_are_read_and_written_within_their_array():
    words = np.arange(6, dtype=np.uint64)
    words[2] = 2**63 + 5
    address = live_arrays.address_of(words)
    assert memory_numpy.load_u64(address, 2) == 2**63 + 5
    assert memory_numpy.load_u32(address, 5) == 2**31
    assert memory_numpy.load_eight_u8(address, 9) == int.from_bytes(words.tobytes()[9:17], "little", signed=True)
    memory_numpy.or_u64(address, 2, 2**62 | 2)
    assert words[2] == 2**63 + 2**62 + 7
    memory_numpy.add_i64_atomically(address, 3, -10)
    assert words.view(np.int64)[3] == -7
    for beyond in (memory_numpy.load_u64, memory_numpy.load_i64):
        with pytest.raises(IndexError, match=r"uint64 \[6\].*index 6 of 8 bytes"):
            beyond(address, 6)
    with pytest.raises(IndexError, match="index -1 of 8 bytes"):
        memory_numpy.or_u64(address, -1, 1)
    with pytest.raises(IndexError, match="index 41 of 1 bytes each from byte 0 on, 8 of them"):
        memory_numpy.load_eight_u8(address, 41)
    np.testing.assert_array_equal(words[[0, 1, 4, 5]], [0, 1, 4, 5])


def test_compiled_code_reads_and_writes_the_same_single_numbers():
    llvm = memory_scalars_llvm
    words = np.array([3, 2**63 + 2**40 + 5, 7, 9], np.uint64)
    numbers, written = np.float32([0.5, -1.25, 3.0]), np.zeros(3, np.int32)

    @numba.njit  # compiled anew each time: what is cached says nothing of the code that makes it
    def read(address, floats):
        return (
            llvm.load_u8(address, 9), llvm.load_u16(address, 6), llvm.load_u32(address, 3), llvm.load_u64(address, 1),
            llvm.load_i64(address, 1), llvm.load_eight_u8(address, 3), llvm.load_f32(floats, 1),
            llvm.load_foreign_u32(address, 3), llvm.load_foreign_i64(address, 1),
        )  # fmt: skip

    @numba.njit
    def write(address, integers):
        llvm.or_u64(address, 2, numba.uint64(2**62 | 8))
        llvm.add_i64_atomically(address, 3, -10)
        llvm.store_foreign_i32(integers, 1, numba.int32(-4))

    address, floats = live_arrays.address_of(words), live_arrays.address_of(numbers)
    twin = memory_numpy
    assert read(address, floats) == (
        twin.load_u8(address, 9), twin.load_u16(address, 6), twin.load_u32(address, 3), twin.load_u64(address, 1),
        twin.load_i64(address, 1), twin.load_eight_u8(address, 3), twin.load_f32(floats, 1),
        twin.load_foreign_u32(address, 3), twin.load_foreign_i64(address, 1),
    )  # fmt: skip
    write(address, written.ctypes.data)
    assert words[:3].tolist() == [3, 2**63 + 2**40 + 5, 2**62 + 15]
    assert words.view(np.int64)[3] == -1
    assert written.tolist() == [0, -4, 0]


def test_only_callbacks_reach_memory_that_is_of_no_array():
    foreign = {name for name in memory.__all__ if "foreign" in name}
    assert len(foreign) == 3
    users = set()
    for path in KERNELS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and foreign & {alias.name for alias in node.names}:
                users.add(str(path.relative_to(KERNELS)))
    assert users == {"base/memory.py", "background/embree_callbacks.py", "background/point_callbacks.py"}


def test_what_a_callback_raises_is_raised_where_c_was_called():
    def refuse(number: int) -> None:
        raise IndexError(f"refused {number}")

    made = callbacks._Uncompiled(refuse, types.void(types.intp))
    call = ctypes.CFUNCTYPE(None, ctypes.c_ssize_t)(made.address)
    callbacks.raise_what_callbacks_did()
    call(7)
    call(8)
    with pytest.raises(IndexError, match="refused 7"):
        callbacks.raise_what_callbacks_did()
    callbacks.raise_what_callbacks_did()


def test_a_ray_through_ctypes_is_the_compiled_one():
    camera = camera_row(1)[0]
    tracer, (near, _far) = uncompiled_background.tracer_of(
        uncompiled_background.sheet(2.0, 1.0, 4, camera), uncompiled_background.sheet(3.0, 2.0, 5, camera)
    )
    near.invalid[::3] = 1

    @numba.njit
    def compiled(*arguments):
        return intersect_llvm.intersect1(*arguments)

    rng, geometries = np.random.default_rng(0), set()
    for direction in np.float32([1.0, 0.0, 0.0]) + rng.uniform(-1, 1, (300, 3)).astype(np.float32):
        ray = (*np.float32([0.1, 0.2, -0.1]), *direction, np.float32(0.0), np.float32(100.0))
        arguments = (intersect_address(), tracer.packed.scene, 0, *ray)
        expected, found = compiled(*arguments), intersect_numpy.intersect1(*arguments)
        geometries.add(found[3])
        assert found[3] == expected[3]
        if found[3] < 2:  # else the rest is what the memory held before
            assert found == expected
    assert geometries == {0, 1, 0xFFFFFFFF}
