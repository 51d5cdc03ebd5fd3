"""Meshes as files: GLB (`glb`) and PLY."""

from __future__ import annotations

import numpy as np

from .coloured_meshes import ColouredMesh, TexturedMesh
from .glb import to_glb

__all__ = ["COLOURS", "FORMATS", "colours_of", "to_file", "to_ply"]

FORMATS = ("glb", "ply")
COLOURS = ("texture", "vertex")  # where a file may hold its colours


def colours_of(file_format: str, colours: str | None = None) -> str:
    """Where a file of this format (`FORMATS`) holds its colours: `colours` (`COLOURS`), or if that is None in a texture
    for glb, and at the vertices for ply. Raises ValueError for other values, and for a texture in ply."""
    if file_format not in FORMATS:
        raise ValueError(f"format: {file_format!r}: expected one of {', '.join(FORMATS)}")
    if colours is None:
        return "vertex" if file_format == "ply" else "texture"
    if colours not in COLOURS:
        raise ValueError(f"colours: {colours!r}: expected one of {', '.join(COLOURS)}")
    if file_format == "ply" and colours != "vertex":
        raise ValueError(f"colours: {colours!r}: expected vertex for ply, which holds no pictures")
    return colours


def to_file(mesh: ColouredMesh | TexturedMesh, file_format: str) -> bytes:
    """A mesh as the bytes of a file, `file_format`: glb (`glb.to_glb`) or ply (`to_ply`).

    Raises ValueError for another format, for a `TexturedMesh` as ply, and for a mesh that the format cannot hold.
    """
    colours_of(file_format, "texture" if isinstance(mesh, TexturedMesh) else "vertex")
    if isinstance(mesh, TexturedMesh) or file_format == "glb":
        return to_glb(mesh)
    return to_ply(mesh)


def to_ply(mesh: ColouredMesh) -> bytes:
    """Binary PLY: metres in double precision, the world's axes (x forward, y left, z up); colours are sRGB, 8 bits."""
    vertices = np.empty(len(mesh.vertices), [("position", "<f8", 3), ("colour", "u1", 3)])
    vertices["position"], vertices["colour"] = mesh.vertices, np.rint(mesh.colours * np.float32(255.0))
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    header = [
        "ply", "format binary_little_endian 1.0",
        "comment Farside: metres; x forward, y left, z up; colours of vertices in sRGB",
        f"element vertex {len(vertices)}", *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in ("red", "green", "blue")),
        f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n",
    ]  # fmt: skip
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes()
