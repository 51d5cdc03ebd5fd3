"""The triangles of a GLB file in the world, with their colours: our own exports (`glb`), and files of other programs.

Metres; glTF's axes (x right, y up, -z forward) become the world's (x forward, y left, z up). Nodes may be moved, turned
and scaled. Of a material the base colour counts, a factor and perhaps a texture; without a texture also the colours of
vertices. Light, transparency, bones and morphing do not count; points and lines are left out.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from .glb_file import GlbFile
from .srgb import encoded

__all__ = ["GlbPart", "read_glb"]

MOST_TRIANGLES, MOST_VERTICES = 1 << 24, 1 << 25
_MOST_PIXELS = 1 << 26  # of a picture: 8192 x 8192
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # glTF's numbers of modes
_REPEAT, _MIRROR, _CLAMP = 10497, 33648, 33071
_WORLD_FROM_GLTF = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class GlbPart:
    """Triangles of one material: vertices float64 [n, 3], metres in the world; triangles int32 [m, 3].

    uv float32 [n, 2], places in the picture, of which 0 to 1 is the whole one, from its upper left corner; picture: the
    encoded file in the GLB; repeats: how it goes on beyond its borders (horizontally, vertically): "clamp", "repeat" or
    "mirror". Both are None without a texture. colours float32 [n, 3]: R'G'B' as in sRGB, from 0 to 1; with a picture, a
    single row, in linear light, that the picture is multiplied with.
    """

    vertices: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int32]
    colours: npt.NDArray[np.float32]
    uv: npt.NDArray[np.float32] | None = None
    picture: bytes | None = None
    repeats: tuple[str, str] = ("clamp", "clamp")


def read_glb(
    given: Path | bytes, *, pictures: bool = True, most: tuple[int, int] | None = None
) -> list[GlbPart]:
    """The parts of a file's scene that have triangles. given: where it is, or its bytes. `pictures` False: only their
    heads are read, for a check. most: triangles and vertices; None: MOST_TRIANGLES and MOST_VERTICES.

    Raises OSError, and ValueError, which names the file, the field, its value and what was expected, for what is not a
    GLB file, is cut short, refers to other files, has positions that are not finite, indices beyond them, no triangles,
    or more than `most` of them.
    """
    try:
        file = GlbFile(given)
        instances = list(_instances(file))
        _check_size(file, instances, *(most or (MOST_TRIANGLES, MOST_VERTICES)))
        parts = [part for mesh, matrix in instances for part in _parts(file, mesh, matrix)]
        if not parts:
            raise ValueError("scene: no triangles: expected some")
        for part in parts if not pictures else ():
            if part.picture is not None:
                open_picture(part.picture)
    except ValueError as error:
        raise ValueError(f"{'mesh' if isinstance(given, bytes) else given}: {error}") from error
    return parts


def open_picture(data: bytes) -> Image.Image:
    """A picture of a part, of which only the head has been read; ValueError if it is none or too large."""
    try:
        image = Image.open(io.BytesIO(data))
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        said = str(error).partition(" <_io")[0]  # without the address of our buffer
        raise ValueError(f"image: {len(data)} bytes: expected a picture ({said})") from error
    if image.width * image.height > _MOST_PIXELS:
        raise ValueError(f"image: {image.width} x {image.height} pixels: expected at most {_MOST_PIXELS}")
    return image


def _instances(file: GlbFile) -> Iterator[tuple[int, npt.NDArray[np.float64]]]:
    """The meshes of the scene with their transforms [4, 4] into glTF's world."""
    scenes = file.field(file.whole, "scenes", list, "scenes", [])
    if scenes:
        number = file.field(file.whole, "scene", int, "scene", 0)
        roots = file.field(file.item("scenes", number, "scene"), "nodes", list, f"scenes[{number}].nodes", [])
    else:
        roots = list(range(len(file.field(file.whole, "nodes", list, "nodes", []))))
        nodes = [file.item("nodes", k, "nodes") for k in roots]
        below = {str(c) for node in nodes for c in file.field(node, "children", list, "nodes.children", [])}
        roots = [k for k in roots if str(k) not in below]
    waiting, seen = [(node, np.eye(4)) for node in reversed(roots)], set[int]()
    while waiting:
        number, above = waiting.pop()
        node, here = file.item("nodes", number, "nodes"), f"nodes[{number}]"
        if number in seen:
            raise ValueError(f"{here}: more than one node has it: expected a tree")
        seen.add(number)
        matrix = above @ _matrix(file, node, here)
        if "mesh" in node:
            file.item("meshes", node["mesh"], f"{here}.mesh")
            yield node["mesh"], matrix
        children = file.field(node, "children", list, f"{here}.children", [])
        waiting += [(child, matrix) for child in reversed(children)]


def _matrix(file: GlbFile, node: Mapping[str, Any], here: str) -> npt.NDArray[np.float64]:
    """A node's own transform [4, 4]."""
    if "matrix" in node:
        flat = file.numbers(node, "matrix", np.eye(4).ravel().tolist(), f"{here}.matrix")
        return np.array(flat).reshape(4, 4).T
    x, y, z, w = file.numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0], f"{here}.rotation")
    scale = file.numbers(node, "scale", [1.0] * 3, f"{here}.scale")
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * scale
    matrix[:3, 3] = file.numbers(node, "translation", [0.0] * 3, f"{here}.translation")
    return matrix


def _primitives(file: GlbFile, mesh: int) -> Iterator[tuple[str, Mapping[str, Any], Mapping[str, Any]]]:
    """A mesh's primitives of triangles: name, primitive and attributes."""
    given = file.field(file.item("meshes", mesh, "mesh"), "primitives", list, f"meshes[{mesh}].primitives")
    for k, primitive in enumerate(given):
        name = f"meshes[{mesh}].primitives[{k}]"
        if file.field(primitive, "mode", int, f"{name}.mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN):
            attributes = file.field(primitive, "attributes", dict, f"{name}.attributes")
            if "POSITION" in attributes:
                yield name, primitive, attributes


def _check_size(
    file: GlbFile, instances: list[tuple[int, npt.NDArray[np.float64]]], most_triangles: int, most_vertices: int
) -> None:
    """The whole size, before anything is made: many nodes may show one mesh."""
    vertices = corners = 0
    for mesh, _ in instances:
        for name, primitive, attributes in _primitives(file, mesh):
            count = file.count(attributes["POSITION"], f"{name}.POSITION")
            vertices += count
            corners += file.count(primitive["indices"], f"{name}.indices") if "indices" in primitive else count
            if vertices > most_vertices or corners > 3 * most_triangles:
                size = f"{vertices} vertices and {corners // 3} triangles"
                raise ValueError(f"scene: {size} or more: expected at most {most_vertices} and {most_triangles}")


def _parts(file: GlbFile, mesh: int, matrix: npt.NDArray[np.float64]) -> Iterator[GlbPart]:
    for name, primitive, attributes in _primitives(file, mesh):
        points = file.array(attributes["POSITION"], f"{name}.POSITION", (3,)).astype(np.float64)
        triangles = _triangles(file, name, primitive, len(points))
        if not len(triangles):
            continue
        vertices = (points @ matrix[:3, :3].T + matrix[:3, 3]) @ _WORLD_FROM_GLTF.T
        if not np.isfinite(vertices).all():
            raise ValueError(f"{name}.POSITION: not finite after the node's transform: expected finite numbers")
        yield _coloured(file, name, primitive, attributes, vertices, triangles)


def _triangles(
    file: GlbFile, name: str, primitive: Mapping[str, Any], count: int
) -> npt.NDArray[np.int32]:  # [m, 3]
    if "indices" in primitive:
        found = file.array(primitive["indices"], f"{name}.indices", (1,)).reshape(-1)
        if found.dtype.kind != "u":
            raise ValueError(f"{name}.indices: {found.dtype}: expected whole numbers of 0 or more")
        if len(found) and int(found.max()) >= count:
            raise ValueError(f"{name}.indices: {int(found.max())}: expected less than {count}, the vertices")
        corners = found.astype(np.int32)
    else:
        corners = np.arange(count, dtype=np.int32)
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if len(corners) < 3:
        return np.empty((0, 3), np.int32)
    if mode == _FAN:
        first = np.full(len(corners) - 2, corners[0], np.int32)
        return np.stack([first, corners[1:-1], corners[2:]], axis=-1)
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=-1)
    strip[1::2] = strip[1::2, [1, 0, 2]]
    return strip


def _coloured(
    file: GlbFile, name: str, primitive: Mapping[str, Any], attributes: Mapping[str, Any],
    vertices: npt.NDArray[np.float64], triangles: npt.NDArray[np.int32],
) -> GlbPart:  # fmt: skip
    material: Mapping[str, Any] = {}
    if "material" in primitive:
        material = file.item("materials", primitive["material"], f"{name}.material")
    here = f"{name}.material.pbrMetallicRoughness"
    surface = file.field(material, "pbrMetallicRoughness", dict, here, {})
    factor = np.array(file.numbers(surface, "baseColorFactor", [1.0] * 4, f"{here}.baseColorFactor")[:3], np.float32)
    if "baseColorTexture" in surface:
        info = file.field(surface, "baseColorTexture", dict, f"{here}.baseColorTexture")
        moved: Any = info.get("extensions", {})
        moved = moved.get("KHR_texture_transform", {}) if isinstance(moved, dict) else {}
        which = file.field(info, "texCoord", int, f"{here}.baseColorTexture.texCoord", 0)
        which = file.field(moved, "texCoord", int, f"{here}.baseColorTexture.texCoord", which)
        if f"TEXCOORD_{which}" in attributes:
            uv = file.array(attributes[f"TEXCOORD_{which}"], f"{name}.TEXCOORD_{which}", (2,)).astype(np.float64)
            _check_count(f"{name}.TEXCOORD_{which}", uv, vertices)
            picture, repeats = _picture(file, info.get("index"), f"{here}.baseColorTexture.index")
            placed = _placed(file, uv, moved, here).astype(np.float32)
            return GlbPart(vertices, triangles, np.clip(factor, 0.0, 1.0)[None], placed, picture, repeats)
    linear = np.broadcast_to(factor, (len(vertices), 3))
    if "COLOR_0" in attributes:
        given = file.array(attributes["COLOR_0"], f"{name}.COLOR_0", (3, 4)).astype(np.float32)
        _check_count(f"{name}.COLOR_0", given, vertices)
        linear = given[:, :3] * factor
    return GlbPart(vertices, triangles, encoded(linear))


def _check_count(name: str, array: npt.NDArray[Any], vertices: npt.NDArray[np.float64]) -> None:
    if len(array) != len(vertices):
        raise ValueError(f"{name}: {len(array)} elements: expected {len(vertices)}, as there are vertices")


def _placed(
    file: GlbFile, uv: npt.NDArray[np.float64], moved: Any, here: str
) -> npt.NDArray[np.float64]:
    """Places after the transform of a texture (extension KHR_texture_transform)."""
    name = f"{here}.KHR_texture_transform"
    turn = file.field(moved, "rotation", float, f"{name}.rotation", 0.0)
    scaled = uv * file.numbers(moved, "scale", [1.0, 1.0], f"{name}.scale")
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.stack([cos * scaled[:, 0] + sin * scaled[:, 1], cos * scaled[:, 1] - sin * scaled[:, 0]], axis=-1)
    placed: npt.NDArray[np.float64] = turned + file.numbers(moved, "offset", [0.0, 0.0], f"{name}.offset")
    return placed


def _picture(file: GlbFile, number: Any, name: str) -> tuple[bytes, tuple[str, str]]:
    """The encoded picture of a texture, and how it goes on beyond its borders."""
    texture = file.item("textures", number, name)
    source, extensions = texture.get("source"), texture.get("extensions", {})
    if source is None and isinstance(extensions, dict):
        source = next((e["source"] for e in extensions.values() if isinstance(e, dict) and "source" in e), None)
    image = file.item("images", source, f"textures[{number}].source")
    if "bufferView" not in image:
        uri = str(image.get("uri"))[:40]
        raise ValueError(f"images[{source}]: {uri}: expected a picture in the file's own buffer, not another file")
    data = bytes(file.view(image["bufferView"], f"images[{source}].bufferView")[0])
    names = {_REPEAT: "repeat", _MIRROR: "mirror", _CLAMP: "clamp"}
    sampler: Mapping[str, Any] = {}
    if "sampler" in texture:
        sampler = file.item("samplers", texture["sampler"], f"textures[{number}].sampler")
    ways = (file.field(sampler, key, int, f"textures[{number}].sampler.{key}", _REPEAT) for key in ("wrapS", "wrapT"))
    across, along = (names.get(way, "repeat") for way in ways)
    return data, (across, along)
