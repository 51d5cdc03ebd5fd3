"""Seeds from files: saved models, and GLB files of any program."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from ..geometry.refinement import refined
from ..io.coloured_meshes import ycbcr_from_srgb
from ..io.glb_scene import GlbPart, open_picture, read_glb
from ..io.saved_file import is_saved
from ..io.srgb import encoded, linear
from ..rig.texture import from_rgb
from ..support.array_types import F32, F64, I32, U8
from .atlas import Atlas
from .saved_model import SavedModel
from .seed import Seed, SeedPart
from .state import SurfaceState
from .textured_mesh import within_pixels

__all__ = ["read_seed", "seed_of", "seed_of_parts"]

_SIDE = 4096  # of an atlas, pixels; larger pictures are reduced
_MARGIN, _BEFORE = 256, 8  # pixels by which a picture that repeats is continued, behind and before
_PATCH = 4  # side of the part of an atlas that holds the colours of one triangle without a picture
_MOST_PIXELS = 1 << 29  # of all atlases


def read_seed(path: Path) -> Seed:
    """The seed in a file: a saved model, else a GLB file (`io.glb_scene`).

    Raises OSError, and ValueError, which names the file, the field, its value and what was expected.
    """
    if is_saved(path):
        seed = seed_of(SavedModel.read(path))
    else:
        parts = read_glb(path)
        try:
            seed = seed_of_parts(parts)
        except (OSError, ValueError) as error:  # a picture is damaged, or too large
            raise ValueError(f"{path}: {error}") from error
    if not seed.parts:
        raise ValueError(f"{path}: triangles: none: expected some")
    return seed


def seed_of_parts(parts: Sequence[GlbPart]) -> Seed:
    """The parts of a GLB file with their colours in atlases; OSError or ValueError for a picture that is damaged or too
    large."""
    return Seed((*_textured(parts), *_painted([part for part in parts if part.picture is None])))


def seed_of(saved: SavedModel) -> Seed:
    """The valid triangles of a saved model, with the pictures of its captures as atlases."""
    model = saved.model
    atlases = {item.number: item.atlas for item in model.atlases}
    for c in model.captures:
        atlases[c.capture] = Atlas(c.y, c.cb, c.cr, c.codes, c.edge, c.camera.camera().wraps, scattered=False)
    for r in model.remains:
        atlases[r.capture] = Atlas(r.y, r.cb, r.cr, r.codes, r.edge, wraps=False, scattered=True)
    seeds = {item.number for item in model.atlases}
    parts = []
    for number, atlas in sorted(atlases.items()):
        surfaces = [surface for surface in model.surfaces if surface.capture == number]
        if part := _joined(surfaces, model.scene.origin, atlas, is_seed=number in seeds):
            parts.append(part)
    return Seed(tuple(parts))


def _joined(surfaces: Sequence[SurfaceState], origin: F64, atlas: Atlas, *, is_seed: bool) -> SeedPart | None:
    """The valid triangles of surfaces with the same atlas; None if there are none. is_seed: they stem from a seed,
    whose rims have been seen to."""
    starts = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
    triangles: list[npt.NDArray[np.int64]] = [np.empty((0, 3), np.int64)]
    for surface, start in zip(surfaces, starts, strict=False):
        triangles.append(surface.triangles[surface.invalid == 0] + start)
    whole = np.concatenate(triangles)
    if not len(whole):
        return None
    uv = np.concatenate([surface.uv for surface in surfaces])
    if not is_seed:
        uv = within_pixels(uv, whole)
    used, renumbered = np.unique(whole, return_inverse=True)
    points = np.concatenate([surface.points for surface in surfaces])[used]
    return SeedPart(points + origin, renumbered.reshape(-1, 3).astype(np.int32), uv[used], atlas)


def _textured(parts: Sequence[GlbPart]) -> list[SeedPart]:
    """Parts with pictures; those with the same one share an atlas."""
    groups: dict[tuple[bytes, tuple[str, str], bytes], list[GlbPart]] = {}
    for part in parts:
        if part.picture is not None:
            groups.setdefault((part.picture, part.repeats, part.colours.tobytes()), []).append(part)
    made, pixels = [], 0
    for (picture, repeats, _), group in groups.items():
        starts = np.cumsum([0, *(len(part.vertices) for part in group)])
        vertices = np.concatenate([part.vertices for part in group])
        triangles = np.concatenate([part.triangles + start for part, start in zip(group, starts, strict=False)])
        uv = np.concatenate([part.uv for part in group if part.uv is not None]).astype(np.float64)
        made.append(_with_picture(vertices, triangles.astype(np.int32), uv, picture, repeats, group[0].colours[0]))
        pixels += made[-1].atlas.y.size
        if pixels > _MOST_PIXELS:
            raise ValueError(f"images: {pixels} pixels or more: expected at most {_MOST_PIXELS} in all")
    return made


def _with_picture(
    vertices: F64, triangles: I32, uv: F64, picture: bytes, repeats: tuple[str, str], factor: F32
) -> SeedPart:
    rgb = _tinted(_decoded(picture, _SIDE - _MARGIN - _BEFORE), factor)
    inside = uv.min(axis=0) >= 0.0, uv.max(axis=0) <= 1.0
    goes_on = [repeats[k] != "clamp" and not (inside[0][k] and inside[1][k]) for k in range(2)]
    for k in range(2):
        if repeats[k] == "clamp":
            uv[:, k] = np.clip(uv[:, k], 0.0, 1.0)
        elif goes_on[k] and repeats[k] == "mirror":
            rgb = np.concatenate([rgb, np.flip(rgb, 1 - k)], axis=1 - k)
            uv[:, k] *= 0.5
    if max(rgb.shape[:2]) > _SIDE - _MARGIN - _BEFORE and any(goes_on):
        rgb = _reduced(Image.fromarray(rgb), _SIDE - _MARGIN - _BEFORE)
    size = np.array(rgb.shape[1::-1], np.float64)
    places = (uv * size).astype(np.float32)
    if any(goes_on):
        vertices, triangles, places = _unrolled(vertices, triangles, places, size, goes_on)
        room = [(_BEFORE, _MARGIN) if goes_on[1 - axis] else (0, 0) for axis in range(2)]
        rgb = np.pad(rgb, (*room, (0, 0)), mode="wrap")
        places += np.array([room[1][0], room[0][0]], np.float32)
    texture = from_rgb(np.ascontiguousarray(rgb))
    return SeedPart(vertices, triangles, places, Atlas.of_parts(texture.y, texture.cb, texture.cr))


def _unrolled(
    vertices: F64, triangles: I32, places: F32, size: F64, goes_on: Sequence[bool]
) -> tuple[F64, I32, F32]:
    """Triangles moved, each by whole pictures, to where the picture begins."""
    vertices, triangles, places = refined(vertices, triangles, places, np.inf, 1.0, float(_MARGIN - _BEFORE))
    shift = np.floor(places[triangles].min(axis=1) / size).astype(np.int64) * np.array(goes_on)
    pairs = np.concatenate(
        [triangles.reshape(-1, 1), np.repeat(shift, 3, axis=0)], axis=1
    )  # a vertex of triangles that are moved differently lies at several places
    used, renumbered = np.unique(pairs, axis=0, return_inverse=True)
    moved = (places[used[:, 0]] - used[:, 1:] * size).astype(np.float32)
    return vertices[used[:, 0]], renumbered.reshape(-1, 3).astype(np.int32), moved


def _decoded(picture: bytes, side: int) -> U8:
    """A picture's R'G'B' [h, w, 3], reduced to at most `side` pixels."""
    try:
        image = open_picture(picture).convert("RGB")
    except (OSError, SyntaxError) as error:
        raise ValueError(f"image: {len(picture)} bytes: expected a whole picture ({error})") from error
    return _reduced(image, side)


def _reduced(image: Image.Image, side: int) -> U8:
    if max(image.size) > side:
        image.thumbnail((side, side), Image.Resampling.BOX)
    return np.array(image)  # writable: kernels are compiled anew for arrays that are not


def _tinted(rgb: U8, factor: F32) -> U8:
    """A picture multiplied with a factor of linear light, in R'G'B'."""
    if (factor == 1.0).all():
        return rgb
    light = linear(np.arange(256) / 255.0)
    tables = np.rint(255.0 * encoded((light[:, None] * factor).astype(np.float32))).astype(np.uint8)
    return np.stack([tables[rgb[..., k], k] for k in range(3)], axis=-1)


def _painted(parts: Sequence[GlbPart]) -> list[SeedPart]:
    """Parts without pictures: each triangle gets a patch of an atlas, in which its vertices' colours fade evenly."""
    most = (_SIDE // _PATCH) ** 2
    made = []
    for part in parts:
        for start in range(0, len(part.triangles), most):
            some = part.triangles[start : start + most]
            made.append(_with_patches(part.vertices, some, part.colours))
    return made


def _with_patches(vertices: F64, triangles: I32, colours: F32) -> SeedPart:
    columns = min(_SIDE // _PATCH, max(1, int(np.ceil(np.sqrt(len(triangles))))))
    rows = -(-len(triangles) // columns)
    number = np.arange(len(triangles))
    left, top = number % columns * _PATCH, number // columns * _PATCH
    corners = ycbcr_from_srgb(colours)[triangles]  # [m, 3, 3]
    # Corners lie on the centres of chroma samples, so that neither luma nor chroma of other patches is mixed in.
    inner = np.array([[1.0, 1.0], [3.0, 1.0], [1.0, 3.0]], np.float32)
    uv = inner + np.stack([left, top], axis=-1)[:, None].astype(np.float32)
    planes = []
    for k, step in enumerate((1, 2, 2)):
        side = _PATCH // step
        place = (np.arange(side) + 0.5) * step
        b, c = (place[None, :] - 1.0) / 2.0, (place[:, None] - 1.0) / 2.0
        values = corners[:, 0, k, None, None] * (1.0 - b - c)
        values = values + corners[:, 1, k, None, None] * b + corners[:, 2, k, None, None] * c
        plane = np.zeros((rows * columns, side, side), np.uint16)
        plane[: len(triangles)] = np.rint(np.clip(values, 0.0, 1023.0))
        whole: npt.NDArray[np.uint16] = plane.reshape(rows, columns, side, side).swapaxes(1, 2)
        planes.append(whole.reshape(rows * side, columns * side))
    flat = np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3)
    return SeedPart(vertices[triangles].reshape(-1, 3), flat, uv.reshape(-1, 2), Atlas.of_parts(*planes))
