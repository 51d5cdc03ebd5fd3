"""Meshes with vertex colours as files: GLB and PLY."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh

__all__ = ["ColouredMesh", "srgb_from_ycbcr", "to_file", "to_glb", "to_ply"]


@dataclass(frozen=True, slots=True)
class ColouredMesh:
    """vertices float64 [n, 3], world metres in OMAF axes; triangles int32 [m, 3]; colours uint8 [n, 3], sRGB."""

    vertices: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int32]
    colours: npt.NDArray[np.uint8]

    @classmethod
    def joined(cls, parts: list[ColouredMesh]) -> ColouredMesh:
        """One mesh made of several, without the vertices that no triangle uses."""
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        triangles = np.concatenate(
            [np.empty((0, 3), np.int64), *(part.triangles + start for part, start in zip(parts, starts, strict=False))]
        )
        used, renumbered = np.unique(triangles, return_inverse=True)
        vertices = np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)])
        colours = np.concatenate([np.empty((0, 3), np.uint8), *(part.colours for part in parts)])
        return cls(vertices[used], renumbered.reshape(-1, 3).astype(np.int32), colours[used])


def srgb_from_ycbcr(ycbcr: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Y'CbCr [n, 3], BT.709 limited range in 10-bit codes -> R'G'B' uint8 [n, 3]."""
    y = (ycbcr[:, 0] - 64.0) / 876.0
    cb, cr = (ycbcr[:, 1] - 512.0) / 896.0, (ycbcr[:, 2] - 512.0) / 896.0
    rgb = np.stack([y + 1.5748 * cr, y - 0.1873 * cb - 0.4681 * cr, y + 1.8556 * cb], axis=-1)
    codes: npt.NDArray[np.uint8] = np.rint(np.clip(rgb, 0.0, 1.0) * 255.0).astype(np.uint8)
    return codes


def to_file(mesh: ColouredMesh, file_format: str) -> bytes:
    """A mesh as the bytes of a file; `file_format`: glb or ply, ValueError for another one."""
    writers = {"glb": to_glb, "ply": to_ply}
    if file_format not in writers:
        raise ValueError(f"format: {file_format!r}: expected one of {', '.join(writers)}")
    return writers[file_format](mesh)


def to_glb(mesh: ColouredMesh) -> bytes:
    """glTF binary; metres, glTF's axes (x right, y up, -z forward).

    glTF's positions are single precision. They are therefore relative to the middle of the mesh, and the node's
    transform moves them back.
    """
    x, y, z = mesh.vertices.T
    vertices = np.stack([-y, z, -x], axis=-1)
    move = np.eye(4)
    if len(vertices):
        move[:3, 3] = np.rint(0.5 * (vertices.min(axis=0) + vertices.max(axis=0)))
    whole = trimesh.Trimesh(
        vertices - move[:3, 3], mesh.triangles, vertex_colors=mesh.colours, process=False, validate=False
    )
    scene = trimesh.Scene()
    scene.add_geometry(whole, transform=move)
    data = scene.export(file_type="glb")  # type: ignore[no-untyped-call]
    assert isinstance(data, bytes)
    return data


def to_ply(mesh: ColouredMesh) -> bytes:
    """Binary PLY; metres in double precision, the world's axes (x forward, y left, z up)."""
    vertices = np.empty(len(mesh.vertices), [("position", "<f8", 3), ("colour", "u1", 3)])
    vertices["position"], vertices["colour"] = mesh.vertices, mesh.colours
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    header = [
        "ply", "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}", *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in ("red", "green", "blue")),
        f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n",
    ]  # fmt: skip
    return "\n".join(header).encode() + vertices.tobytes() + faces.tobytes()
