"""Embree 4 through ctypes: scenes of triangle meshes over shared NumPy arrays.

The library is the one inside the `embreex` wheel. Compiled kernels (`kernels.background.rays`) cast the rays; they get
the addresses from this module. Calls through ctypes release the GIL. Embree computes in float32, so points are
relative to a scene origin near the cameras.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..kernels.background.embree_callbacks import (
    BITS,
    CONTEXT_SIZE,
    TABLE,
    WORD,
    count_bytes,
    mark_and_pass,
    skip_invalid,
)
from ..kernels.base.memory import address_of
from ..support.runtime import thread_count

__all__ = ["EmbreeError", "MarkQuery", "RayScene", "intersect_address", "occluded_address", "point_query_address"]

_INDEX, _VERTEX, _UINT3, _FLOAT3 = 0, 1, 0x5003, 0x9003
# Build qualities. The next better one takes three times as long to build, and rays two thirds of the time.
_LOW, _MEDIUM = 0, 1
_DYNAMIC, _ROBUST, _ARGUMENT_FILTER = 1, 4, 8
_ALL_FEATURES = 0xFFFFFFFF


class EmbreeError(RuntimeError):
    """Embree refused a call, or its library is missing."""


def _library_path() -> str:
    spec = importlib.util.find_spec("embreex")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for found in sorted(Path(folder).parent.glob("embreex.libs/libembree4*")):
            return str(found)
    return "libembree4.so.4"


@functools.cache
def _library() -> Any:
    try:
        library = ctypes.CDLL(_library_path())
    except OSError as error:
        raise EmbreeError(f"Embree 4 is missing (pip install embreex): {error}") from None
    pointer, uint, size = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
    prototypes: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "NewDevice": (pointer, (ctypes.c_char_p,)),
        "ReleaseDevice": (None, (pointer,)),
        "SetDeviceMemoryMonitorFunction": (None, (pointer, pointer, pointer)),
        "GetDeviceError": (ctypes.c_int, (pointer,)),
        "GetDeviceLastErrorMessage": (ctypes.c_char_p, (pointer,)),
        "NewScene": (pointer, (pointer,)),
        "ReleaseScene": (None, (pointer,)),
        "SetSceneFlags": (None, (pointer, ctypes.c_int)),
        "SetSceneBuildQuality": (None, (pointer, ctypes.c_int)),
        "CommitScene": (None, (pointer,)),
        "GetSceneBounds": (None, (pointer, pointer)),
        "NewGeometry": (pointer, (pointer, ctypes.c_int)),
        "ReleaseGeometry": (None, (pointer,)),
        "SetGeometryBuildQuality": (None, (pointer, ctypes.c_int)),
        "SetSharedGeometryBuffer": (
            None,
            (pointer, ctypes.c_int, uint, ctypes.c_int, pointer, size, size, size),
        ),
        "SetGeometryUserData": (None, (pointer, pointer)),
        "SetGeometryIntersectFilterFunction": (None, (pointer, pointer)),
        "SetGeometryOccludedFilterFunction": (None, (pointer, pointer)),
        "SetGeometryEnableFilterFunctionFromArguments": (None, (pointer, ctypes.c_bool)),
        "CommitGeometry": (None, (pointer,)),
        "AttachGeometryByID": (None, (pointer, pointer, uint)),
        "DetachGeometry": (None, (pointer, uint)),
    }
    for name, (result, arguments) in prototypes.items():
        function = getattr(library, "rtc" + name)
        function.restype, function.argtypes = result, arguments
    return library


def intersect_address() -> int:
    """The address of rtcIntersect1, as `kernels.background.intersect.intersect1` takes it."""
    return int(ctypes.cast(_library().rtcIntersect1, ctypes.c_void_p).value or 0)


def occluded_address() -> int:
    """The address of rtcOccluded1, as `kernels.background.rays.is_free` takes it."""
    return int(ctypes.cast(_library().rtcOccluded1, ctypes.c_void_p).value or 0)


def point_query_address() -> int:
    """The address of rtcPointQuery, as `kernels.background.point_query.point_query` takes it."""
    return int(ctypes.cast(_library().rtcPointQuery, ctypes.c_void_p).value or 0)


class RayScene:
    """A dynamic scene of triangle meshes, each under an id that the caller chooses; only changed meshes are rebuilt.

    Changes take effect with `commit`; no ray may be cast between a change and `commit`, nor during it. Flags of invalid
    triangles are shared and take effect at once. Any number of threads may cast rays. Raises EmbreeError if the library
    is missing or refuses a call.
    """

    def __init__(self, threads: int | None = None) -> None:
        rtc = _library()
        config = f"threads={threads or thread_count()},set_affinity=0"
        self._device = rtc.rtcNewDevice(config.encode())
        if not self._device:
            raise EmbreeError(f"no Embree device: error {rtc.rtcGetDeviceError(None)} (config {config!r})")
        self._allocated = np.zeros(1, np.int64)  # bytes; Embree's threads count them
        rtc.rtcSetDeviceMemoryMonitorFunction(self._device, count_bytes.address, address_of(self._allocated))
        self._scene = rtc.rtcNewScene(self._device)
        self._release = weakref.finalize(self, _release, self._scene, self._device, self._allocated)
        self._buffers: dict[int, tuple[npt.NDArray[Any], ...]] = {}  # Embree reads them; it owns none
        self._retired: list[tuple[npt.NDArray[Any], ...]] = []  # of meshes taken away since the last commit
        # _ROBUST: without it, rays leak through shared edges. _LOW: one hierarchy per geometry, under a common top.
        self._call("SetSceneFlags", self._scene, _DYNAMIC | _ROBUST | _ARGUMENT_FILTER)
        self._call("SetSceneBuildQuality", self._scene, _LOW)

    @property
    def address(self) -> int:
        """The scene as kernels take it."""
        return int(self._scene)

    @property
    def memory(self) -> int:
        """Bytes that Embree has allocated (mostly for its hierarchies), plus the copies of points that it reads."""
        return int(self._allocated[0]) + sum(points.nbytes for points, _triangles, _invalid in self._buffers.values())

    def set(
        self,
        geometry_id: int,
        points: npt.NDArray[np.float32],  # [n, 3]
        triangles: npt.NDArray[np.int32],  # [m, 3]
        invalid: npt.NDArray[np.uint8],  # [m]
        *,
        lasting: bool = False,
    ) -> None:
        """Puts a mesh under an id and removes the one that was there; without triangles the id stays empty. lasting: it
        is worth a better hierarchy, because it will not be replaced soon.

        `triangles` and `invalid` are shared, not copied: rays pass through triangle i while invalid[i] != 0. Raises
        ValueError for an `invalid` of another shape or type, or that is not C-contiguous.
        """
        if invalid.shape != (len(triangles),) or not invalid.flags.c_contiguous or invalid.dtype != np.uint8:
            raise ValueError(f"invalid: {invalid.dtype} {invalid.shape}: expected uint8 [{len(triangles)}]")
        self.remove(geometry_id)
        if len(triangles) == 0:
            return
        padded = np.zeros((len(points) + 2, 3), np.float32)  # Embree reads 16 bytes per vertex
        padded[: len(points)] = points
        triangles = np.ascontiguousarray(triangles, np.int32)
        geometry = self._call("NewGeometry", self._device, 0)
        try:
            self._call("SetGeometryBuildQuality", geometry, _MEDIUM if lasting else _LOW)
            self._share(geometry, _VERTEX, _FLOAT3, padded, len(points))
            self._share(geometry, _INDEX, _UINT3, triangles, len(triangles))
            self._call("SetGeometryUserData", geometry, address_of(invalid))
            self._call("SetGeometryIntersectFilterFunction", geometry, skip_invalid.address)
            self._call("SetGeometryOccludedFilterFunction", geometry, skip_invalid.address)
            self._call("SetGeometryEnableFilterFunctionFromArguments", geometry, True)
            self._call("CommitGeometry", geometry)
            self._call("AttachGeometryByID", self._scene, geometry, geometry_id)
            self._buffers[geometry_id] = (padded, triangles, invalid)
        finally:
            _library().rtcReleaseGeometry(geometry)  # the scene holds its own reference

    def remove(self, geometry_id: int) -> None:
        """Removes the mesh under an id, if there is one."""
        if geometry_id in self._buffers:
            self._call("DetachGeometry", self._scene, geometry_id)
            self._retired.append(self._buffers.pop(geometry_id))

    def commit(self) -> None:
        """Builds all changed meshes."""
        self._call("CommitScene", self._scene)
        self._retired.clear()

    def bounds(self) -> npt.NDArray[np.float64]:  # [2, 3]
        """Lower and upper corner of everything in the committed scene; lower > upper where it is empty."""
        memory = np.zeros(12, np.float32)
        start = (-memory.ctypes.data // 4) % 4  # RTCBounds is 16-byte aligned: two rows of four
        self._call("GetSceneBounds", self._scene, memory.ctypes.data + 4 * start)
        return memory[start : start + 8].reshape(2, 4)[:, :3].astype(np.float64)

    def _share(self, geometry: int, kind: int, layout: int, array: npt.NDArray[Any], count: int) -> None:
        self._call("SetSharedGeometryBuffer", geometry, kind, 0, layout, array.ctypes.data, 0, 12, count)

    def _call(self, name: str, *arguments: Any) -> Any:
        rtc = _library()
        result = getattr(rtc, "rtc" + name)(*arguments)
        error = rtc.rtcGetDeviceError(self._device)
        if error:
            message = (rtc.rtcGetDeviceLastErrorMessage(self._device) or b"").decode(errors="replace")
            raise EmbreeError(f"rtc{name}: error {error}: {message}")
        return result


def _release(scene: int, device: int, allocated: npt.NDArray[np.int64]) -> None:
    """Ends a scene and its device; the array with the count of its memory must outlive both."""
    _library().rtcReleaseScene(scene)
    _library().rtcReleaseDevice(device)


class MarkQuery:
    """Arguments of a ray query that sets bits in the marks of every triangle on the ray's interval.

    `marks` is a table of marks (`kernels.background.surfaces`): int64 [geometries, 2], the address of a geometry's
    uint64 marks and how many there are for each triangle; `word` and `bits` say which word of a triangle's marks gets
    which bits.
    """

    def __init__(self, marks: npt.NDArray[np.int64], word: int, bits: int) -> None:
        self._table = marks
        self._context = np.full(CONTEXT_SIZE, -1, np.int64)  # of no instance; then the fields of mark_and_pass
        self._context[[TABLE, WORD, BITS]] = address_of(marks), word, _signed(bits)
        # RTCIntersectArguments: flags, feature_mask, context, filter, and room for its optional fields.
        self._arguments = np.zeros(8, np.int64)
        self._arguments[0] = _signed(_ALL_FEATURES << 32)
        self._arguments[1] = address_of(self._context)
        self._arguments[2] = mark_and_pass.address

    @property
    def address(self) -> int:
        """The query as `kernels.background.intersect.intersect1` takes it; valid while this object lives."""
        return int(self._arguments.ctypes.data)


def _signed(bits: int) -> int:
    return bits - (1 << 64) if bits >= 1 << 63 else bits
