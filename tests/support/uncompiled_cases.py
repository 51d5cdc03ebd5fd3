"""Small runs of all kernels, to compare their results compiled and not compiled (NUMBA_DISABLE_JIT=1).

    NUMBA_DISABLE_JIT=1 python -m support.uncompiled_cases OUT.npz

writes the arrays of all cases, and `modules`: the kernel files of which any function ran, according to a profiler.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from farside.engine.geometry.completion import complete
from farside.engine.geometry.minification import Level, halved
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.triangulation import TriangulationOptions, depth_cuts, triangulate
from farside.engine.geometry.triangulator import Triangulator
from farside.engine.io.images import encode_jpeg
from farside.engine.kernels.base import view_table
from farside.engine.kernels.base.project import project_pixels
from farside.engine.kernels.base.sight import looks_through, shows
from farside.engine.kernels.evaluation.depth_noise import perturb_codes
from farside.engine.kernels.evaluation.metrics import match_errors, similarity_rows
from farside.engine.kernels.evaluation.silhouettes import FINE, silhouette_offsets, thin_structures
from farside.engine.kernels.rendering.added_mesh import ADDED, ColouredTriangles
from farside.engine.kernels.rendering.projector import ProjectedPicture
from farside.engine.kernels.synth import patterns
from farside.engine.kernels.synth.trace import SceneArrays, TracedPicture, trace_picture
from farside.engine.rendering.antialiasing import smooth_outlines
from farside.engine.rendering.effects import Effects, levels_of_texture
from farside.engine.rendering.filling import fill
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture, View
from farside.engine.rig.texture import from_rgb, to_rgb, toned_texture
from farside.engine.synth.parts import Palette, box, capsule, cylinder, ellipsoid, pack, turn
from support import uncompiled_background

Arrays = dict[str, np.ndarray]

CODING = DepthCoding(0.5, 20.0, 12, has_invalid=True)
ORIGIN = np.zeros(3)
FLAT = Perspective.from_fov(70, 40, 1.4)
ROUND = Equirectangular(72, 36, (-math.pi, math.pi), (-0.5 * math.pi, 0.5 * math.pi))
OPTIONS = TriangulationOptions(0.01, 0.2)


def view(projection: Perspective | Equirectangular, y: float, seed: int = 0) -> View:
    """A view by a camera at (0, y, 0) of a wall, a ball in front of it and a few pixels without depth."""
    rng = np.random.default_rng(seed)
    camera = Camera(f"v{seed}", projection, Pose((0.0, y, 0.0)), CODING)
    h, w = camera.height, camera.width
    v, u = np.mgrid[0:h, 0:w] + 0.5
    ball = np.hypot(u - 0.45 * w + 6.0 * y, v - 0.5 * h) < 0.2 * h
    depth = np.where(ball, 1.5, 4.0 + 0.02 * u + 0.01 * v)
    codes = CODING.codes(depth)
    codes[rng.random((h, w)) < 0.02] = 0
    luma = (500 + 200 * np.sin(0.9 * u) * np.cos(0.6 * v) + 100 * ball).astype(np.uint16)
    half = ((h + 1) // 2, (w + 1) // 2)
    chroma = [rng.integers(400, 600, half).astype(np.uint16) for _ in range(2)]
    return View(camera, Texture(luma, *chroma), codes)


def solids() -> Iterator[tuple[str, np.ndarray]]:
    """A traced picture of one solid of each kind, in all patterns."""
    palette = Palette(3)
    numbers = [palette.add(pattern, (0.6, 0.4, 0.2), scale=0.3) for pattern in range(8)]
    assert patterns.PICTURE in range(8)
    groups = [
        [
            box(numbers[0], (3.0, 0.9, 0.0), (0.8, 0.8, 0.8), turn(0.4)),
            ellipsoid(numbers[1], (3.0, -0.9, 0.2), (0.4, 0.5, 0.6)),
        ],
        [
            cylinder(numbers[2], (3.0, 0.0, -0.8), 0.3, 1.0),
            capsule(numbers[3], (2.5, -0.4, -0.6), (2.5, 0.5, -0.5), 0.15),
        ],
        [box(numbers[k], (6.0, 1.6 * (k - 5.5), 0.0), (0.2, 1.6, 4.0)) for k in range(4, 8)],
    ]
    lamps = np.array([[0.0, 0.0, 3.0, 0.8, 3.0, 1.0, 0.8, 0.6]])
    scene = SceneArrays(*pack(groups), palette.packed(), lamps)
    camera = Camera("c", Perspective.from_fov(22, 16, 1.2), Pose(), CODING)
    out = TracedPicture(
        np.zeros((16, 22), np.uint16), np.zeros((8, 11), np.uint16), np.zeros((8, 11), np.uint16),
        np.zeros((16, 22), np.uint16),
    )  # fmt: skip
    trace_picture(camera.packed(), CODING.packed(), scene, 0, 1, out)
    trace_picture(camera.packed(), CODING.packed(), scene, 1, 1, out)  # only blocks that later groups touch
    yield from zip(TracedPicture._fields, out, strict=True)


def meshes() -> Iterator[tuple[str, np.ndarray]]:
    """Triangulated views: error-bounded, two triangles for each quad, masked, with rims; again after a change."""
    for projection in (FLAT, ROUND):
        seen = view(projection, 0.0)
        keep = np.zeros(seen.codes.shape, np.uint8)
        keep[5:30, 8:50] = 1
        name = type(projection).__name__
        variants: dict[str, dict[str, Any]] = {"surface": {}, "kept": {"keep": keep}, "rims": {"rims": True}}
        for label, options in variants.items():
            mesh = triangulate(seen.camera, seen.codes, OPTIONS, **options)
            yield f"{name} {label} points", mesh.points
            yield f"{name} {label} triangles", mesh.triangles
        exact = TriangulationOptions(0.0, 0.2, extend_edges=True)
        mesh = triangulate(seen.camera, seen.codes, exact)
        yield f"{name} exact points", mesh.points
        triangulator, changed = Triangulator(), seen.codes.copy()
        triangulator.triangulate(seen.camera, seen.codes, OPTIONS)
        changed[30:33, 40:60] += 60
        mesh, cuts = triangulator.triangulate(seen.camera, changed, OPTIONS)
        yield f"{name} changed triangles", mesh.triangles
        yield f"{name} changed cuts", cuts


def completed() -> Iterator[tuple[str, np.ndarray]]:
    """Completed depth."""
    result = complete(view(FLAT, 0.0), 0.2)
    yield "codes", result.codes
    assert result.doubtful is not None
    yield "doubtful", result.doubtful


def pictures() -> Iterator[tuple[str, np.ndarray]]:
    """Three drawn views, a backdrop, the variants of shading, and filled holes; perspective and spherical."""
    for projection, small in (
        (FLAT, Perspective.from_fov(46, 34, 1.2)),
        (ROUND, dataclasses.replace(ROUND, width=48, height=24)),
    ):
        name = type(projection).__name__
        prepared = [PreparedView(view(projection, 0.15 * k, k), OPTIONS, ORIGIN, completes=True) for k in range(3)]
        target = Target(Camera("t", small, Pose((0.1, -0.4, 0.0)), CODING), ORIGIN)
        for label, blend, cubic, prefilter in (
            ("one", 1, False, False),
            ("blend", 3, True, False),
            ("prefilter", 2, False, True),
        ):
            yield from (
                (f"{name} {label} {key}", value)
                for key, value in _picture(prepared, target, small, blend, cubic, prefilter)
            )


def _picture(
    prepared: list[PreparedView],
    target: Target,
    size: Perspective | Equirectangular,
    blend: int,
    cubic: bool,
    prefilter: bool,
) -> Iterator[tuple[str, np.ndarray]]:
    canvas = Canvas(size.width, size.height)
    canvas.clear()
    canvas.grey()
    for number, each in enumerate(prepared[:2]):
        canvas.draw(each.mesh(), target, number, 0.05, 0.01)
    canvas.draw_holes("rims", prepared[:2], target, 0.05)
    backdrop = PreparedView(view(prepared[0].view.camera.projection, -0.5, 5), OPTIONS, ORIGIN)
    present = ViewTable(prepared, drawn=2)
    canvas.draw_backdrop(backdrop, present, [0, 1], target, 0.05, (0.0, 0.001), (0.05, 0.0))
    yield "disparity", canvas.disparity.copy()
    yield "winner", canvas.winner.copy()
    assert (canvas.winner[canvas.disparity > 0] > 1).any()  # drawn by what no drawn view has
    table = ViewTable([*prepared[:2], backdrop, *prepared], drawn=2)
    canvas.shade(target, table, 2, blend, cubic=cubic, prefilter=prefilter)
    if isinstance(size, Perspective):
        marks = canvas.silhouettes(0.02)
        fine = Canvas(2 * size.width, 2 * size.height)
        fine.clear(marks)
        twice = Target(Camera("t", size.scaled(2.0), Pose((0.1, -0.4, 0.0)), CODING), ORIGIN)
        for number, each in enumerate(prepared[:2]):
            fine.draw(each.mesh(), twice, number, 0.05, 0.01)
        fine.shade(twice, table, 2, blend)
        canvas.average(fine)
    disparity = canvas.disparity.copy()
    disparity[6:12, 10:18] = 0.0
    fill(disparity, canvas.planes, 0.01)
    for plane, label in zip(canvas.planes, canvas.planes._fields, strict=True):
        yield label, plane.copy()
    texture = smooth_outlines(canvas.texture(), canvas.disparity, 0.05)
    yield "texture", texture.y


def halves() -> Iterator[tuple[str, np.ndarray]]:
    """A view at half its size."""
    seen = view(FLAT, 0.0)
    texture, cuts = seen.texture, depth_cuts(seen.camera, seen.codes, OPTIONS)
    level = halved(Level(seen.camera, seen.codes, texture.y, texture.cb, texture.cr, cuts), OPTIONS)
    assert level is not None
    yield "codes", level.codes
    yield "y", level.y


def colours() -> Iterator[tuple[str, np.ndarray]]:
    """Colour conversion, tones and the planes of a JPEG picture."""
    texture = view(FLAT, 0.0).texture
    rgb = to_rgb(texture)
    yield "rgb", rgb
    yield "back", from_rgb(rgb).cb
    yield "toned", toned_texture(texture, (1.1, -5.0, 0.9, 0.02, 30.0, 1.0, 0.0, 3.0)).cr
    yield "jpeg", np.frombuffer(encode_jpeg(texture), np.uint8)


def effects() -> Iterator[tuple[str, np.ndarray]]:
    """A picture thrown onto a surface, and a triangle before it; perspective and spherical."""
    for projection in (FLAT, ROUND):
        name, seen = type(projection).__name__, view(projection, 0.0)
        target = Target(seen.camera, ORIGIN)
        shown = levels_of_texture(view(FLAT, 0.0, 7).texture)
        light = Camera("light", FLAT, Pose((0.0, 0.3, 0.1)), CODING)
        codes = view(FLAT, 0.3, 8).codes
        thrown = ProjectedPicture(
            shown.texels, shown.levels, light.packed(ORIGIN), codes, CODING.offset, CODING.step, (0.3, 0.05), 0.6, False
        )
        corners = np.array([(2.0, 0.6, 0.3), (2.0, -0.4, 0.5), (3.5, -0.2, -0.5), (-1.0, 0.5, 0.1)])
        texture = view(FLAT, 0.0, 9).texture
        uv = np.array([(3.0, 3.0), (60.0, 4.0), (30.0, 38.0), (0.0, 0.0)], np.float32)
        mesh = ColouredTriangles(
            corners, np.array([(0, 1, 2), (0, 2, 3)], np.int32), uv, texture.y, texture.cb, texture.cr
        )
        canvas = Canvas(projection.width, projection.height)
        canvas.clear()
        canvas.grey()
        depth = CODING.depth(seen.codes)
        canvas.disparity[...] = np.where(np.isfinite(depth), 1.0 / depth, 0.0)
        canvas.winner[::2] = 1
        canvas.add_effects(Effects((thrown,), (mesh,)), target, 0.05, 1, (0.02, 0.001))
        for plane, label in zip(canvas.planes, canvas.planes._fields, strict=True):
            yield f"{name} {label}", plane.copy()
        yield f"{name} winner", canvas.winner.copy()
        assert (canvas.winner == ADDED).any()
        assert (canvas.planes.luma[canvas.winner != ADDED] != 512.0).any()


def points() -> Iterator[tuple[str, np.ndarray]]:
    """Pixels projected into another camera, and tests of points against views."""
    first, second = (view(projection, 0.2 * k, k) for k, projection in enumerate((FLAT, ROUND)))
    rng = np.random.default_rng(1)
    pixels, images = (
        np.stack([rng.uniform(1, 60, 50), rng.uniform(1, 30, 50), rng.uniform(0.1, 1.5, 50)]),
        np.empty((3, 50)),
    )
    project_pixels(first.camera.packed(), second.camera.packed(), pixels, images, 50)
    yield "images", images
    project_pixels(second.camera.packed(), first.camera.packed(), pixels, images, 50)
    yield "images back", images
    prepared = PreparedView(first, OPTIONS, ORIGIN)
    row, address = prepared.table_row, prepared.addresses(measured=True)[view_table.CODES]
    asked = rng.uniform((0.5, -2, -1), (6, 2, 1), (60, 3))
    answers = [
        (looks_through(row, address, *p, (0.1, 0.0)), shows(row, address, *p, (0.1, 0.0))) for p in asked.tolist()
    ]
    yield "sight", np.array(answers)


def measures() -> Iterator[tuple[str, np.ndarray]]:
    """Quality measures of pictures, and depth noise."""
    rng = np.random.default_rng(2)
    a, b = (rng.integers(64, 940, (3, 20, 24)).astype(np.uint16) for _ in range(2))
    yield "match", match_errors(a, b, np.array([1, 0, -1]), np.array([4, 1, 1]))
    yield "similarity", similarity_rows(a[0], b[0], np.full(5, 0.2), 6.5, 58.5)
    h, w = 24, 30
    y, x = np.mgrid[0 : FINE * h, 0 : FINE * w] / FINE
    disparity = np.where(x + 0.4 * y < 16.3, 1.0, 0.2)
    truth = np.where(np.mgrid[0:h, 0:w][1] < 14, 0.9, 0.2) + 0.0
    result = silhouette_offsets(disparity, truth, np.roll(truth, 1, axis=1), 0.3, 0.1)
    for k, part in enumerate(result if isinstance(result, tuple) else (result,)):
        yield f"offsets {k}", np.asarray(part)
    yield "thin", np.asarray(thin_structures(disparity, 0.3, 3 * FINE))
    codes = view(FLAT, 0.0).codes
    noisy = np.empty_like(codes)
    perturb_codes(codes, 3, 7, 0.6, 0.01, CODING.max_code, noisy)
    yield "noise", noisy


CASES: tuple[Callable[[], Iterator[tuple[str, np.ndarray]]], ...] = (
    solids, meshes, completed, pictures, halves, colours, effects, points, measures, *uncompiled_background.CASES,
)  # fmt: skip


def run() -> Arrays:
    """All cases' arrays by name."""
    return {f"{case.__name__}: {name}": np.array(array) for case in CASES for name, array in case()}


def main() -> None:
    """Run all cases, and record which kernel files take part in them."""
    kernels = str(Path(view_table.__file__).resolve().parents[1])
    modules: set[str] = set()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        if event == "call":
            modules.add(frame.f_code.co_filename)

    sys.setprofile(note)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("error")
        arrays = run()
    sys.setprofile(None)
    files = {str(Path(name).resolve()) for name in modules}
    inside = [str(Path(name).relative_to(kernels))[:-3] for name in files if name.startswith(kernels)]
    np.savez(sys.argv[1], modules=np.array(sorted(inside)), **arrays)


if __name__ == "__main__":
    main()
