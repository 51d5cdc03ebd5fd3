"""What 3D effects show, from the bytes of files: pictures for projectors, and meshes to add. Loads no compiler."""

from __future__ import annotations

import dataclasses
import io
import warnings
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from PIL import ExifTags, Image

from .glb_scene import GlbPart, read_glb

__all__ = ["MOST_BYTES", "MOST_TRIANGLES", "EffectContent", "read_mesh", "read_picture"]

EffectContent = npt.NDArray[np.uint8] | Sequence[GlbPart]
"""Of a projector: a picture's R'G'B' with alpha, uint8 [h, w, 4]. Of an added mesh: its parts."""

MOST_BYTES = 32 << 20  # of a file
MOST_TRIANGLES = 1 << 18
_MOST_PIXELS = 1 << 26  # of a picture: 8192 x 8192
_SIDE = 2048  # larger pictures are reduced
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180, 4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE, 6: Image.Transpose.ROTATE_270, 7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}  # by EXIF's orientation
_AMBIENT = 0.6  # share of light that does not depend on a triangle's normal
_LIGHT = np.array([-0.48, 0.36, 0.8])  # where the rest comes from: above, a little from behind and from the left


def read_picture(data: bytes) -> npt.NDArray[np.uint8]:  # [h, w, 4]
    """R'G'B' with alpha of a PNG or JPEG picture, reduced to at most 2048 pixels on each side.

    Raises ValueError, which says what was expected, for anything else, and for one that is too large.
    """
    _check_size("picture", data)
    with warnings.catch_warnings(action="ignore"):  # what is wrong and matters is an error
        try:
            image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
            if image.width * image.height > _MOST_PIXELS:
                raise ValueError(f"picture: {image.width} x {image.height} pixels: expected at most {_MOST_PIXELS}")
            if image.mode in ("L", "LA", "RGB", "RGBA"):  # before it takes four bytes a pixel; others have no means
                image.thumbnail((_SIDE, _SIDE), Image.Resampling.BOX)
            found = image.convert("RGBA")
        except (OSError, SyntaxError, Image.DecompressionBombError) as error:
            said = str(error).partition(" <_io")[0]  # without the address of our buffer
            raise ValueError(f"picture: {len(data)} bytes: expected a whole PNG or JPEG picture ({said})") from error
        found.thumbnail((_SIDE, _SIDE), Image.Resampling.BOX)
        turn = _turn(image)
    return np.array(found if turn is None else found.transpose(turn))


def _turn(image: Image.Image) -> Image.Transpose | None:
    """How a picture that was loaded is to be turned; None: not, or its EXIF data are damaged."""
    try:
        return _TURNS.get(image.getexif().get(ExifTags.Base.Orientation, 1))
    except Exception:  # Pillow's reader of EXIF raises anything, which is no reason to refuse the picture
        return None


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
