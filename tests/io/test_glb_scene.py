"""Reading of GLB files: our own come back as they were, those of other programs as glTF says, bad ones are refused."""

from __future__ import annotations

import io
import json
import math
import re
import struct

import numpy as np
import pytest
from farside.engine.io.coloured_meshes import ColouredMesh, TexturedMesh, TexturedPart, TexturePage
from farside.engine.io.glb import to_glb
from farside.engine.io.glb_scene import read_glb
from farside.engine.io.images import encode_rgb_jpeg
from PIL import Image

TYPES = {np.dtype(name): kind for name, kind in (("f4", 5126), ("u1", 5121), ("u2", 5123), ("u4", 5125), ("i1", 5120))}
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "<f4")
SQUARE = np.array([0, 1, 2, 2, 1, 3], "u1")


def png(rgb):
    file = io.BytesIO()
    Image.fromarray(np.asarray(rgb, np.uint8)).save(file, "PNG")
    return file.getvalue()


class Made:
    """A GLB file that is put together by hand."""

    def __init__(self):
        self.whole = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}
        self.binary = b""

    def view(self, data, **fields):
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **fields}
        self.whole["bufferViews"].append(view)
        self.binary += data + bytes(-len(data) % 4)
        return len(self.whole["bufferViews"]) - 1

    def array(self, array, **fields):
        array = np.asarray(array)
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        view = self.view(array.tobytes())
        item = {"bufferView": view, "componentType": TYPES[array.dtype], "count": len(array), "type": kind, **fields}
        self.whole["accessors"].append(item)
        return len(self.whole["accessors"]) - 1

    def square(self, **primitive):
        """The scene of a square in one mesh and node."""
        attributes = {"POSITION": self.array(CORNERS), **primitive.pop("attributes", {})}
        primitive = {"attributes": attributes, "indices": self.array(SQUARE), **primitive}
        self.whole["meshes"] = [{"primitives": [primitive]}]
        self.whole["nodes"] = [{"mesh": 0}]
        self.whole["scenes"] = [{"nodes": [0]}]
        return self

    def write(self, path):
        self.whole["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(self.whole).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(self.binary), b"BIN\0")
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body) + len(self.binary)) + body + self.binary)
        return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "room.glb"


def world(points):
    """glTF's points in the world's axes."""
    x, y, z = np.asarray(points, float).T
    return np.stack([-z, -x, y], axis=-1)


def test_our_own_coloured_mesh_comes_back(path):
    rng = np.random.default_rng(1)
    mesh = ColouredMesh(
        1000.0 + rng.random((9, 3)), rng.integers(0, 9, (5, 3)).astype(np.int32), rng.random((9, 3)).astype(np.float32)
    )
    path.write_bytes(to_glb(mesh))
    (part,) = read_glb(path)
    np.testing.assert_allclose(part.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(part.triangles, mesh.triangles)
    np.testing.assert_allclose(part.colours, mesh.colours, atol=1e-4)
    assert part.picture is None


def test_our_own_textures_come_back(path):
    rng = np.random.default_rng(2)
    parts = []
    for size in (16, 64):
        jpeg = encode_rgb_jpeg(rng.integers(0, 256, (size, 2 * size, 3)).astype(np.uint8), 90)
        uv = rng.random((9, 2)).astype(np.float32) * size
        triangles = rng.integers(0, 9, (5, 3)).astype(np.int32)
        parts.append(TexturedPart(rng.random((9, 3)), triangles, uv, TexturePage(jpeg, 2 * size, size)))
    path.write_bytes(to_glb(TexturedMesh(tuple(parts))))
    found = read_glb(path)
    for one, expected, size in zip(found, parts, (16, 64), strict=True):
        np.testing.assert_allclose(one.vertices, expected.vertices, atol=1e-6)
        np.testing.assert_array_equal(one.triangles, expected.triangles)
        np.testing.assert_allclose(one.uv * [2 * size, size], expected.uv, atol=1e-4)
        assert one.picture == expected.picture.jpeg
        assert one.colours.tolist() == [[1.0, 1.0, 1.0]]


def test_nodes_are_moved_turned_and_scaled_one_within_the_other(path):
    made = Made().square()
    half = math.sqrt(0.5)
    made.whole["nodes"] = [
        {"children": [1], "translation": [0.0, 0.0, -5.0], "rotation": [0.0, half, 0.0, half]},  # a quarter about y
        {"mesh": 0, "scale": [2.0, 3.0, 1.0]},
        {"mesh": 0, "matrix": np.array([[1, 0, 0, 7], [0, 1, 0, 8], [0, 0, 1, 9], [0, 0, 0, 1.0]]).T.ravel().tolist()},
        {"mesh": 0},  # of another scene
    ]
    made.whole["scenes"] = [{"nodes": [3]}, {"nodes": [0, 2]}]
    made.whole["scene"] = 1
    first, second = read_glb(made.write(path))
    x, y = 2.0 * CORNERS[:, 0], 3.0 * CORNERS[:, 1]
    np.testing.assert_allclose(first.vertices, world(np.stack([0 * x, y, -5.0 - x], -1)), atol=1e-12)
    np.testing.assert_allclose(second.vertices, world(CORNERS + np.array([7.0, 8.0, 9.0])), atol=1e-12)


def test_colours_are_a_material_s_or_of_vertices_or_both(path):
    made = Made()
    colours = np.array([[255, 0, 0, 255], [0, 128, 0, 255], [0, 0, 255, 255], [255, 255, 255, 0]], "u1")
    made.square(attributes={"COLOR_0": made.array(colours, normalized=True)}, material=0)
    made.whole["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1.0, 0.0, 1.0]}}]
    (part,) = read_glb(made.write(path))
    half, middle = 0.7354, 0.7360  # of 0.5 and 128 / 255 in linear light, as sRGB
    expected = [[half, 0, 0], [0, middle, 0], [0, 0, 0], [half, 1, 0]]
    np.testing.assert_allclose(part.colours, expected, atol=1e-3)
    del made.whole["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]
    (part,) = read_glb(made.write(path))
    np.testing.assert_allclose(part.colours, [[half, 1.0, 0.0]] * 4, atol=1e-3)
    del made.whole["meshes"][0]["primitives"][0]["material"]
    (part,) = read_glb(made.write(path))
    assert part.colours.tolist() == [[1.0] * 3] * 4


def test_a_texture_has_its_transform_and_the_way_it_repeats(path):
    made = Made()
    uv = np.array([[0, 0], [65535, 0], [0, 65535], [65535, 65535]], "<u2")
    made.square(attributes={"TEXCOORD_1": made.array(uv, normalized=True)}, material=0)
    transform = {"offset": [0.25, 0.5], "scale": [2.0, 1.0], "rotation": math.pi / 2}
    texture = {"index": 0, "texCoord": 1, "extensions": {"KHR_texture_transform": transform}}
    surface = {"baseColorTexture": texture, "baseColorFactor": [1.0, 0.5, 1.0, 1.0]}
    picture = png(np.zeros((4, 4, 3)))
    made.whole |= {
        "materials": [{"pbrMetallicRoughness": surface}], "textures": [{"source": 0, "sampler": 0}],
        "images": [{"bufferView": made.view(picture), "mimeType": "image/png"}],
        "samplers": [{"wrapS": 33071, "wrapT": 33648}], "extensionsRequired": ["KHR_texture_transform"],
    }  # fmt: skip
    (part,) = read_glb(made.write(path))
    assert part.picture == picture
    assert part.repeats == ("clamp", "mirror")
    assert part.colours.tolist() == [[1.0, 0.5, 1.0]]
    # The extension's text: offset, then rotation, then scale, as matrices from left to right.
    a, b = np.array([0, 2, 0, 2.0]), np.array([0, 0, 1, 1.0])
    np.testing.assert_allclose(part.uv, np.stack([0.25 + b, 0.5 - a], -1), atol=1e-6)


def test_strips_fans_and_gaps_between_elements(path):
    made = Made()
    wide = np.zeros((4, 5), "<f4")
    wide[:, 1:4] = CORNERS
    view = made.view(wide.tobytes(), byteStride=20)
    made.whole["accessors"].append(
        {"bufferView": view, "byteOffset": 4, "componentType": 5126, "count": 4, "type": "VEC3"}
    )
    made.whole["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (5, 6, 4, 1)]}]
    made.whole["nodes"] = [{"children": [1]}, {"mesh": 0}]  # without a scene all nodes that nobody has are shown
    strip, fan, plain = read_glb(made.write(path))
    np.testing.assert_allclose(strip.vertices, world(CORNERS))
    assert strip.triangles.tolist() == [[0, 1, 2], [2, 1, 3]]
    assert fan.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert plain.triangles.tolist() == [[0, 1, 2]]


def primitive(made):
    return made.whole["meshes"][0]["primitives"][0]


def with_texture(made, data):
    attributes = primitive(made)["attributes"]
    attributes["TEXCOORD_0"] = made.array(CORNERS[:, :2].copy())
    primitive(made)["material"] = 0
    made.whole["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    made.whole["textures"] = [{"source": 0}]
    made.whole["images"] = [{"bufferView": made.view(data)}]


BAD = {
    "a position that is no number": (
        lambda m: m.array(np.where(np.eye(4, 3) > 0, np.float32(np.nan), CORNERS).astype("<f4")),
        lambda m: primitive(m)["attributes"].update(POSITION=2), r"primitives\[0\].POSITION: nan in element 0",
    ),
    "an index beyond the vertices": (
        lambda m: m.array(np.array([0, 1, 4], "<u2")),
        lambda m: primitive(m).update(indices=2), r"primitives\[0\].indices: 4: expected less than 4",
    ),
    "no triangles": (None, lambda m: primitive(m).update(mode=0), "scene: no triangles"),
    "no scene": (None, lambda m: m.whole.pop("nodes") and m.whole.pop("scenes"), "scene: no triangles"),
    "an index that is signed": (
        lambda m: m.array(np.array([0, 1, 2], "i1")), lambda m: primitive(m).update(indices=2), "indices: int8",
    ),
    "an accessor beyond its view": (None, lambda m: m.whole["accessors"][0].update(count=5), "5 elements to byte 60"),
    "a vast accessor": (None, lambda m: m.whole["accessors"][0].update(count=1 << 40), "scene: 1099511627776 vertices"),
    "a view beyond the buffer": (None, lambda m: m.whole["bufferViews"][0].update(byteLength=4096), "bytes 0 to 4096"),
    "a negative offset": (None, lambda m: m.whole["bufferViews"][1].update(byteOffset=-4), "bytes -4 to 2"),
    "compression": (
        None, lambda m: m.whole.update(extensionsRequired=["KHR_draco_mesh_compression"]),
        "extensionsRequired: KHR_draco_mesh_compression: expected",
    ),
    "a ring of nodes": (
        None, lambda m: m.whole["nodes"][0].update(children=[0]), r"nodes\[0\]: more than one node has it",
    ),
    "a node that is not there": (None, lambda m: m.whole["scenes"][0].update(nodes=[7]), "nodes: 7: expected a number"),
    "a mesh that is not there": (None, lambda m: m.whole["nodes"][0].update(mesh="x"), r"nodes\[0\].mesh: x"),
    "a transform that is no number": (
        None, lambda m: m.whole["nodes"][0].update(translation=[0.0, float("nan"), 0.0]), r"nodes\[0\].translation",
    ),
    "a sparse accessor": (None, lambda m: m.whole["accessors"][0].update(sparse={}), "not sparse"),
    "positions of two numbers": (None, lambda m: m.whole["accessors"][0].update(type="VEC2"), "VEC2 of 5126"),
    "a picture that is none": (lambda m: with_texture(m, b"no picture"), None, "image: 10 bytes: expected a picture"),
    "a picture elsewhere": (
        lambda m: with_texture(m, png(np.zeros((4, 4, 3)))),
        lambda m: m.whole["images"].__setitem__(0, {"uri": "a.png"}), r"images\[0\]: a.png: expected a picture in the",
    ),
    "a way to repeat that is no number": (
        lambda m: with_texture(m, png(np.zeros((4, 4, 3)))),
        lambda m: m.whole.update(samplers=[{"wrapS": []}]) or m.whole["textures"][0].update(sampler=0),
        r"textures\[0\].sampler.wrapS: \[\]: expected int",
    ),
    "a vast angle": (
        lambda m: with_texture(m, png(np.zeros((4, 4, 3)))),
        lambda m: m.whole["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"].update(
            extensions={"KHR_texture_transform": {"rotation": 10**400}}
        ), "rotation: inf: expected float",
    ),
    "a vast picture": (lambda m: with_texture(m, vast_png()), None, r"image: \d+ bytes: expected .*400000000"),
}  # fmt: skip


def vast_png():
    """The head of a picture of 400 million pixels."""
    import zlib

    head = struct.pack(">IIBBBBB", 20000, 20000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + head
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(head)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    body = b"IDAT" + zlib.compress(bytes(10))
    return data + struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))


@pytest.mark.parametrize("name", BAD)
@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
def test_a_bad_file_is_refused_with_a_reason(path, name):
    add, change, message = BAD[name]
    made = Made().square()
    for step in (add, change):
        if step:
            step(made)
    made.write(path)
    with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: .*{message}"):
        read_glb(path, pictures=False)


def test_a_file_that_is_cut_short_is_refused_wherever(path):
    whole = Made().square().write(path).read_bytes()
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=f"^{re.escape(str(path))}: .*: expected "):
            read_glb(path)


def test_a_changed_byte_of_the_description_is_an_error_or_another_scene(path):
    """No change makes anything else than a ValueError."""
    whole = Made().square().write(path).read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(2000):
        damaged = bytearray(whole)
        damaged[rng.integers(0, len(whole))] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            parts = read_glb(path)
        except ValueError as error:
            assert str(error).startswith(f"{path}: ")  # noqa: PT017
        else:
            assert all(np.isfinite(part.vertices).all() for part in parts)
            assert all(part.triangles.max() < len(part.vertices) for part in parts)


def test_many_nodes_that_show_one_mesh_have_a_limit(path, monkeypatch):
    monkeypatch.setattr("farside.engine.io.glb_scene.MOST_TRIANGLES", 20)
    made = Made().square()
    made.whole["nodes"] = [{"mesh": 0}] * 11
    made.whole["scenes"] = [{"nodes": list(range(11))}]
    with pytest.raises(ValueError, match="scene: 44 vertices and 22 triangles or more: expected at most"):
        read_glb(made.write(path))
    made.whole["scenes"] = [{"nodes": list(range(10))}]
    assert len(read_glb(made.write(path))) == 10
