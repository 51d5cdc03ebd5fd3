"""Ray casts from compiled code into Embree, and raw memory that its callbacks and shared buffers need.

Library functions and buffers come as addresses (int64 scalars and tables), because a ctypes function pointer
as a global would keep Numba from caching the kernels.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ...support.array_types import F64
from ...support.packed import POSITION
from ..base.jit import inlined, serial
from ..base.memory_llvm import load_as, store_as
from ..base.project import position, unproject_point
from .lines import along, from_camera

__all__ = [
    "BESIDE_PX",
    "INVALID_ID",
    "ROUNDING",
    "Tracer",
    "distance_to_exit",
    "farthest_hit",
    "intersect1",
    "is_free",
    "is_seen_from",
    "load_f32",
    "load_i64",
    "load_u16",
    "load_u32",
    "mark_and_pass",
    "or_u64",
    "outside_ray",
    "skip_invalid",
]


INVALID_ID = 0xFFFFFFFF  # RTC_INVALID_GEOMETRY_ID
ROUNDING = 1e-4  # share of a distance that float32 rays may be off by
# Embree keeps rays from leaking through sides, but of those through the very corner where triangles meet one in
# thousands slips by all of them. Corners are centres of pixels, and so are rays: what hits nothing is asked again a
# little beside.
BESIDE_PX = 1.0 / 32

_I8, _I32, _I64, _F32 = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.FloatType()
# RTCRayHit of Embree 4: ray (48 bytes) then hit (Ng, u, v, primID, geomID, instID[1], instPrimID[1], padding).
_RAY_HIT_WORDS, _TFAR, _MASK = 24, 8, 9
_U, _V, _PRIM_ID, _GEOM_ID, _INST_ID, _INST_PRIM_ID = 15, 16, 17, 18, 19, 20


def _loader(numba_type: Any, llvm_type: Any) -> Any:
    @intrinsic
    def load(typing: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return load_as(builder, arguments[0], llvm_type, 1)

        return numba_type(types.int64), codegen

    return load


_load_u8 = _loader(types.uint8, _I8)
load_u16 = _loader(types.uint16, ir.IntType(16))
load_u32 = _loader(types.uint32, _I32)
load_i64 = _loader(types.int64, _I64)
load_f32 = _loader(types.float32, _F32)


@intrinsic
def _store_i32(typing: Any, address: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        store_as(builder, arguments[1], arguments[0])
        return context.get_dummy_value()

    return types.void(types.int64, types.int32), codegen


@intrinsic
def or_u64(typing: Any, address: Any, bits: Any) -> Any:
    """Sets bits of the uint64 at an address; threads that set the same bits do not disturb one another."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        store_as(builder, builder.or_(load_as(builder, arguments[0], _I64), arguments[1]), arguments[0])
        return context.get_dummy_value()

    return types.void(types.int64, types.uint64), codegen


@intrinsic
def intersect1(
    typing: Any,
    function: Any,
    scene: Any,
    query: Any,
    ox: Any, oy: Any, oz: Any,
    dx: Any, dy: Any, dz: Any,
    near: Any,
    far: Any,
) -> Any:  # fmt: skip
    """rtcIntersect1: (distance, u, v, geometry, primitive); the geometry is INVALID_ID where nothing was hit.

    `function`, `scene` and `query` (RTCIntersectArguments or 0) are addresses; origin, direction and the
    interval of distances (in lengths of the direction) are float32.
    """
    f32, u32, i64 = types.float32, types.uint32, types.int64
    result = types.Tuple((f32, f32, f32, u32, u32))

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        fn, scene_, query_, *numbers = arguments
        block = ir.ArrayType(_I32, _RAY_HIT_WORDS)
        memory = cgutils.alloca_once(builder, block)
        memory.align = 16
        words = builder.inttoptr(builder.ptrtoint(memory, _I64), ir.PointerType())  # a cast would keep the array's type

        def word(index: int) -> Any:
            return builder.gep(words, [_I32(index)], source_etype=_I32)

        ox_, oy_, oz_, dx_, dy_, dz_, near_, far_ = numbers
        ray = (ox_, oy_, oz_, near_, dx_, dy_, dz_, _F32(0.0), far_)
        for index, value in enumerate(ray):
            builder.store(value, word(index))
        for index, constant in ((_MASK, -1), (10, 0), (11, 0)):
            builder.store(_I32(constant), word(index))
        for index in (_GEOM_ID, _INST_ID, _INST_PRIM_ID):
            builder.store(_I32(-1), word(index))
        signature_ = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t] * 3)
        builder.call(
            builder.inttoptr(fn, signature_.as_pointer()),
            [
                builder.inttoptr(scene_, cgutils.voidptr_t),
                builder.bitcast(memory, cgutils.voidptr_t),
                builder.inttoptr(query_, cgutils.voidptr_t),
            ],
        )
        values = [builder.load(word(i), typ=_F32) for i in (_TFAR, _U, _V)]
        values += [builder.load(word(i), typ=_I32) for i in (_GEOM_ID, _PRIM_ID)]
        return context.make_tuple(builder, result, values)

    return result(i64, i64, i64, *([f32] * 8)), codegen


class Tracer(NamedTuple):
    """A ray tracer's scene, as kernels take it.

    intersect, occluded: addresses of rtcIntersect1 and rtcOccluded1; scene: the address of a committed scene. bounds:
    [2, 3], a box that holds the scene with some room, metres, relative to the scene origin: rays from outside start on
    it.
    """

    intersect: int
    occluded: int
    scene: int
    bounds: F64


@inlined
def is_free(
    tracer: Tracer, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, far: float
) -> bool:
    """Whether a ray meets nothing up to `far` (in lengths of its direction). Where it does, the first thing that is
    found ends the search, wherever on the ray (an any-hit ray)."""
    # RTCRayHit starts with the RTCRay that rtcOccluded1 takes; where something is hit, it sets tfar to -inf.
    left, _u, _v, _geometry, _primitive = intersect1(
        tracer.occluded, tracer.scene, 0, np.float32(ox), np.float32(oy), np.float32(oz), np.float32(dx),
        np.float32(dy), np.float32(dz), np.float32(0.0), np.float32(far),
    )  # fmt: skip
    return left >= np.float32(0.0)


@inlined
def is_seen_from(tracer: Tracer, camera: F64, dx: float, dy: float, dz: float, far: float) -> bool:
    """Whether nothing stands between a camera (packed) and `far` times a direction from it."""
    ox, oy, oz = position(camera)
    return is_free(tracer, ox, oy, oz, dx, dy, dz, far)


# Filter callbacks get RTCFilterFunctionNArguments: valid, geometryUserPtr, context, ray, hit, N. With
# rtcIntersect1, N is 1 and the hit's words are Ng x 3, u, v, primID, geomID.


@numba.cfunc(types.void(types.intp), cache=True)
def skip_invalid(arguments: int) -> None:
    """Intersect filter of a geometry whose user data is a uint8 flag a triangle: flagged ones are not there."""
    primitive = load_u32(load_i64(arguments + 32) + 20)
    if _load_u8(load_i64(arguments + 8) + numba.int64(primitive)):
        _store_i32(load_i64(arguments), numba.int32(0))


@numba.cfunc(types.void(types.intp), cache=True)
def mark_and_pass(arguments: int) -> None:
    """Intersect filter of a query: marks every triangle on the ray's interval, and lets the ray go on.

    The query's context is followed (at byte 16) by the address of a table with, per geometry, the address of
    its marks (uint64) and their stride in bytes; then the byte offset of the word and the bits to set.
    """
    context, hit = load_i64(arguments + 16), load_i64(arguments + 32)
    primitive, geometry = numba.int64(load_u32(hit + 20)), numba.int64(load_u32(hit + 24))
    entry = load_i64(context + 16) + 16 * geometry
    address = load_i64(entry) + primitive * load_i64(entry + 8) + load_i64(context + 24)
    or_u64(address, numba.uint64(load_i64(context + 32)))
    _store_i32(load_i64(arguments), numba.int32(0))


@inlined
def distance_to_exit(bounds: F64, camera: F64, dx: float, dy: float, dz: float) -> float:
    """How far a ray from a camera (packed) goes until it has left a box [2, 3] for good; negative where it never meets
    it again."""
    far = math.inf
    for axis, step in ((0, dx), (1, dy), (2, dz)):
        if step > 0.0:
            far = min(far, (bounds[1, axis] - camera[POSITION + axis]) / step)
        elif step < 0.0:
            far = min(far, (bounds[0, axis] - camera[POSITION + axis]) / step)
    return far


@inlined
def outside_ray(
    camera: F64, bounds: F64, u: float, v: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """The ray from outside the scene's bounds toward a camera, through (u, v) of its picture.

    Origin (3), unit direction (3), distance to the camera (<= 0: the ray misses the scene), and the distance from the
    camera that a depth of 1 makes.
    """
    x, y, z = unproject_point(camera, u, v, 1.0)
    dx, dy, dz = from_camera(camera, x, y, z)
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    far = distance_to_exit(bounds, camera, dx, dy, dz)
    x, y, z = along(camera, far, dx, dy, dz)
    return x, y, z, -dx, -dy, -dz, far, length


@inlined
def farthest_hit(tracer: Tracer, camera: F64, u: float, v: float) -> tuple[float, float, float, int, int, float]:
    """What lies farthest behind (u, v) of a camera: distance from the camera, barycentric u and v, geometry,
    primitive, and the distance that a depth of 1 makes. The distance is negative where nothing is hit, nor beside."""
    hit = _farthest_along(tracer, camera, u, v)
    if hit[0] < 0.0:
        hit = _farthest_along(tracer, camera, u + BESIDE_PX, v - BESIDE_PX)
    return hit


@serial
def _farthest_along(tracer: Tracer, camera: F64, u: float, v: float) -> tuple[float, float, float, int, int, float]:
    """`farthest_hit` by a single ray."""
    x, y, z, dx, dy, dz, far, length = outside_ray(camera, tracer.bounds, u, v)
    if not far > 0.0:
        return -1.0, 0.0, 0.0, -1, -1, length
    t, hu, hv, geometry, primitive = intersect1(
        tracer.intersect, tracer.scene, 0, np.float32(x), np.float32(y), np.float32(z),
        np.float32(dx), np.float32(dy), np.float32(dz), np.float32(0.0), np.float32(far),
    )  # fmt: skip
    if geometry == INVALID_ID:
        return -1.0, 0.0, 0.0, -1, -1, length
    return far - t, hu, hv, numba.int64(geometry), numba.int64(primitive), length
