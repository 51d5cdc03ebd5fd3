"""Meshes with colours, for export: at their vertices, or in pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["ColouredMesh", "TexturePage", "TexturedMesh", "TexturedPart", "srgb_from_ycbcr", "ycbcr_from_srgb"]


@dataclass(frozen=True, slots=True)
class ColouredMesh:
    """Triangles with a colour at each vertex.

    vertices float64 [n, 3], world metres in OMAF axes (x forward, y left, z up); triangles int32 [m, 3]; colours
    float32 [n, 3], R'G'B' as in sRGB, from 0 to 1.
    """

    vertices: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int32]
    colours: npt.NDArray[np.float32]

    @classmethod
    def joined(cls, parts: list[ColouredMesh]) -> ColouredMesh:
        """One mesh made of several, without the vertices that no triangle uses."""
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        triangles = np.concatenate(
            [np.empty((0, 3), np.int64), *(part.triangles + start for part, start in zip(parts, starts, strict=False))]
        )
        used, renumbered = np.unique(triangles, return_inverse=True)
        vertices = np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts)])
        colours = np.concatenate([np.empty((0, 3), np.float32), *(part.colours for part in parts)])
        return cls(vertices[used], renumbered.reshape(-1, 3).astype(np.int32), colours[used])


@dataclass(frozen=True, slots=True)
class TexturePage:
    """A picture in which the colours of many surfaces lie: JPEG bytes, R'G'B' as in sRGB; its size in pixels."""

    jpeg: bytes
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class TexturedPart:
    """Triangles whose colours lie in one page.

    vertices float64 [n, 3] and triangles int32 [m, 3] as in `ColouredMesh`; uv float32 [n, 2]: each vertex's place in
    the page, in pixels from its upper left corner (pixel centres at +0.5).
    """

    vertices: npt.NDArray[np.float64]
    triangles: npt.NDArray[np.int32]
    uv: npt.NDArray[np.float32]
    picture: TexturePage


@dataclass(frozen=True, slots=True)
class TexturedMesh:
    """Triangles with pictures: a part for each page."""

    parts: tuple[TexturedPart, ...]


def srgb_from_ycbcr(ycbcr: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Y'CbCr [n, 3], BT.709 limited range in 10-bit codes -> R'G'B' float32 [n, 3] from 0 to 1, clipped."""
    y = (ycbcr[:, 0] - 64.0) / 876.0
    cb, cr = (ycbcr[:, 1] - 512.0) / 896.0, (ycbcr[:, 2] - 512.0) / 896.0
    rgb = np.stack([y + 1.5748 * cr, y - 0.1873 * cb - 0.4681 * cr, y + 1.8556 * cb], axis=-1)
    clipped: npt.NDArray[np.float32] = np.clip(rgb, 0.0, 1.0).astype(np.float32)
    return clipped


def ycbcr_from_srgb(rgb: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """The inverse of `srgb_from_ycbcr`: R'G'B' [n, 3] -> Y'CbCr float32 [n, 3]."""
    y = rgb @ np.array([0.2126, 0.7152, 0.0722])
    cb, cr = (rgb[:, 2] - y) / 1.8556, (rgb[:, 0] - y) / 1.5748
    codes: npt.NDArray[np.float32] = np.stack([64.0 + 876.0 * y, 512.0 + 896.0 * cb, 512.0 + 896.0 * cr], axis=-1)
    return codes.astype(np.float32)
