"""glTF 2.0 in one binary file (GLB): triangles with unlit materials, with colours at vertices or with pictures.

Khronos, glTF 2.0 specification, sections 3 and 4 (the container); extension KHR_materials_unlit.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .coloured_meshes import ColouredMesh, TexturedMesh, TexturedPart
from .srgb import linear

__all__ = ["MAX_BYTES", "to_glb"]

MAX_BYTES = (1 << 32) - 1  # the container's header holds the file's length in 32 bits
_JSON_BYTES = 1 << 16  # more than the description of the largest file takes
_RESTART = (1 << 16) - 1  # no index may have this value in 16 bits
_BYTE_PARTS = {"f": 5126, "H": 5123, "I": 5125}  # glTF's numbers of component types, by NumPy's letter
_VERTICES, _INDICES = 34962, 34963  # what a part of the buffer is for
_LINEAR, _CLAMP = 9729, 33071  # OpenGL's numbers: filters of textures, and coordinates at their border
_UNLIT = "KHR_materials_unlit"


def to_glb(mesh: ColouredMesh | TexturedMesh) -> bytes:
    """A mesh as the bytes of a GLB file: metres, in glTF's axes (x right, y up, -z forward).

    Materials are unlit and double-sided. A `ColouredMesh` has its colours in COLOR_0: linear light, 16 bits. A
    `TexturedMesh` has a primitive for each page, with that page as its texture. A mesh without triangles is a scene
    without nodes.

    Positions are single precision in glTF. They are therefore relative to the middle of the mesh, and the node's
    translation moves them back. Raises ValueError, before any byte is made, for a mesh that does not fit into
    `MAX_BYTES`, or has positions that are not finite.
    """
    parts: Sequence[ColouredMesh | TexturedPart]
    parts = (mesh,) if isinstance(mesh, ColouredMesh) else mesh.parts
    parts = [part for part in parts if len(part.triangles)]
    _check_size(parts)
    file = _File()
    if parts:
        middle = _middle(parts)
        primitives = [_primitive(file, part, middle) for part in parts]
        file.add("meshes", {"name": "background", "primitives": primitives})
        file.add("nodes", {"name": "background", "mesh": 0, "translation": middle.tolist()})
    return file.packed()


class _File:
    """A glTF description and its binary buffer, while they are made."""

    def __init__(self) -> None:
        self._lists: dict[str, list[dict[str, Any]]] = {}
        self._chunks: list[bytes] = []
        self._size = 0

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Adds an object to a top-level list, and returns its index there."""
        self._lists.setdefault(kind, []).append(item)
        return len(self._lists[kind]) - 1

    def add_bytes(self, data: bytes, **fields: Any) -> int:
        """Adds bytes to the buffer, at a multiple of four; returns the index of their view."""
        view = self.add("bufferViews", {"buffer": 0, "byteOffset": self._size, "byteLength": len(data), **fields})
        self._chunks += [data, bytes(-len(data) % 4)]
        self._size += len(data) + -len(data) % 4
        return view

    def add_array(self, array: npt.NDArray[Any], target: int, **fields: Any) -> int:
        """Adds an array [n] or [n, components], to be used as `target`; returns the index of its accessor."""
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        view = self.add_bytes(array.tobytes(), target=target)
        number = _BYTE_PARTS[array.dtype.char]
        return self.add(
            "accessors", {"bufferView": view, "componentType": number, "count": len(array), "type": kind, **fields}
        )

    def packed(self) -> bytes:
        """The container: a header, the description and the buffer."""
        scene: dict[str, Any] = {"name": "background"}
        if "nodes" in self._lists:
            scene["nodes"] = list(range(len(self._lists["nodes"])))
        whole: dict[str, Any] = {"asset": {"version": "2.0", "generator": "Farside"}, "scene": 0, "scenes": [scene]}
        if "materials" in self._lists:
            whole["extensionsUsed"] = [_UNLIT]
        whole |= self._lists
        if self._size:
            whole["buffers"] = [{"byteLength": self._size}]
        text = json.dumps(whole, separators=(",", ":")).encode()
        chunks = [(b"JSON", [text + b" " * (-len(text) % 4)])]
        if self._size:
            chunks.append((b"BIN\0", self._chunks))
        body = []
        for kind, pieces in chunks:
            body += [struct.pack("<I4s", sum(map(len, pieces)), kind), *pieces]
        return b"".join([struct.pack("<4sII", b"glTF", 2, 12 + sum(map(len, body))), *body])


def _check_size(parts: Sequence[ColouredMesh | TexturedPart]) -> None:
    size = _JSON_BYTES
    for part in parts:
        size += 20 * len(part.vertices) + 3 * _index_type(part).itemsize * len(part.triangles)
        size += len(part.picture.jpeg) if isinstance(part, TexturedPart) else 0
    if size > MAX_BYTES:
        vertices, triangles = sum(len(part.vertices) for part in parts), sum(len(part.triangles) for part in parts)
        raise ValueError(
            f"mesh: {size} bytes for {vertices} vertices and {triangles} triangles: expected at most {MAX_BYTES}, the "
            "limit of GLB (PLY has none)"
        )


def _index_type(part: ColouredMesh | TexturedPart) -> np.dtype[np.unsignedinteger[Any]]:
    return np.dtype("<u2" if len(part.vertices) <= _RESTART else "<u4")


def _in_axes(vertices: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """World positions [n, 3] (x forward, y left, z up) in glTF's axes."""
    x, y, z = vertices.T
    return np.stack([-y, z, -x], axis=-1)


def _middle(parts: Sequence[ColouredMesh | TexturedPart]) -> npt.NDArray[np.float64]:  # [3]
    """The middle of the parts' bounds in glTF's axes, in whole metres; ValueError if they are not finite."""
    low = np.min([part.vertices.min(axis=0) for part in parts], axis=0)
    high = np.max([part.vertices.max(axis=0) for part in parts], axis=0)
    if not np.isfinite([low, high]).all():
        raise ValueError("mesh: a position is not finite: expected numbers")
    middle: npt.NDArray[np.float64] = np.rint(_in_axes(0.5 * (low + high)[None])[0]) + 0.0  # no negative zero
    return middle


def _primitive(file: _File, part: ColouredMesh | TexturedPart, middle: npt.NDArray[np.float64]) -> dict[str, Any]:
    points = (_in_axes(part.vertices) - middle).astype("<f4")
    bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    attributes = {"POSITION": file.add_array(points, _VERTICES, **bounds)}
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}  # for readers that do not know _UNLIT
    if isinstance(part, TexturedPart):
        size = part.picture.width, part.picture.height
        coordinates = (part.uv / np.array(size, np.float64)).astype("<f4")
        attributes["TEXCOORD_0"] = file.add_array(coordinates, _VERTICES)
        surface["baseColorTexture"] = {"index": _texture(file, part.picture.jpeg)}
    else:
        attributes["COLOR_0"] = file.add_array(_linear_rgba(part.colours), _VERTICES, normalized=True)
    indices = part.triangles.reshape(-1).astype(_index_type(part))
    material = {"doubleSided": True, "pbrMetallicRoughness": surface, "extensions": {_UNLIT: {}}}
    return {
        "attributes": attributes, "indices": file.add_array(indices, _INDICES),
        "material": file.add("materials", material),
    }  # fmt: skip


def _texture(file: _File, jpeg: bytes) -> int:
    """Adds a picture with its sampler; returns the index of the texture."""
    # Mip levels would make a seam of every border between parts, and a grey disc of the poles of spherical pictures.
    sampler = {"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _CLAMP, "wrapT": _CLAMP}
    image = file.add("images", {"bufferView": file.add_bytes(jpeg), "mimeType": "image/jpeg"})
    return file.add("textures", {"source": image, "sampler": file.add("samplers", sampler)})


def _linear_rgba(colours: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:  # [n, 3] -> [n, 4]
    """R'G'B' (IEC 61966-2-1, sRGB) as linear light in 16 bits, with an alpha of 1."""
    rgba = np.full((len(colours), 4), 65535, "<u2")
    rgba[:, :3] = np.rint(65535.0 * linear(colours))
    return rgba
