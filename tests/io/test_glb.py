"""GLB files: read by hand, by the rules of glTF 2.0 and KHR_materials_unlit."""

from __future__ import annotations

import io
import json
import struct

import numpy as np
import pytest
from farside.engine.io.coloured_meshes import ColouredMesh, TexturedMesh, TexturedPart, TexturePage
from farside.engine.io.glb import MAX_BYTES, to_glb
from farside.engine.io.images import encode_rgb_jpeg
from PIL import Image

FAR = np.array([1e6, -2e6, 30.0])  # metres: single precision would be off by centimetres
COMPONENTS = {5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDE = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
UNLIT = "KHR_materials_unlit"


def some(count=7, triangles=5, seed=1):
    """Vertices, triangles that use all of them, and numbers from 0 to 1."""
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, count, (triangles, 3)).astype(np.int32)
    return FAR + rng.uniform(-2, 2, (count, 3)), corners, rng.random((count, 3)).astype(np.float32)


def page(width, height, seed=1):
    rng = np.random.default_rng(seed)
    return TexturePage(encode_rgb_jpeg(rng.integers(0, 256, (height, width, 3)).astype(np.uint8), 90), width, height)


def textured(*counts):
    """A mesh with a part of `count` vertices for each of `counts`."""
    parts = []
    for seed, count in enumerate(counts):
        vertices, triangles, numbers = some(count, seed=seed)
        parts.append(TexturedPart(vertices, triangles, numbers[:, :2] * np.float32(16), page(16, 32, seed)))
    return TexturedMesh(tuple(parts))


class Read:
    """A GLB file's two chunks."""

    def __init__(self, data):
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert (kind, size % 4) == (b"JSON", 0)
        self.scene, self.binary = json.loads(data[20 : 20 + size]), b""
        if 20 + size < len(data):
            binary_size, kind = struct.unpack_from("<I4s", data, 20 + size)
            assert (kind, binary_size % 4) == (b"BIN\0", 0)
            self.binary = data[28 + size :]
            assert len(self.binary) == binary_size == self.scene["buffers"][0]["byteLength"]

    def bytes_of(self, number):
        view = self.scene["bufferViews"][number]
        assert view["byteOffset"] % 4 == 0
        return self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def values(self, number):
        """An accessor's values, as they are stored."""
        accessor = self.scene["accessors"][number]
        dtype, wide = COMPONENTS[accessor["componentType"]], WIDE[accessor["type"]]
        found = np.frombuffer(self.bytes_of(accessor["bufferView"]), dtype).reshape(-1, wide)
        assert len(found) == accessor["count"]
        return found

    @property
    def primitives(self):
        return self.scene["meshes"][0]["primitives"]

    def vertices(self, primitive):
        """A primitive's positions in the world's axes, metres."""
        accessor = primitive["attributes"]["POSITION"]
        points = self.values(accessor)
        assert self.scene["accessors"][accessor]["min"] == points.min(axis=0).tolist()
        assert self.scene["accessors"][accessor]["max"] == points.max(axis=0).tolist()
        (node,) = self.scene["nodes"]
        assert node.keys() == {"name", "mesh", "translation"}
        x, y, z = (points.astype(float) + node["translation"]).T
        # glTF looks along -z with x to the right and y up; the world along x with y to the left and z up.
        return np.stack([-z, -x, y], axis=-1)


def test_vertices_and_triangles_are_those_of_the_mesh():
    vertices, triangles, colours = some()
    read = Read(to_glb(ColouredMesh(vertices, triangles, colours)))
    (primitive,) = read.primitives
    np.testing.assert_allclose(read.vertices(primitive), vertices, atol=1e-6)
    np.testing.assert_array_equal(read.values(primitive["indices"]).reshape(-1, 3), triangles)
    assert read.scene["asset"]["version"] == "2.0"


def test_colours_of_vertices_are_linear_light_in_16_bits():
    vertices, triangles, colours = some(64)
    colours[0], colours[1], colours[2] = 0.5, 0.0, 1.0
    read = Read(to_glb(ColouredMesh(vertices, triangles, colours)))
    (primitive,) = read.primitives
    accessor = read.scene["accessors"][primitive["attributes"]["COLOR_0"]]
    assert (accessor["componentType"], accessor["normalized"], accessor["type"]) == (5123, True, "VEC4")
    found = read.values(primitive["attributes"]["COLOR_0"]) / 65535
    np.testing.assert_array_equal(found[:, 3], 1.0)
    assert found[0, :3] == pytest.approx([0.2140] * 3, abs=1e-4)  # half of the code range, as light
    assert found[1:3, :3].tolist() == [[0.0] * 3, [1.0] * 3]
    light = found[:, :3]
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(encoded, colours, atol=1e-4)


def test_each_part_has_its_page_as_texture():
    mesh = textured(7, 9)
    read = Read(to_glb(mesh))
    assert len(read.primitives) == 2
    for part, primitive in zip(mesh.parts, read.primitives, strict=True):
        assert primitive["attributes"].keys() == {"POSITION", "TEXCOORD_0"}  # COLOR_0 would darken the texture
        np.testing.assert_allclose(read.vertices(primitive), part.vertices, atol=1e-6)
        np.testing.assert_array_equal(read.values(primitive["indices"]).reshape(-1, 3), part.triangles)
        np.testing.assert_allclose(read.values(primitive["attributes"]["TEXCOORD_0"]), part.uv / (16, 32), atol=1e-7)
        surface = read.scene["materials"][primitive["material"]]["pbrMetallicRoughness"]
        texture = read.scene["textures"][surface["baseColorTexture"]["index"]]
        picture = read.scene["images"][texture["source"]]
        assert picture["mimeType"] == "image/jpeg"
        with Image.open(io.BytesIO(read.bytes_of(picture["bufferView"]))) as image:
            assert (image.size, image.format) == ((16, 32), "JPEG")
        assert read.bytes_of(picture["bufferView"]) == part.picture.jpeg
        sampler = read.scene["samplers"][texture["sampler"]]
        assert (sampler["minFilter"], sampler["magFilter"]) == (9729, 9729)  # LINEAR, without mip levels


@pytest.mark.parametrize("mesh", [ColouredMesh(*some()), textured(7)], ids=["vertex", "texture"])
def test_materials_are_unlit_and_double_sided(mesh):
    read = Read(to_glb(mesh))
    assert read.scene["extensionsUsed"] == [UNLIT]
    for primitive in read.primitives:
        material = read.scene["materials"][primitive["material"]]
        assert material["extensions"] == {UNLIT: {}}
        assert material["doubleSided"] is True
        assert material["pbrMetallicRoughness"]["metallicFactor"] == 0.0


@pytest.mark.parametrize("count", [65535, 65536])
def test_indices_are_as_wide_as_the_vertices_need(count):
    vertices, triangles, colours = some(count)
    triangles[0] = 0, 1, count - 1
    read = Read(to_glb(ColouredMesh(vertices, triangles, colours)))
    number = read.primitives[0]["indices"]
    assert read.scene["accessors"][number]["componentType"] == (5123 if count == 65535 else 5125)  # 65535 is no index
    np.testing.assert_array_equal(read.values(number).reshape(-1, 3), triangles)


@pytest.mark.parametrize("mesh", [ColouredMesh.joined([]), TexturedMesh(())], ids=["vertex", "texture"])
def test_a_mesh_without_triangles_is_an_empty_scene(mesh):
    read = Read(to_glb(mesh))
    assert read.scene == {
        "asset": {"version": "2.0", "generator": "Farside"}, "scene": 0, "scenes": [{"name": "background"}],
    }  # fmt: skip
    assert read.binary == b""


def test_what_does_not_fit_is_refused_before_anything_is_made():
    many = 300_000_000  # views of one row: such a mesh takes no memory, but a copy of it would
    vertices, colours = np.broadcast_to(FAR, (many, 3)), np.broadcast_to(np.ones(3, np.float32), (many, 3))
    mesh = ColouredMesh(vertices, np.array([[0, 1, many - 1]], np.int32), colours)
    message = rf"mesh: \d+ bytes for {many} vertices and 1 triangles: expected at most {MAX_BYTES}, the limit of GLB"
    with pytest.raises(ValueError, match=message):
        to_glb(mesh)
    part = TexturedPart(vertices, mesh.triangles, np.broadcast_to(np.ones(2, np.float32), (many, 2)), page(16, 32))
    with pytest.raises(ValueError, match=message):
        to_glb(TexturedMesh((part,)))
    assert MAX_BYTES == 2**32 - 1


def test_positions_that_are_not_numbers_are_refused():
    vertices, triangles, colours = some()
    vertices[3, 1] = np.inf
    with pytest.raises(ValueError, match="mesh: a position is not finite: expected numbers"):
        to_glb(ColouredMesh(vertices, triangles, colours))
