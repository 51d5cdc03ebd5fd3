"""Meshes as files: PLY, read by hand, byte for byte; which colours a format has."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from farside.engine.io.coloured_meshes import ColouredMesh, TexturedMesh
from farside.engine.io.glb import to_glb
from farside.engine.io.mesh_files import FORMATS, colours_of, to_file
from farside.server.export import MEDIA_TYPES

FAR = np.array([1e6, -2e6, 30.0])  # metres: single precision would be off by centimetres


def some(count=7):
    rng = np.random.default_rng(count)
    vertices = FAR + rng.uniform(-2, 2, (count, 3))
    triangles = rng.integers(0, count, (5, 3)).astype(np.int32) if count else np.empty((0, 3), np.int32)
    return ColouredMesh(vertices, triangles, (rng.integers(0, 256, (count, 3)) / 255).astype(np.float32))


@pytest.mark.parametrize("count", [0, 7])
def test_ply_is_a_header_and_packed_rows(count):
    mesh = some(count)
    header, _, body = to_file(mesh, "ply").partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert lines[2] == "comment Farside: metres; x forward, y left, z up; colours of vertices in sRGB"
    kinds = {"double": "d", "uchar": "B"}
    assert lines[3] == f"element vertex {count}"
    properties = [line.split() for line in lines[4:10]]
    assert [name for _, _, name in properties] == ["x", "y", "z", "red", "green", "blue"]
    row = struct.Struct("<" + "".join(kinds[kind] for _, kind, _ in properties))
    assert lines[10:] == [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices"]
    vertices = [row.unpack_from(body, k * row.size) for k in range(count)]
    assert [list(vertex[:3]) for vertex in vertices] == mesh.vertices.tolist()  # to the last bit
    assert [list(vertex[3:]) for vertex in vertices] == np.rint(255 * mesh.colours).astype(int).tolist()
    face, start = struct.Struct("<B3i"), count * row.size
    faces = [face.unpack_from(body, start + k * face.size) for k in range(len(mesh.triangles))]
    assert faces == [(3, *triangle) for triangle in mesh.triangles.tolist()]
    assert len(body) == start + len(faces) * face.size


def test_another_format_is_named():
    with pytest.raises(ValueError, match="format: 'obj': expected one of glb, ply"):
        to_file(some(), "obj")
    with pytest.raises(ValueError, match="format: 'obj': expected one of glb, ply"):
        colours_of("obj")


def test_a_format_has_its_colours():
    assert [colours_of(*asked) for asked in (("glb",), ("glb", "texture"), ("glb", "vertex"))] == [
        "texture", "texture", "vertex",
    ]  # fmt: skip
    assert [colours_of("ply"), colours_of("ply", "vertex")] == ["vertex", "vertex"]
    with pytest.raises(ValueError, match="colours: 'sepia': expected one of texture, vertex"):
        colours_of("glb", "sepia")
    for refused in (lambda: colours_of("ply", "texture"), lambda: to_file(TexturedMesh(()), "ply")):
        with pytest.raises(ValueError, match="colours: 'texture': expected vertex for ply, which holds no pictures"):
            refused()


def test_every_format_that_is_served_can_be_written():
    assert MEDIA_TYPES == {"glb": "model/gltf-binary", "ply": "application/octet-stream"}
    assert tuple(MEDIA_TYPES) == FORMATS
    assert to_file(some(), "ply").startswith(b"ply")
    assert to_file(some(), "glb") == to_glb(some())
