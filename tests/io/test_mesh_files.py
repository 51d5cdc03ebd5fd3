"""Meshes as files: read by hand, byte for byte, and by the rules of their formats."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from farside.engine.io.mesh_files import ColouredMesh, to_file
from farside.server.export import MEDIA_TYPES

FAR = np.array([1e6, -2e6, 30.0])  # metres: single precision would be off by centimetres


def some(count=7):
    rng = np.random.default_rng(count)
    vertices = FAR + rng.uniform(-2, 2, (count, 3))
    triangles = rng.integers(0, count, (5, 3)).astype(np.int32) if count else np.empty((0, 3), np.int32)
    return ColouredMesh(vertices, triangles, rng.integers(0, 256, (count, 3)).astype(np.uint8))


@pytest.mark.parametrize("count", [0, 7])
def test_ply_is_a_header_and_packed_rows(count):
    mesh = some(count)
    header, _, body = to_file(mesh, "ply").partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    kinds = {"double": "d", "uchar": "B"}
    assert lines[2] == f"element vertex {count}"
    properties = [line.split() for line in lines[3:9]]
    assert [name for _, _, name in properties] == ["x", "y", "z", "red", "green", "blue"]
    row = struct.Struct("<" + "".join(kinds[kind] for _, kind, _ in properties))
    assert lines[9:] == [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices"]
    vertices = [row.unpack_from(body, k * row.size) for k in range(count)]
    assert [list(vertex[:3]) for vertex in vertices] == mesh.vertices.tolist()  # to the last bit
    assert [list(vertex[3:]) for vertex in vertices] == mesh.colours.tolist()
    face, start = struct.Struct("<B3i"), count * row.size
    faces = [face.unpack_from(body, start + k * face.size) for k in range(len(mesh.triangles))]
    assert faces == [(3, *triangle) for triangle in mesh.triangles.tolist()]
    assert len(body) == start + len(faces) * face.size


def test_glb_is_two_chunks_that_say_where_the_vertices_are():
    mesh = some()
    data = to_file(mesh, "glb")
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    scene = json.loads(data[20 : 20 + size])
    binary_size, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert kind == b"BIN\0"
    binary = data[28 + size : 28 + size + binary_size]

    def values(number):
        accessor = scene["accessors"][number]
        view = scene["bufferViews"][accessor["bufferView"]]
        dtype = {5121: "<u1", 5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
        wide = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(binary, dtype, accessor["count"] * wide, start).reshape(-1, wide)

    (part,) = scene["meshes"][0]["primitives"]
    (node,) = (node for node in scene["nodes"] if "mesh" in node)
    move = np.array(node["matrix"], float).reshape(4, 4).T  # column-major
    np.testing.assert_array_equal(move[:3, :3], np.eye(3))
    x, y, z = (values(part["attributes"]["POSITION"]).astype(float) + move[:3, 3]).T
    # glTF looks along -z with x to the right and y up; the world along x with y to the left and z up.
    np.testing.assert_allclose(np.stack([-z, -x, y], axis=-1), mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(values(part["attributes"]["COLOR_0"])[:, :3], mesh.colours)
    np.testing.assert_array_equal(values(part["indices"]).reshape(-1, 3), mesh.triangles)


def test_another_format_is_named():
    with pytest.raises(ValueError, match="format: 'obj': expected one of glb, ply"):
        to_file(some(), "obj")


def test_every_format_that_is_served_can_be_written():
    assert MEDIA_TYPES == {"glb": "model/gltf-binary", "ply": "application/octet-stream"}
    for name in MEDIA_TYPES:
        assert to_file(some(), name)
