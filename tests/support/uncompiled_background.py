"""Small runs of the kernels of the background model, and of rays in numbers (see `uncompiled_cases`)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from farside.engine.background.capture import Present, Remains
from farside.engine.background.exposure import Exposure
from farside.engine.background.light import cells_of
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.model import BackgroundModel
from farside.engine.background.pbi import uncovered_cells
from farside.engine.background.ray_tracer import EmbreeTracer
from farside.engine.background.saved_model import SavedModel
from farside.engine.background.seed import Seed
from farside.engine.background.seed_files import seed_of
from farside.engine.background.surface import Surface
from farside.engine.background.texture_pages import Part, arrange, paint
from farside.engine.background.tolerances import Tolerances
from farside.engine.background.viewing_space import ViewingSpace
from farside.engine.geometry.mesh import Mesh
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.background.hidden import flag_unseen, spread_seen
from farside.engine.kernels.background.light import SUMS_SIZE, Cells, follow_light
from farside.engine.kernels.background.maximum_depth import PHASES
from farside.engine.kernels.background.picture import Picture
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.kernels.evaluation.leaks import count_leaks, farthest_distances
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.settings import Settings
from support.models import picture_of
from support.rooms import BOX_X, CODING, WALL_X, camera_row, see

Named = Iterator[tuple[str, np.ndarray]]

# Of different heights and distances: else images lie on the border of two pixels, and rounding decides which it is.
CAMERAS = [
    dataclasses.replace(camera, pose=camera.pose.translated((0.013 * k, 0.0, 0.027 * k)))
    for k, camera in enumerate(camera_row(3, (44, 30)))
]
EYE = dataclasses.replace(CAMERAS[1], name="eye", pose=Pose((-0.1, 0.15, 0.05)))
SPHERE = Equirectangular(160, 106, (-0.6, 0.6), (-0.4, 0.4))
# Steps of the model that some settings take and others leave out.
VARIANTS = {
    "standing": Settings(n_init=3, n_update=2, cull_stale=True, middle_layers=300),
    "by pixel": Settings(n_init=3, n_update=2, culling_stride=2, tolerance_px=0.0, backdrop="farthest", refine=False),
    "paper": dataclasses.replace(Settings.paper(), n_init=2, n_update=2, culling_stride=2),
}


def seen_by(camera: Camera, index: int, box_y: float | None, noise: float, gain: float = 1.0) -> View:
    """A wall, and a box before it where `box_y` is given, with a pattern on both, noise of depth and a few holes."""
    view, rng = see(camera, box_y), np.random.default_rng(7 * index + ord(camera.name[-1]))
    shape = view.codes.shape
    codes = view.codes + np.round(rng.normal(0.0, noise, shape))
    codes[rng.random(shape) < 0.01] = 0
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
    luma = gain * (view.texture.y - 64 + 60 * np.sin(0.7 * u) * np.cos(0.5 * v)) + 64
    chroma = (plane.astype(np.uint16) for plane in (luma[::2, ::2] // 2 + 200, luma[::2, ::2] // 3 + 300))
    return View(camera, Texture(luma.astype(np.uint16), *chroma), np.clip(codes, 0, 65535).astype(np.uint16))


def frames(noise: float) -> list[Frame]:
    """Someone stands before the wall, and leaves; then the last camera moves."""
    moved = [*CAMERAS[:2], dataclasses.replace(CAMERAS[2], pose=CAMERAS[2].pose.translated((0.0, 0.1, 0.0)))]
    boxes, rigs = (0.0, 0.0, None, None, None), (*[CAMERAS] * 4, moved)
    return [
        Frame(index, tuple(seen_by(camera, index, box, noise) for camera in rig))
        for index, (box, rig) in enumerate(zip(boxes, rigs, strict=True))
    ]


def models() -> Named:
    """A background model over some frames, in its variants: what it keeps of each camera, and what it shows."""
    for label, settings in VARIANTS.items():
        noise = 25.0 if settings.refine else 0.0
        video = frames(noise)
        scene = Scene.of(CAMERAS, settings, video[0])
        model = BackgroundModel(CAMERAS, settings, scene)
        reports = [model.update(frame) for frame in video]
        assert all(report.rays > 0 for report in reports[:1])
        assert sum(report.accepted for report in reports) > 0
        assert sum(report.culled for report in reports) > 0
        assert bool(model.tolerances.noise) == bool(noise)
        for capture in model.captures:
            name, image = f"{label} {capture.number}", capture.image
            yield f"{name} codes", image.codes
            yield f"{name} flags", image.flags
            yield f"{name} y", image.texture.y
            yield f"{name} cr", image.texture.cr
        views = [PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in video[-1].views]
        present = ViewTable(views) if settings.backdrop == "standing" else None
        yield from _shown(label, model, present)
        if label == "standing":
            seeded = BackgroundModel(CAMERAS, settings, scene, seed=_behind(model))
            assert seeded.update(video[0]).rays > 0
            assert seeded.state().atlases
            yield from _shown("seeded", seeded, present)


def light() -> Named:
    """Colours of a maximum depth image that follow a darker view, someone before it: where it is active, and where it
    is only compared."""
    first, now = (seen_by(CAMERAS[1], 0, box, 0.0, gain) for box, gain in ((None, 1.0), (0.0, 0.7)))
    image = MaximumDepthImage(first, Tolerances(0.1, 0.02), 0.05)
    size = cells_of(first.codes.shape)
    sums = np.zeros((*size, SUMS_SIZE))
    views = now, View(first.camera, image.texture, image.codes)
    pictures = [Picture(view.codes, view.texture.y, view.texture.cb, view.texture.cr) for view in views]
    active = (np.indices(size).sum(axis=0) % 2).astype(np.uint8)
    for number in range(PHASES):
        cells = Cells(active, sums)
        follow_light(*pictures, image.flags, image._rules, np.array(IDENTITY), number, 2, 0.25, cells)
    assert 0 < np.count_nonzero(image.texture.y != first.texture.y) < first.codes.size
    yield from (("sums", sums), ("y", image.texture.y), ("cb", image.texture.cb), ("cr", image.texture.cr))


def walks() -> Named:
    """One camera passes someone, who then leaves: what it adds, what is left of its captures, and what is culled."""
    for label, settings in {
        "by triangle": Settings(n_init=1, tolerance_px=1.0),
        "by pixel": Settings(n_init=1, tolerance_px=1.0, culling_stride=2, rays_by_triangle=False),
    }.items():
        path = [
            dataclasses.replace(CAMERAS[1], pose=CAMERAS[1].pose.translated((0.0, 0.17 * k, 0.01 * k)))
            for k in (0, 1, 2, 3, 4, 5, 4, 3)
        ]
        video = [
            Frame(k, (seen_by(camera, k, 0.2 if k < 5 else None, 0.0),)) for k, camera in enumerate(path)
        ]
        model = BackgroundModel(path[:1], settings, Scene.of(path[:1], settings, video[0]))
        reports = [model.update(frame) for frame in video]
        assert sum(report.added for report in reports) > 0
        assert sum(report.culled for report in reports[5:]) > 0
        remains = [capture for capture in model.captures if isinstance(capture, Remains)]
        assert remains
        for capture in remains:
            name = f"{label} {capture.number}"
            yield f"{name} codes", capture.codes
            yield f"{name} y", capture.texture.y
            yield f"{name} cb", capture.texture.cb
        yield f"{label} culled", np.array([report.culled for report in reports])
        view = model.render_pbi(EYE).view
        yield f"{label} disparity", EYE.depth.disparity(view.codes)
        yield f"{label} luma", view.texture.y


def arrives() -> Named:
    """Something is put before a wall, stands there, and is shown where something else hides it; then it goes."""
    settings = Settings(n_init=1, n_update=3, tolerance_px=1.0, cull_stale=True, middle_layers=3000)
    boxes = (None, *[0.2] * 7, 0.25, None)
    video = [Frame(k, tuple(seen_by(camera, k, box, 0.0) for camera in CAMERAS)) for k, box in enumerate(boxes)]
    model = BackgroundModel(CAMERAS, settings, Scene.of(CAMERAS, settings, video[0]))
    for index, one in enumerate(video):
        model.update(one)
        state = model.state()
        for late in state.late:
            yield f"{index} {late.index} turns", late.turns
        for remains in state.remains:
            assert remains.late
            yield f"{index} {remains.capture} codes", remains.codes
            yield f"{index} {remains.capture} y", remains.y
        yield f"{index} count", np.array([len(state.remains)])
        assert bool(state.remains) == (index in (6, 7, 8))
        view = model.render_pbi(EYE, model._new_triangles.table(one.views)).view
        yield f"{index} disparity", EYE.depth.disparity(view.codes)


def _behind(model: BackgroundModel) -> Seed:
    """A model as a seed, a little behind: of two surfaces at exactly the same depth, either may be hit first."""
    seed = seed_of(SavedModel.of(CAMERAS, 0, model, None))
    away = np.array([0.003, 0.0, 0.0])
    return Seed(tuple(dataclasses.replace(part, vertices=part.vertices + away) for part in seed.parts))


def _shown(label: str, model: BackgroundModel, present: ViewTable | None) -> Named:
    """What a model shows: to an eye, as a mesh, and in numbers."""
    wanted = (np.indices((8, 11)).sum(axis=0) % 3 > 0).astype(np.uint8)
    for name, options in {"sparse": {"sparse": True, "wanted": wanted}, "dense": {"sparse": False}}.items():
        view = model.render_pbi(EYE, present, near=0.1, **options).view
        assert (view.codes > 0).any()
        yield f"{label} {name} disparity", EYE.depth.disparity(view.codes)
        yield f"{label} {name} y", view.texture.y
        yield f"{label} {name} cb", view.texture.cb
    mesh = model.mesh()
    yield f"{label} mesh", np.array([mesh.vertices[:, 0].min() > 1.0, len(mesh.vertices) > 20])
    part = Part(0, -4, -4, 24, 16)
    yield f"{label} page", picture_of(*paint([part], arrange([part]), model._captures))
    yield f"{label} memory", np.array([size > 0 for size in model.memory.values()])


def sheet(x: float, half: float, count: int, camera: Camera) -> Mesh:
    """A square across the x axis, as a grid of count x count points that face a camera."""
    y, z = np.meshgrid(np.linspace(half, -half, count), np.linspace(half, -half, count))
    points = np.stack([np.full(y.shape, x), y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    number = np.arange(count * count).reshape(count, count)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    return Mesh(points, camera.project(points)[0].astype(np.float32), triangles.astype(np.int32))


def tracer_of(*meshes: Mesh) -> tuple[EmbreeTracer, list[Surface]]:
    """A ray tracer of meshes of one camera."""
    tracer, surfaces = EmbreeTracer(), [Surface.new(mesh, 1, 0, 0) for mesh in meshes]
    for number, surface in enumerate(surfaces):
        tracer.set(number, surface, lasting=number % 2 == 0)
    tracer.commit()
    return tracer, surfaces


def hidden() -> Named:
    """What of a wall heads see past a box that stands, and what is flagged as seen by none."""
    camera = camera_row(1, (88, 60))[0]
    tracer, (_box, wall) = tracer_of(sheet(BOX_X, 0.8, 5, camera), sheet(WALL_X, 1.9, 14, camera))
    views = ViewTable([PreparedView(see(camera, 0.0, 0.8), TriangulationOptions(0.0, 0.1), np.zeros(3))])
    present, eyes = Present(0.0, views, {}), ViewingSpace((0.02, 0.01, 0.03), 0.05).eyes()[::8]
    seen, cells = np.zeros(len(wall.invalid), np.uint8), np.zeros((15, 22), np.uint8)
    tracer.mark_seen(eyes, wall, present, (0.05, 1e-3), False, cells, seen)
    yield "seen", seen
    spread_seen(wall.mesh.uv, wall.mesh.triangles, seen, False, cells)
    yield "cells", cells
    flag_unseen(wall.mesh.uv, wall.mesh.triangles, False, cells, wall.invalid)
    assert 0.0 < wall.invalid.mean() < seen.mean() < 1.0
    yield "invalid", wall.invalid


def asked() -> Named:
    """What rays hit, what is near points and what spheres touch, in a room with a box that comes and goes."""
    video = [
        Frame(index, tuple(seen_by(camera, index, box_y, 0.0) for camera in CAMERAS))
        for index, box_y in enumerate((None, 0.2, 0.4))
    ]
    settings = VARIANTS["standing"]
    model = BackgroundModel(CAMERAS, settings, Scene.of(CAMERAS, settings, video[0]))
    for seen in video:
        model.update(seen)
    rng = np.random.default_rng(5)
    starts, ways = rng.uniform((-0.5, -1, -1), (3, 1, 1), (40, 3)), rng.normal((1.0, 0.0, 0.0), 0.6, (40, 3))
    for name, hits in (
        ("nearest", model.queries.cast_rays(starts, ways)),
        ("farthest", model.queries.cast_rays(starts, ways, 3.0, farthest=True)),
        ("closest", model.queries.closest_points(starts, 2.5)),
    ):
        assert hits.hit.sum() > 5
        yield from ((f"{name} {field}", getattr(hits, field)) for field in ("distances", "points", "ages"))
        yield f"{name} sides", np.abs(hits.normals) > 0.5
    yield "free", model.queries.are_free(starts, ways, 2.0)
    touched = model.queries.overlaps(starts, 1.5, listed=1)
    assert touched.counts.max() > 1
    yield "touched", touched.counts
    yield "corners", np.isfinite(touched.corners)


def uncovered() -> Named:
    """Where eyes may see past views that are drawn."""
    cameras = camera_row(2, (160, 106))
    views = [PreparedView(see(camera, 0.1), TriangulationOptions(0.0, 0.1), np.zeros(3)) for camera in cameras]
    for eye in (cameras[0], dataclasses.replace(cameras[0], projection=SPHERE)):
        wanted = uncovered_cells(eye, views, 0.02, np.zeros(3))
        assert 0.1 < wanted.mean() < 0.9
        yield type(eye.projection).__name__, wanted


def tones() -> Named:
    """Exposures that differ are followed, over frames and by what a model has seen."""
    settings = VARIANTS["standing"]
    first, second = (
        Frame(index, tuple(seen_by(c, index, None, 0.0, 1.0 + 0.1 * k) for k, c in enumerate(CAMERAS)))
        for index in range(2)
    )
    scene = Scene.of(CAMERAS, settings, first)
    model, exposure = BackgroundModel(CAMERAS, settings, scene), Exposure(3, 0.5, scene.depths[:2])
    for frame in (first, second):
        views = [PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in frame.views]
        exposure.update(ViewTable(views), 1 / 30, *model.images(frame))
        model.update(frame)
        yield f"tones {frame.index}", exposure.tones.copy()
    assert np.ptp(exposure.tones[:, 0, 0]) > 0.05


def rays() -> Named:
    """Rays toward triangles of which some are there, and behind pixels; flagged triangles are not there."""
    camera = Camera("c", Perspective.from_fov(40, 30, 1.4), Pose(), CODING)
    tracer, (wall,) = tracer_of(sheet(3.0, 5.0, 3, camera))
    rng = np.random.default_rng(5)
    asked = rng.uniform(-1.0, 1.0, (60, 3)).astype(np.float32)
    asked[:, 0], asked[30:, 1] = 3.0, asked[30:, 1] + 50.0  # half of them on the wall, half of them far beside it
    triangles = np.arange(60, dtype=np.int32).reshape(-1, 3)
    missed = count_leaks(tracer.packed, asked, triangles, np.stack([camera.packed()]), 7, 90)
    assert 0 < missed[0] < 90
    yield "missed", np.array(missed)
    wall.invalid[:3] = 1
    distances = np.empty((30, 40))
    farthest_distances(tracer.packed, camera.packed(), distances)
    assert 0.1 < np.isnan(distances).mean() < 0.9
    yield "distances", distances


CASES = (models, light, walks, arrives, hidden, asked, uncovered, tones, rays)
