"""What 3D effects show, from the bytes of files: pictures for projectors, and meshes to add. Loads no compiler."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps

from .glb_scene import GlbPart, read_glb

__all__ = ["MOST_BYTES", "MOST_TRIANGLES", "EffectContent", "read_mesh", "read_picture"]

EffectContent = npt.NDArray[np.uint8] | Sequence[GlbPart]
"""Of a projector: a picture's R'G'B' with alpha, uint8 [h, w, 4]. Of an added mesh: its parts."""

MOST_BYTES = 32 << 20  # of a file
MOST_TRIANGLES = 1 << 18
_MOST_PIXELS = 1 << 26  # of a picture: 8192 x 8192
_SIDE = 2048  # larger pictures are reduced
_AMBIENT = 0.6  # share of light that does not depend on a triangle's normal
_LIGHT = np.array([-0.48, 0.36, 0.8])  # where the rest comes from: above, a little from behind and from the left


def read_picture(data: bytes) -> npt.NDArray[np.uint8]:  # [h, w, 4]
    """R'G'B' with alpha of a PNG or JPEG picture, reduced to at most 2048 pixels on each side.

    Raises ValueError, which says what was expected, for anything else, and for one that is too large.
    """
    _check_size("picture", data)
    try:
        image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
        if image.width * image.height > _MOST_PIXELS:
            raise ValueError(f"picture: {image.width} x {image.height} pixels: expected at most {_MOST_PIXELS}")
        upright = ImageOps.exif_transpose(image).convert("RGBA")
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"picture: {len(data)} bytes: expected a whole PNG or JPEG picture ({error})") from error
    if max(upright.size) > _SIDE:
        upright.thumbnail((_SIDE, _SIDE), Image.Resampling.BOX)
    return np.array(upright)


def read_mesh(data: bytes) -> tuple[GlbPart, ...]:
    """The parts of a GLB file (`glb_scene`). One that has a single colour, and no picture, is lit, as else only its
    outline would be seen.

    Raises ValueError, which says what was expected, for anything else, and for one that is too large.
    """
    _check_size("mesh", data)
    parts = read_glb(data, pictures=False, most=(MOST_TRIANGLES, 3 * MOST_TRIANGLES))
    return tuple(_lit(part) if part.picture is None and _is_plain(part) else part for part in parts)


def _check_size(name: str, data: bytes) -> None:
    if len(data) > MOST_BYTES:
        raise ValueError(f"{name}: {len(data)} bytes: expected at most {MOST_BYTES}")


def _is_plain(part: GlbPart) -> bool:
    return bool((part.colours == part.colours[:1]).all())


def _lit(part: GlbPart) -> GlbPart:
    """A part whose triangles are lit from one direction, each from its outside; their corners are set apart."""
    corners = part.vertices[part.triangles]  # [m, 3, 3]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    light = _AMBIENT + (1.0 - _AMBIENT) * np.maximum(normals @ _LIGHT, 0.0)
    colours = np.repeat(part.colours[:1] * light[:, None], 3, axis=0).astype(np.float32)
    flat = np.arange(3 * len(part.triangles), dtype=np.int32).reshape(-1, 3)
    return dataclasses.replace(part, vertices=corners.reshape(-1, 3), triangles=flat, colours=colours)
