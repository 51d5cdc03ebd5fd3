"""Checks of a state that was read from a file: kernels trust the arrays of a model, and would read or write beyond
them. All functions raise ValueError, which names the field, its value and what was expected."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..kernels.background.directions import COLUMNS, ROWS
from ..kernels.background.light import SUMS_SIZE
from ..rig.camera import Camera
from ..settings import Settings
from .atlas import Atlas
from .light import LightState, cells_of
from .maximum_depth import BLOCK
from .state import (
    CameraState,
    CaptureState,
    ExposureState,
    ModelState,
    NumberedAtlas,
    RemainsState,
    SurfaceState,
)
from .tolerances import Tolerances

__all__ = ["check_exposure", "check_model", "check_placed"]

_MOST_PIXELS = 1 << 30  # of a picture
_MOST_NUMBERS = 1 << 16  # of captures and atlases, which are rows of a table


class _Picture(NamedTuple):
    """Where colours of surfaces come from: a capture, the remains of older ones, or an atlas; its width and height; its
    camera (atlas: 0)."""

    kind: str
    width: int
    height: int
    camera: int


def check_model(state: ModelState, rig: Sequence[CameraState]) -> None:
    """Checks a model's state, of a rig as its source announced it."""
    state.check()
    cameras = [_camera(camera, f"cameras[{c}]") for c, camera in enumerate(state.cameras)]
    count = len(cameras)
    _expect(count > 0, "cameras", count, "at least one")
    _expect([c.name for c in rig] == [c.name for c in cameras], "rig", [c.name for c in rig], "the cameras' names")
    _check_scalars(state, count)
    numbers = _check_pictures(state, cameras)
    _check_late(state, cameras)
    keys = set()
    for k, surface in enumerate(state.surfaces):
        _check_surface(surface, f"surfaces[{k}]", count, numbers)
        keys.add((surface.static, surface.capture))
    _expect(len(keys) == len(state.surfaces), "surfaces", len(keys), f"{len(state.surfaces)} of different captures")
    for k, remains in enumerate(state.remains):
        _expect((False, remains.capture) in keys, f"remains[{k}]", remains.capture, "the number of a surface's capture")


def check_placed(placed: Sequence[CameraState], moving: Sequence[int], rig: Sequence[CameraState]) -> None:
    """Checks where the cameras of a rig were seen last, and which of them have moved."""
    count = len(rig)
    _expect(len(placed) == count, "placed", len(placed), f"one for each of {count} cameras")
    for c, (state, announced) in enumerate(zip(placed, rig, strict=True)):
        now, known = _camera(state, f"placed[{c}]"), _camera(announced, f"rig[{c}]")
        _expect(now == dataclasses.replace(known, pose=now.pose), f"placed[{c}]", now, f"{known}, in any pose")
    _expect(set(moving) <= set(range(count)), "moving", moving, f"numbers from 0 to {count - 1}")


def check_exposure(state: ExposureState, count: int) -> None:
    """Checks the state of `exposure.Exposure` for `count` cameras."""
    for c, camera in enumerate(state.cameras):
        if camera is not None:
            _camera(camera, f"exposure.cameras[{c}]")
    near = [k for pair in state.neighbours for k in pair]
    _expect(len(state.cameras) == len(state.neighbours) == count, "exposure.cameras", len(state.cameras), f"{count}")
    _expect(all(0 <= k < count for k in near), "exposure.neighbours", near, f"numbers from 0 to {count - 1}")
    pairs, samples = len(state.pairs), state.samples.shape[1] if state.samples.ndim == 4 else -1
    _shape("exposure.tones", state.tones, (count, 3, 3))
    _shape("exposure.pairs", state.pairs, (pairs, 2))
    _shape("exposure.samples", state.samples, (pairs, samples, 2, 3))
    _shape("exposure.counts", state.counts, (pairs,))
    _within("exposure.pairs", state.pairs, 0, 2 * count)
    _within("exposure.counts", state.counts, 0, samples + 1)
    _expect(bool(np.isfinite(state.tones).all()), "exposure.tones", "a number that is not finite", "finite numbers")


def _check_scalars(state: ModelState, count: int) -> None:
    Settings(**dict(state.settings))  # type: ignore[arg-type]
    names = [name for name, _ in state.tolerances]
    _expect(names == [f.name for f in dataclasses.fields(Tolerances)], "tolerances", names, "the fields of Tolerances")
    values = [value for _, value in state.tolerances]
    _expect(bool(np.isfinite(values).all()) and min(values) >= 0.0, "tolerances", values, "numbers of 0 or more")
    for name in ("first", "rounds", "cast", "current", "looks"):
        _expect(len(getattr(state, name)) == count, name, len(getattr(state, name)), f"one for each of {count} cameras")
    for name in ("moved", "moving", "unseen"):
        found = getattr(state, name)
        _expect(set(found) <= set(range(count)), name, found, f"numbers from 0 to {count - 1}")
    _expect(min(state.looks) >= 0, "looks", state.looks, "0 or more")
    _expect(0 <= state.next < count, "next", state.next, f"0 to {count - 1}")
    _expect(min(state.frames, state.waited, state.geometry) >= 0, "frames", state.frames, "0 or more")
    _shape("changed", state.changed, (count, ROWS, COLUMNS))
    _shape("scene.origin", state.scene.origin, (3,))
    scene = [*state.scene.origin.tolist(), state.scene.baseline, *state.scene.depths]
    _expect(bool(np.isfinite(scene).all()), "scene", scene, "finite numbers")
    state.scene.scene()


def _check_pictures(state: ModelState, cameras: Sequence[Camera]) -> dict[int, _Picture]:
    """The pictures of captures, of what is left of older ones, and of atlases, by number."""
    count, found = len(cameras), dict[int, _Picture]()
    for k, capture in enumerate(state.captures):
        found[capture.capture] = _check_capture(capture, f"captures[{k}]", cameras)
    for k, remains in enumerate(state.remains):
        found[remains.capture] = _check_remains(remains, f"remains[{k}]", count)
    for item in state.atlases:
        found[item.number] = _check_atlas(item)
    total = len(state.captures) + len(state.remains) + len(state.atlases)
    _expect(len(found) == total, "captures", len(found), f"{total} of different numbers")
    _expect(len(state.captures) >= count, "captures", len(state.captures), f"at least {count}")
    odd = [number for number in found if not 0 <= number < _MOST_NUMBERS]
    _expect(not odd, "captures", odd, f"numbers from 0 to {_MOST_NUMBERS - 1}")
    for c, number in enumerate(state.current):
        known = number in found and found[number].kind == "capture" and found[number].camera == c
        _expect(known, f"current[{c}]", number, f"a capture of camera {c}")
    return found


def _check_capture(capture: CaptureState, name: str, cameras: Sequence[Camera]) -> _Picture:
    _expect(0 <= capture.index < len(cameras), f"{name}.index", capture.index, f"0 to {len(cameras) - 1}")
    camera, known = _camera(capture.camera, f"{name}.camera"), cameras[capture.index]
    same = (camera.projection, camera.depth) == (known.projection, known.depth)
    _expect(same, f"{name}.camera", camera, f"the projection and coding of {known}")
    h, w = camera.height, camera.width
    chroma, blocks = ((h + 1) // 2, (w + 1) // 2), (-(-h // BLOCK[0]), -(-w // BLOCK[1]))
    for shape, fields in (((h, w), ("codes", "y", "flags")), (chroma, ("cb", "cr")), (blocks, ("pending", "lone"))):
        for field in fields:
            _shape(f"{name}.{field}", getattr(capture, field), shape)
    if capture.fused.size:
        _shape(f"{name}.fused", capture.fused, (h, w))
    _shape(f"{name}.counts", capture.counts, (2, *blocks))
    _expect(0 <= capture.edge <= camera.depth.max_code, f"{name}.edge", capture.edge, "a number of codes")
    _expect(min(capture.number, capture.turn) >= 0, f"{name}.number", capture.number, "0 or more")
    for field in ("margin_m", "margin_disparity"):
        _expect(getattr(capture, field) >= 0.0, f"{name}.{field}", getattr(capture, field), "0 or more")
    if capture.light is not None:
        _check_light(capture.light, f"{name}.light", cells_of((h, w)))
    return _Picture("capture", w, h, capture.index)


def _check_late(state: ModelState, cameras: Sequence[Camera]) -> None:
    """What cameras have noted for late layers, and their late layers: at most one of each camera."""
    for name, found in (
        ("late", [each.index for each in state.late]), ("remains", [each.index for each in state.remains if each.late])
    ):  # fmt: skip
        expected = f"different numbers from 0 to {len(cameras) - 1}"
        _expect(len(set(found)) == len(found) and set(found) <= set(range(len(cameras))), name, found, expected)
    for k, late in enumerate(state.late):
        camera, name = cameras[late.index], f"late[{k}]"
        size = (camera.height + 1) // 2, (camera.width + 1) // 2
        _shape(f"{name}.codes", late.codes, size)
        _shape(f"{name}.turns", late.turns, size)
        _expect(late.waiting >= 0, f"{name}.waiting", late.waiting, "0 or more")


def _check_light(light: LightState, name: str, cells: tuple[int, ...]) -> None:
    for field, size in (("sums", (SUMS_SIZE,)), ("active", ())):
        array = getattr(light, field)
        _shape(f"{name}.{field}", array, (*cells, *size))
        _expect(bool(np.isfinite(array).all()), f"{name}.{field}", "a number that is not finite", "finite numbers")


def _check_remains(remains: RemainsState, name: str, count: int) -> _Picture:
    _expect(0 <= remains.index < count, f"{name}.index", remains.index, f"0 to {count - 1}")
    h, w = _check_planes(remains, name)
    _shape(f"{name}.codes", remains.codes, (h, w))
    _expect(remains.edge >= 0, f"{name}.edge", remains.edge, "a number of codes")
    _expect(remains.reach > 0, f"{name}.reach", remains.reach, "a number of pixels")
    return _Picture("remains", w, h, remains.index)


def _check_atlas(item: NumberedAtlas) -> _Picture:
    atlas, name = item.atlas, f"atlas {item.number}"
    h, w = _check_planes(atlas, name)
    if atlas.codes.size:
        _shape(f"{name}.codes", atlas.codes, (h, w))
    return _Picture("atlas", w, h, 0)


def _check_planes(picture: RemainsState | Atlas, name: str) -> tuple[int, int]:
    """Height and width of a picture."""
    h, w = picture.y.shape if picture.y.ndim == 2 else (0, 0)
    _expect(h > 0 and w > 0, f"{name}.y", picture.y.shape, "a picture")
    for field in ("cb", "cr"):
        _shape(f"{name}.{field}", getattr(picture, field), ((h + 1) // 2, (w + 1) // 2))
    return h, w


def _check_surface(
    surface: SurfaceState, name: str, count: int, numbers: dict[int, _Picture]
) -> None:
    _expect(surface.capture in numbers, f"{name}.capture", surface.capture, "the number of a capture or atlas")
    kind, width, height, camera = numbers[surface.capture]
    _expect(surface.camera == camera, f"{name}.camera", surface.camera, f"{camera}, as its capture has it")
    _expect(surface.static or kind != "atlas", f"{name}.static", surface.static, "true, as it stems from an atlas")
    _expect(not surface.static or kind != "remains", f"{name}.static", surface.static, "false, as its capture is older")
    points, triangles = len(surface.points), len(surface.triangles)
    _shape(f"{name}.points", surface.points, (points, 3))
    _shape(f"{name}.uv", surface.uv, (points, 2))
    _shape(f"{name}.triangles", surface.triangles, (triangles, 3))
    _shape(f"{name}.marks", surface.marks, (triangles, count // 64 + 1))
    _shape(f"{name}.invalid", surface.invalid, (triangles,))
    _within(f"{name}.triangles", surface.triangles, 0, points)
    _expect(bool(np.isfinite(surface.points).all()), f"{name}.points", "a number that is not finite", "finite numbers")
    _within(f"{name}.uv", surface.uv, -max(width, height), 2 * max(width, height))


def _camera(state: CameraState, name: str) -> Camera:
    try:
        camera = state.camera()
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {error}") from error
    size = camera.width, camera.height
    _expect(all(type(side) is int for side in size) and size[0] * size[1] <= _MOST_PIXELS, f"{name}", size, "a size")
    return camera


def _shape(name: str, array: Any, expected: tuple[int, ...]) -> None:
    _expect(array.shape == expected, name, f"shape {array.shape}", f"{expected}")


def _within(name: str, array: Any, least: int, end: int) -> None:
    """All elements are numbers from `least` on and below `end`; NaN is none."""
    if array.size:
        low, high = array.min(), array.max()
        _expect(bool(low >= least and high < end), name, f"{low} to {high}", f"{least} or more and below {end}")


def _expect(condition: bool, name: str, found: Any, expected: str) -> None:
    if not condition:
        raise ValueError(f"{name}: {str(found)[:80]}: expected {expected}")
