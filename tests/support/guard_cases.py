"""Random cases for kernels under guarded memory (`guarded`), run in a process of their own, because a fault kills it.

A case is a function of a random generator. It returns counts of what it was meant to exercise, so that the caller can
check that it was not in vain. As a script this reads requests from standard input, a line of JSON each (case, seed,
flush), and answers with a line each: {"case", "seed", "flush", "counts", "called"}.
"""

from __future__ import annotations

import ctypes
import dataclasses
import faulthandler
import io
import json
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Mapping

import numpy as np
from farside.engine.background.coverage import Coverage
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.model import BackgroundModel
from farside.engine.background.seed_files import seed_of
from farside.engine.background.state_check import check_model
from farside.engine.background.tolerances import Tolerances
from farside.engine.geometry.completion import complete
from farside.engine.geometry.embree import EmbreeError
from farside.engine.geometry.mesh import Mesh
from farside.engine.geometry.minification import level_for
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.triangulation import TriangulationOptions, depth_cuts, triangulate
from farside.engine.geometry.triangulator import Triangulator
from farside.engine.io.glb_scene import GlbPart
from farside.engine.io.images import decode_jpeg, encode_jpeg
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.kernels.rendering.added_mesh import ADDED
from farside.engine.live import frame_memory
from farside.engine.pipeline import engine as engine_module
from farside.engine.rendering.antialiasing import smooth_outlines
from farside.engine.rendering.filling import fill
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.effects import AddedMesh, Projector
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.rig.texture import from_rgb, to_rgb, toned_texture
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from PIL import Image
from support.guarded import guarded, guarding

__all__ = ["CASES", "HANGS_S"]

Counts = dict[str, float]
Rng = np.random.Generator

HANGS_S = 900.0  # a case that takes longer counts as hanging; the first ones may compile everything
ORIGIN = np.zeros(3)
# The smallest allowed sizes, odd ones, and those next to multiples of the kernels' vector and tile sizes.
SIZES = (
    4, 5, 6, 7, 9, 12, 15, 16, 17, 20, 31, 32, 33, 34, 35, 47, 48, 49, 63, 64, 65, 66, 80, 95, 96, 97, 127, 128, 129,
)  # fmt: skip
SMALL = tuple(size for size in SIZES if size <= 66)
_ROOM = np.array([4.0, 5.0, 3.0])  # half the sides of a box around the origin, metres

# Views


def any_size(rng: Rng, sizes: tuple[int, ...] = SIZES) -> tuple[int, int]:
    return int(rng.choice(sizes)), int(rng.choice(sizes))


def any_projection(rng: Rng, sizes: tuple[int, ...] = SIZES) -> Perspective | Equirectangular:
    """A perspective projection, sometimes mirrored or off centre, or a whole or partial sphere."""
    w, h = any_size(rng, sizes)
    kind = rng.integers(4)
    if kind < 2:
        fx, fy = (side * rng.uniform(0.3, 2.0) * (1 if rng.random() < 0.75 else -1) for side in (w, h))
        off = rng.uniform(0.3, 0.7, 2) if rng.random() < 0.7 else rng.uniform(-0.5, 1.5, 2)
        return Perspective(w, h, fx, fy, w * off[0], h * off[1])
    wide, high = (2 * math.pi, rng.uniform(1.0, math.pi)) if kind == 2 else rng.uniform(0.4, (6.0, 3.0))
    left, bottom = rng.uniform(-4.0, 0.0), rng.uniform(-0.5 * math.pi, 0.5 * math.pi - high)
    return Equirectangular(w, h, (left, left + wide), (bottom, bottom + high))


def any_pose(rng: Rng, reach: float = 0.6) -> Pose:
    """A pose within `reach` metres of the origin, mostly looking along x."""
    turn = rng.uniform(-0.4, 0.4, 3) if rng.random() < 0.6 else rng.uniform(-math.pi, math.pi, 3)
    return Pose.from_euler(rng.uniform(-reach, reach, 3), *turn)


def any_coding(rng: Rng) -> DepthCoding:
    far = float(rng.choice([12.0, 50.0, math.inf]))
    return DepthCoding(float(rng.choice([0.05, 0.3])), far, int(rng.choice([8, 10, 16, 16])), bool(rng.integers(2)))


def any_camera(rng: Rng, name: str, sizes: tuple[int, ...] = SIZES) -> Camera:
    return Camera(name, any_projection(rng, sizes), any_pose(rng), any_coding(rng))


def room_depth(camera: Camera, ball: np.ndarray) -> np.ndarray:  # [h, w]
    """Depth of the inside of a box, with a ball of half a metre in it."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    place = np.array(camera.pose.position)
    rays = camera.unproject(np.stack([u, v], -1), np.ones(u.shape)) - place
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (np.where(rays > 0, _ROOM - place, -_ROOM - place) / rays).min(axis=-1)
    a, b = (rays * rays).sum(-1), rays @ (place - ball)
    root = b * b - a * (((place - ball) ** 2).sum() - 0.25)
    near = (-b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (near > 0), near, depth)


def any_codes(rng: Rng, camera: Camera, ball: np.ndarray) -> np.ndarray:
    """Depth codes of a room, some with holes or noise; or codes that no camera would produce."""
    shape, most = (camera.height, camera.width), camera.depth.max_code
    kind = rng.integers(12)
    if kind == 0:
        return rng.integers(0, most + 1, shape).astype(np.uint16)
    if kind == 1:
        return np.full(shape, rng.choice([0, 1, most, 65535]), np.uint16)
    if kind == 2:
        return rng.choice(np.array([0, 1, most // 2, most], np.uint16), shape)
    codes = camera.depth.codes(room_depth(camera, ball))
    if kind < 6:  # holes, as blocks and as pixels
        for _ in range(rng.integers(1, 6)):
            y, x = rng.integers(0, shape[0]), rng.integers(0, shape[1])
            codes[y : y + rng.integers(1, 20), x : x + rng.integers(1, 20)] = 0
        codes[rng.random(shape) < 0.02] = 0
    if kind == 6:
        stray = rng.integers(-300, 300, shape)
        codes = np.clip(codes + stray, 0, most).astype(np.uint16)
    return codes


def any_plane(rng: Rng, shape: tuple[int, int]) -> np.ndarray:
    """A plane: flat, rough, waves, or flat with stripes a little inside the borders, where rough blocks may begin."""
    kind = rng.integers(6)
    if kind > 3:
        plane, stripes = np.full(shape, 500, np.uint16), rng.integers(64, 940, shape)
        inner = rng.integers(2, 6)
        for side in (np.s_[inner : inner + 2], np.s_[-inner - 2 : -inner]):
            plane[side] = stripes[side]
            if kind > 4:
                plane[:, side] = stripes[:, side]
        return plane
    if kind == 0:
        return np.full(shape, rng.integers(0, 1024), np.uint16)
    if kind == 1:
        return rng.integers(0, 65536, shape).astype(np.uint16)
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    if kind == 2:
        return (500 + 300 * np.sin(0.9 * x + rng.random()) * np.cos(0.7 * y)).astype(np.uint16)
    return rng.integers(64, 940, shape).astype(np.uint16)


def any_texture(rng: Rng, h: int, w: int, flush: str) -> Texture:
    half = ((h + 1) // 2, (w + 1) // 2)
    planes = (any_plane(rng, shape) for shape in ((h, w), half, half))
    return Texture(*(guarded(plane, flush) for plane in planes))


def any_view(rng: Rng, camera: Camera, flush: str, ball: np.ndarray) -> View:
    """A view whose planes are guarded, or lie in memory as in a buffer that other processes write."""
    texture, codes = any_texture(rng, camera.height, camera.width, flush), any_codes(rng, camera, ball)
    if rng.random() < 0.2:
        memory = guarded(np.zeros(frame_memory.frame_bytes([camera]), np.uint8), flush)
        planes = frame_memory.lay_out(memory, [camera])[camera.name]
        for source, plane in zip(
            (texture.y, texture.cb, texture.cr, codes),
            (planes.texture.y, planes.texture.cb, planes.texture.cr, planes.codes),
            strict=True,
        ):
            plane[...] = source
        return View(camera, planes.texture, planes.codes)
    return View(camera, texture, guarded(codes, flush))


def any_ball(rng: Rng) -> np.ndarray:
    return np.array([1.6, rng.uniform(-0.8, 0.8), rng.uniform(-0.4, 0.4)])


def any_options(rng: Rng) -> TriangulationOptions:
    return TriangulationOptions(
        float(rng.choice([0.0, 1e-3, 2e-2])), float(rng.choice([0.0, 0.05, 0.2])), int(rng.choice([1, 4, 32]))
    )


def any_target(rng: Rng, views: list[View]) -> Camera:
    """A camera near the views: turned or not, from behind, looking past their borders, wide or narrow."""
    like = views[rng.integers(len(views))].camera
    kind = rng.choice([0, 1, 1, 2, 3, 3])
    if kind == 0:
        return Camera("t", any_projection(rng), like.pose, like.depth)
    if kind == 1:  # the view's own picture, moved by some pixels and at another size
        p, scale = like.projection, rng.uniform(0.3, 2.0)
        if isinstance(p, Perspective):
            moved = rng.uniform(0.0, 12.0, 2)  # past the upper and left border a little
            size = max(4, round(p.width * min(scale, 1.5))), max(4, round(p.height * min(scale, 1.5)))
            return dataclasses.replace(like, name="t", projection=Perspective(
                *size, scale * p.fx, scale * p.fy, scale * p.cx + moved[0], scale * p.cy + moved[1]
            ))  # fmt: skip
        return dataclasses.replace(like, name="t", projection=p.scaled(min(scale, 1.5)))
    if kind == 2:  # from behind
        back = like.pose.translated((-rng.uniform(0.5, 3.0), 0.0, 0.0))
        return Camera("t", any_projection(rng), back, like.depth)
    return Camera("t", any_projection(rng), any_pose(rng, 1.0), like.depth)


# Cases


def shading(rng: Rng, flush: str) -> Counts:
    """Views drawn, shaded, filled, smoothed and encoded, without a model."""
    ball = any_ball(rng)
    views = [any_view(rng, any_camera(rng, f"v{k}"), flush, ball) for k in range(rng.integers(1, 5))]
    options = any_options(rng)
    triangulators = [Triangulator() if rng.random() < 0.5 else None for _ in views]
    prepared = [
        PreparedView(view, options, ORIGIN, bool(rng.integers(2)), triangulator)
        for view, triangulator in zip(views, triangulators, strict=True)
    ]
    behind = int(rng.integers(0, 2)) if len(prepared) > 1 else 0
    n = len(prepared) - behind
    drawn = 0
    for _ in range(3):
        camera = any_target(rng, views)
        target, canvas = Target(camera, ORIGIN), Canvas(camera.width, camera.height)
        canvas.clear()
        canvas.grey()
        for number, view in enumerate(prepared[:n]):
            canvas.draw(view.mesh(), target, number, 0.001, 1e-3)
        for part in ("doubtful", "rims"):
            canvas.draw_holes(part, prepared[:n], target, 0.001)
        if behind:
            canvas.draw_holes("surface", prepared[n:], target, 0.001)  # as if it were the first view
        table = ViewTable(prepared, any_tones(rng, len(prepared)), drawn=n)
        canvas.shade(
            target, table, n, int(rng.integers(1, 6)), cubic=bool(rng.integers(2)), prefilter=bool(rng.integers(2))
        )
        drawn += int((canvas.disparity > 0).sum())
        texture = canvas.texture()
        holes = canvas.holes()
        if 0 < holes.count < canvas.disparity.size:
            rise, structured = float(rng.choice([1e-4, 0.1])), bool(rng.integers(2))
            fill(canvas.disparity, canvas.planes, rise, holes, structured=structured)
            texture = canvas.texture()
        texture = smooth_outlines(texture, canvas.disparity, options.edge)
        encode_jpeg(texture)
    return {"drawn": drawn}


def any_tones(rng: Rng, n: int) -> np.ndarray | None:
    if rng.random() < 0.5:
        return None
    return np.asarray(IDENTITY) + rng.normal(0, 0.1, (n, len(IDENTITY)))


def triangulating(rng: Rng, flush: str) -> Counts:
    """Meshes of views frame after frame, masks, rims, completion, levels and coverage."""
    camera, options, ball = any_camera(rng, "v"), any_options(rng), any_ball(rng)
    view = any_view(rng, camera, flush, ball)
    triangulator, triangles = Triangulator(), 0
    for _ in range(3):
        mesh, cuts = triangulator.triangulate(camera, view.codes, options)
        rims = triangulator.rims(cuts)
        triangles += len(mesh.triangles) + (0 if rims is None else len(rims.triangles))
        y, x = rng.integers(0, camera.height), rng.integers(0, camera.width)
        view.codes[y : y + 3, x : x + 5] = rng.integers(0, camera.depth.max_code + 1)
    keep = guarded((rng.random(view.codes.shape) < rng.choice([0.02, 0.5])).astype(np.uint8), flush)
    triangles += len(triangulate(camera, view.codes, options, keep=keep).triangles)
    wide = dataclasses.replace(options, extend_edges=True)
    triangles += len(triangulate(camera, view.codes, wide, keep=keep).triangles)
    cuts = depth_cuts(camera, view.codes, options, keep)
    triangles += len(triangulate(camera, view.codes, options, rims=True, cuts=cuts).triangles)
    completed = complete(view, options.edge)
    prepared = PreparedView(View(camera, view.texture, completed.codes), options, ORIGIN)
    levels = [prepared.level(level_for(ratio)) for ratio in (1.0, 2.0, 4.0, 30.0)]
    coverage, other = Coverage((0.05, 1e-3)), any_view(rng, any_camera(rng, "w"), flush, ball)
    kept = sum(int(coverage.keep_farther(seen, options.edge).sum()) for seen in (view, other, view))
    return {"triangles": triangles, "levels": len(levels), "kept": kept}


def pictures(rng: Rng, flush: str) -> Counts:
    """Colour conversion, JPEG, tones and filling of pictures of any content."""
    w, h = any_size(rng)
    texture = any_texture(rng, h, w, flush)
    rgb = guarded(to_rgb(texture), flush)
    data = encode_jpeg(from_rgb(rgb), int(rng.integers(1, 100)))
    toned_texture(decode_jpeg(data, h, w), rng.normal(0, 2, len(IDENTITY)))
    planes = tuple(guarded(rng.uniform(0, 1023, (h, w)).astype(np.float32), flush) for _ in range(3))
    disparity = guarded((rng.random((h, w)) < rng.choice([0.05, 0.5, 0.97])) * rng.uniform(0.1, 3, (h, w)), flush)
    disparity = guarded(disparity.astype(np.float32), flush)
    filled = 0
    if disparity.any():
        filled = len(fill(disparity, planes, float(rng.choice([1e-6, 0.05])), structured=bool(rng.integers(2))))
        assert all(np.isfinite(plane).all() for plane in planes)
    smooth_outlines(texture, disparity, 0.1)
    return {"filled": filled, "bytes": len(data)}


def any_settings(rng: Rng) -> Settings:
    changes = {
        "n_render": int(rng.integers(1, 5)), "n_init": int(rng.integers(1, 4)), "n_update": int(rng.integers(1, 4)),
        "fill": str(rng.choice(["none", "smooth", "structure"])),
        "antialias": str(rng.choice(["none", "morphological", "samples"])),
        "culling_stride": int(rng.choice([0, 0, 1, 3])), "backdrop": str(rng.choice(["standing", "farthest"])),
        "rims": bool(rng.integers(2)), "overdraw": bool(rng.integers(2)), "completion": bool(rng.integers(2)),
        "prefilter": bool(rng.integers(2)), "exposure_s": float(rng.choice([0.0, 0.5])),
        "light_s": float(rng.choice([0.0, 0.01, 0.5])),
        "output_scale": float(rng.choice([1.0, 1.0, 0.5])), "baseline_m": 0.5,
        "viewing_space": None if rng.random() < 0.6 else (0.0, 0.0, 0.0, 0.5),
    }  # fmt: skip
    names = rng.permutation(sorted(changes))[: rng.integers(0, len(changes))]
    return Settings.preset(str(rng.choice(["fast", "balanced", "best"])), **{name: changes[name] for name in names})


def any_head(rng: Rng) -> StereoView:
    w, h = any_size(rng, SMALL)
    eyes = []
    for _ in range(2):
        left, right, top, bottom = rng.uniform(0.3, 1.3, 4)
        eyes.append(Perspective.from_tangents(w, h, left, right, top, bottom))
    return StereoView(any_pose(rng, 0.8), float(rng.uniform(0.0, 0.1)), *eyes)


def any_rig(rng: Rng, sizes: tuple[int, ...] = SMALL) -> list[Camera]:
    """Cameras that look in about the same direction, some of them spherical."""
    cameras = [any_camera(rng, f"v{k}", sizes) for k in range(rng.integers(1, 5))]
    if rng.random() < 0.7:  # views of one size and kind that overlap, for exposure
        p = Perspective.from_fov(*any_size(rng, sizes), 1.3)
        cameras = [
            dataclasses.replace(camera, projection=p, pose=Pose((0.0, 0.2 * k, 0.0)))
            for k, camera in enumerate(cameras)
        ]
    return cameras


def frames(rng: Rng, cameras: list[Camera], flush: str, count: int) -> list[Frame]:
    """Frames of a ball that moves through a room, sometimes with holes and noise; a camera may move as well."""
    out, ball = [], any_ball(rng)
    for index in range(count):
        ball = ball + np.array([0.0, 0.35, 0.0])
        now = list(cameras)
        if index > 1 and rng.random() < 0.2:
            now[0] = dataclasses.replace(now[0], pose=now[0].pose.translated((0.0, 0.03, 0.0)))
        out.append(Frame(index, tuple(any_view(rng, camera, flush, ball) for camera in now)))
    return out


def play(rng: Rng, engine: engine_module.Engine, video: list[Frame]) -> Counts:
    """Take frames and render heads and cameras; counts of what was drawn, pixels of the backdrop, and filled ones."""
    counts = dict.fromkeys(("drawn", "backdrop", "triangles", "rays"), 0.0)
    for frame in video:
        viewers = {"head": any_head(rng), "camera": any_target(rng, list(frame.views))}
        report = engine.update(frame, viewers, {"head": float(rng.uniform(0, 1))})
        counts["triangles"] += report.triangles
        counts["rays"] += report.pbi_rays
        head = viewers["head"].moved(any_pose(rng, 0.8)) if rng.random() < 0.3 else viewers["head"]
        pair = engine.render(head, "head")
        for eye in (pair.left, pair.right, engine.render_camera(viewers["camera"], "camera")):
            counts["drawn"] += int((eye.disparity > 0).sum())
            counts["backdrop"] += int(((eye.disparity > 0) & (eye.winner >= len(eye.report.views))).sum())
    if engine.model is not None:
        counts["mesh"] = len(engine.mesh().vertices)
        counts["pages"] = len(engine.textured_mesh().parts)
        counts["found"] = ask(rng, engine.model)
    return counts


def ask(rng: Rng, model: BackgroundModel) -> float:
    """Questions about a model from in and around the room; returns how much was found."""
    queries, count = model.queries, int(rng.choice([1, 63, 64, 65, 130]))
    places, ways = rng.uniform(-6, 6, (count, 3)), rng.normal(size=(count, 3))
    ways[:: 3, rng.integers(3)] = 0.0
    reach = rng.choice([0.01, 1.0, 30.0, math.inf], count)
    found = [queries.cast_rays(places, ways, reach, farthest=bool(rng.integers(2)))]
    found.append(queries.closest_points(places, reach))
    free = queries.are_free(places, ways, reach)
    touched = queries.overlaps(places, np.minimum(reach, 20.0), listed=int(rng.integers(0, 9)))
    return float(sum(hits.hit.sum() for hits in found) + (~free).sum() + (touched.counts > 0).sum())


def pipeline(rng: Rng, flush: str) -> Counts:
    """The whole engine: model, PBI, backdrop, stereo and single pictures, with presets and settings."""
    cameras = any_rig(rng)
    engine = engine_module.Engine(cameras, any_settings(rng))
    try:
        video = frames(rng, cameras, flush, int(rng.choice([2, 3, 3, 6])))
        if not any((view.codes >= view.camera.depth.min_code).any() for view in video[0].views):
            return {}  # a first frame without depth is refused
        counts = play(rng, engine, video)
        if (state := engine.state()) is not None and rng.random() < 0.2:
            check_model(state.model, state.rig)
            begin_with(rng, cameras, engine, video[:1])
        return counts
    finally:
        engine.close()


def begin_with(rng: Rng, cameras: list[Camera], earlier: engine_module.Engine, video: list[Frame]) -> None:
    """Another engine, whose model begins with that of an earlier one."""
    state = earlier.state()
    assert state is not None
    engine = engine_module.Engine(cameras, earlier.settings, seed=seed_of(state))
    try:
        play(rng, engine, video)
    finally:
        engine.close()


def uncovering(rng: Rng, flush: str) -> Counts:
    """A ball leaves in two steps: the surface behind it becomes background, then the surface behind that one."""
    p = Perspective.from_fov(*any_size(rng, (47, 64, 65)), 1.2)
    coding = DepthCoding(0.3, 50.0, 16, has_invalid=True)
    cameras = [Camera(f"v{k}", p, Pose((0.0, 0.1 * k, 0.0)), coding) for k in range(3)]
    changes = {"n_update": 3, "baseline_m": 0.5, "delta_m": 0.1, "margin_m": 0.05}
    stride = int(rng.integers(2))
    engine = engine_module.Engine(cameras, Settings.preset("best", culling_stride=stride, **changes))
    video = []
    for index, ball in enumerate([1.5, 1.5, 2.5, 2.5, 99.0, 99.0, 99.0, 99.0]):
        views = []
        for camera in cameras:
            codes = coding.codes(room_depth(camera, np.array([ball, 0.1, 0.0])))
            views.append(View(camera, any_texture(rng, p.height, p.width, flush), guarded(codes, flush)))
        video.append(Frame(index, tuple(views)))
    try:
        return play(rng, engine, video)
    finally:
        engine.close()


def walking(rng: Rng, flush: str) -> Counts:
    """A camera walks through a room, alone or next to a fixed one, and turns; a ball leaves; captures are joined."""
    p = Perspective.from_fov(*any_size(rng, (47, 64, 65)), 1.2) if rng.random() < 0.7 else any_projection(rng, SMALL)
    coding = any_coding(rng)
    cameras = [Camera(f"v{k}", p, Pose((0.0, 0.1 * k, 0.0)), coding) for k in range(rng.integers(1, 3))]
    changes = {"n_update": len(cameras), "baseline_m": 0.5, "draw_moving": bool(rng.integers(2))}
    changes |= {"cull_stale": True, "middle_layers": 5}
    settings = Settings.preset("balanced", culling_stride=int(rng.integers(2)), **changes)
    engine, ball, video = engine_module.Engine(cameras, settings), any_ball(rng), []
    for index in range(9):
        ball = np.array([99.0, 0.0, 0.0]) if index > 5 else ball
        turned = Pose.from_euler((0.0, 0.12 * index, 0.0), 0.1 * index, 0.0, 0.0)
        now = [dataclasses.replace(cameras[0], pose=turned), *cameras[1:]]
        views = []
        for camera in now:
            codes = coding.codes(room_depth(camera, ball))
            if coding.has_invalid:
                codes[rng.random(codes.shape) < 0.05] = 0
            views.append(View(camera, any_texture(rng, p.height, p.width, flush), guarded(codes, flush)))
        video.append(Frame(index, tuple(views)))
    try:
        counts = play(rng, engine, video)
        assert engine.model is not None
        return {**counts, "captures": len(engine.model.captures), "p_pbs": engine.model.counts()["p_pbs"]}
    finally:
        engine.close()


def arriving(rng: Rng, flush: str) -> Counts:
    """A ball is put before walls that cameras have seen, stands there, is hidden in part by another, and goes."""
    p = Perspective.from_fov(*any_size(rng, (47, 64, 65)), 1.2) if rng.random() < 0.7 else any_projection(rng, SMALL)
    coding = dataclasses.replace(any_coding(rng), bits=16)
    cameras = [Camera(f"v{k}", p, Pose((0.0, 0.1 * k, 0.0)), coding) for k in range(rng.integers(1, 4))]
    changes = {"baseline_m": 0.5, "cull_stale": True, "middle_layers": 100_000, "n_update": len(cameras)}
    engine = engine_module.Engine(cameras, Settings.preset("balanced", **changes))
    late, counts, away = 0, dict[str, float](), np.array([99.0, 0.0, 0.0])
    balls = [away] * 2 + [np.array([2.0, 0.1, 0.0])] * 7 + [np.array([1.6, 0.5, 0.2])] * 3 + [away] * 2
    try:
        for index, ball in enumerate(balls):
            views = []
            for camera in cameras:
                codes = coding.codes(room_depth(camera, ball))
                views.append(View(camera, any_texture(rng, p.height, p.width, flush), guarded(codes, flush)))
            counts = play(rng, engine, [Frame(index, tuple(views))])
            assert engine.model is not None
            late += any(remains.late for remains in engine.model.state().remains)
        return {**counts, "late": late}
    finally:
        engine.close()


def any_effects(rng: Rng, engine: engine_module.Engine, flush: str, *, absurd: bool = False) -> None:
    """Adds projectors of pictures of any size, of live video, and meshes with and without pictures, anywhere."""
    for name in ("picture", "live"):
        pose = any_pose(rng, 1.0)
        pose = absurd_pose(rng, pose) if absurd else pose
        fov, strength = float(rng.choice([1e-3, 0.8, 1.5, 2.9])), float(rng.uniform(0, 1))
        blend, camera = str(rng.choice(["mix", "add"])), engine.cameras[0].name if name == "live" else ""
        w, h = int(rng.choice([1, 2, 5, 40, 65])), int(rng.choice([1, 3, 8, 33]))
        rgba = guarded(rng.integers(0, 256, (h, w, 4)).astype(np.uint8), flush)
        engine.put_effect(name, Projector(pose, fov, strength, blend, camera), None if camera else rgba)
    for name, size in (("near", 0.5), ("around", 4.0)):
        points = rng.normal(size=(30, 3)) * size
        points[rng.integers(30)] = rng.choice([0.0, 1e30, 1e200]) if absurd else 0.0
        triangles = rng.integers(0, 30, (40, 3)).astype(np.int32)
        colours = rng.random((30, 3)).astype(np.float32)
        part = GlbPart(points, triangles, colours)
        if rng.integers(2):
            uv, picture = rng.uniform(-0.5, 1.5, (30, 2)).astype(np.float32), any_png(rng)
            part = GlbPart(points, triangles, np.ones((1, 3), np.float32), uv, picture, ("repeat", "clamp"))
        pose = absurd_pose(rng, any_pose(rng, 1.0)) if absurd else any_pose(rng, 1.0)
        engine.put_effect(name, AddedMesh(pose, float(rng.uniform(0.1, 2))), [part])


def any_png(rng: Rng) -> bytes:
    file = io.BytesIO()
    pixels = rng.integers(0, 256, (int(rng.integers(1, 20)), int(rng.integers(1, 20)), 3)).astype(np.uint8)
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def effects(rng: Rng, flush: str) -> Counts:
    """Projectors and added meshes in all kinds of pictures; where they are absurd, they may be refused."""
    cameras = any_rig(rng)
    absurd = rng.random() < 0.3
    engine = engine_module.Engine(cameras, any_settings(rng))
    try:
        any_effects(rng, engine, flush, absurd=absurd)
        video = frames(rng, cameras, flush, 3)
        if not any((view.codes >= view.camera.depth.min_code).any() for view in video[0].views):
            return {}
        play(rng, engine, video)
        any_effects(rng, engine, flush, absurd=absurd)
        head = any_head(rng)
        with_them = engine.render(head, "head")
        for name in ("picture", "live", "near", "around"):
            engine.remove_effect(name)
        pairs = zip((with_them.left, with_them.right), (engine.render(head, "head").left,) * 2, strict=True)
        thrown = sum(int((a.texture.y != b.texture.y).sum()) for a, b in pairs)
        return {"added": int((with_them.left.winner == ADDED).sum()), "changed": thrown}
    except (ValueError, ArithmeticError, np.linalg.LinAlgError, EmbreeError):
        if not absurd:
            raise
        return {"refused": 1}
    finally:
        engine.close()


def hostile(rng: Rng, flush: str) -> Counts:
    """Like `pipeline`, with absurd numbers that may come from outside: it may refuse them, but not fault or hang."""
    cameras = any_rig(rng)
    try:
        for _ in range(rng.integers(0, 3)):
            k = rng.integers(len(cameras))
            cameras[k] = absurd_camera(rng, cameras[k])
        engine = engine_module.Engine(cameras, dataclasses.replace(any_settings(rng), pbi_scale=0.5))
    except ValueError:
        return {"refused": 1}
    try:
        for frame in frames(rng, cameras, flush, 2):
            head = any_head(rng)
            if rng.random() < 0.7:
                head = head.moved(absurd_pose(rng, head.pose))
            camera = any_target(rng, list(frame.views))
            camera = dataclasses.replace(camera, pose=absurd_pose(rng, camera.pose))
            engine.update(frame, {"head": head, "camera": camera})
            engine.render(head, "head")
            engine.render_camera(camera, "camera")
    except (ValueError, ArithmeticError, np.linalg.LinAlgError, EmbreeError):
        return {"refused": 1}
    finally:
        engine.close()
    return {"taken": 1}


def absurd_pose(rng: Rng, pose: Pose) -> Pose:
    """The pose moved far away in some direction, up to where squares are infinite."""
    scale = 10.0 ** float(rng.choice([3, 7, 12, 19, 30, 38, 100, 155, 300]))
    place = rng.choice([-1.0, 0.0, 1e-3, 1.0], 3) * scale
    return dataclasses.replace(pose, position=tuple(float(x) for x in place))


def absurd_camera(rng: Rng, camera: Camera) -> Camera:
    kind = rng.integers(4)
    if kind == 0:
        return dataclasses.replace(camera, pose=absurd_pose(rng, camera.pose))
    if kind == 1:
        near = 10.0 ** float(rng.choice([-300, -30, -10, 10, 30, 150]))
        return dataclasses.replace(camera, depth=DepthCoding(near, float(rng.choice([2 * near, math.inf])), 16))
    if kind == 2:
        w, h = camera.width, camera.height
        f, c = (10.0 ** rng.choice([-300.0, -30.0, -5.0, 5.0, 30.0, 300.0], 2) for _ in range(2))
        odd = Perspective(w, h, float(f[0]), float(f[1]), float(c[0]), float(c[1]))
        return dataclasses.replace(camera, projection=odd)
    low = 10.0 ** float(rng.choice([0.0, 3.0, 6.0]))
    narrow = Equirectangular(camera.width, camera.height, (low, low + 0.01), (-0.01, 0.01))
    return dataclasses.replace(camera, projection=narrow)


# NaN, infinite or too large numbers, where kernels convert them to integers for indices or bounds


def far_triangles(rng: Rng, flush: str) -> Counts:
    """A triangle through the plane of the eye whose picture is farther to the right than any integer can say."""
    y = -(10.0 ** rng.uniform(22, 30))
    far = [(1.0, y, 0.0), (-1.0, 1.1 * y, 0.0), (1.0, 1.2 * y, 0.1 * y)]
    points = np.array([(2.0, -0.5, -0.5), (2.0, 0.5, -0.5), (2.0, 0.0, 0.5), *far], np.float32)
    mesh = Mesh(points, np.zeros((6, 2), np.float32), np.array([(0, 1, 2), (0, 2, 1), (3, 4, 5)], np.int32))
    camera = Camera("t", Perspective.from_fov(*any_size(rng), 1.2), Pose(), DepthCoding(0.1, 10.0))
    canvas = Canvas(camera.width, camera.height)
    canvas.clear()
    canvas.draw(mesh, Target(camera, ORIGIN), 0, 0.01, 0.0)
    return {"drawn": int((canvas.disparity > 0).sum())}


def at_the_eye(rng: Rng, flush: str) -> Counts:
    """Pixels so near that their points are the eye of the view that drew them: they have no image in it."""
    projection = any_projection(rng)
    camera = Camera("v", projection, Pose(), DepthCoding(0.1, 10.0))
    view = View(camera, any_texture(rng, camera.height, camera.width, flush), any_codes(rng, camera, any_ball(rng)))
    table = ViewTable([PreparedView(view, any_options(rng), ORIGIN)], drawn=1)
    canvas, target = Canvas(*any_size(rng)), any_projection(rng)
    target = Target(Camera("t", dataclasses.replace(
        target, width=canvas.disparity.shape[1], height=canvas.disparity.shape[0]
    ), Pose(), camera.depth), ORIGIN)  # fmt: skip
    canvas.grey()
    canvas.disparity[...] = np.inf
    canvas.shade(target, table, 1, 1)
    return {"coloured": int(all(np.isfinite(plane).all() for plane in canvas.planes))}


def no_colours(rng: Rng, flush: str) -> Counts:
    """Structure-based filling of colours that are NaN."""
    shape = any_size(rng)
    planes = tuple(np.full(shape, rng.choice([np.nan, np.inf, 1e30]), np.float32) for _ in range(3))
    disparity = (rng.random(shape) < 0.6).astype(np.float32)
    disparity[0, 0], disparity[-1, -1] = 1.0, 0.0
    return {"filled": len(fill(disparity, planes, 0.01))}


def lost_points(rng: Rng, flush: str) -> Counts:
    """Settling of a mesh's points that are NaN or at the camera's position."""
    camera = any_camera(rng, "v")
    codes = any_codes(rng, camera, any_ball(rng))
    view = View(camera, any_texture(rng, camera.height, camera.width, flush), codes)
    tolerances = Tolerances(0.05, 1e-3, 0.05, 3.0, 0.0)
    image = MaximumDepthImage(view, tolerances, 0.1)
    points = np.array([(np.nan,) * 3, (np.inf,) * 3, (-np.inf, np.nan, 0), camera.pose.position], np.float32)
    uv = rng.uniform((0.5, 0.5), (camera.width - 0.5, camera.height - 0.5), (4, 2)).astype(np.float32)
    settled = image.settled(Mesh(points, uv, np.zeros((1, 3), np.int32)), camera.packed())
    return {"settled": len(settled)}


def beyond(rng: Rng, flush: str) -> Counts:
    """Not a case: reads an element beyond a guarded array, which must end the process."""
    array = guarded(np.arange(1000, dtype=np.uint16), flush)
    step = array.itemsize if flush == "end" else -array.itemsize
    at = array.ctypes.data + (array.nbytes - array.itemsize if flush == "end" else 0)
    return {"read": ctypes.cast(at + step, ctypes.POINTER(ctypes.c_uint16))[0]}


def hanging(rng: Rng, flush: str) -> Counts:
    """Not a case: never ends."""
    while True:
        time.sleep(0.1)


_CASES = (
    shading, triangulating, pictures, pipeline, uncovering, walking, arriving, effects, hostile, far_triangles,
    at_the_eye, no_colours, lost_points, beyond, hanging,
)  # fmt: skip
CASES: Mapping[str, Callable[[Rng, str], Counts]] = {case.__name__: case for case in _CASES}


def run(name: str, seed: int, flush: str) -> tuple[Counts, set[str]]:
    """A case's counts, and the kernels that it called."""
    called: set[str] = set()
    with guarding(flush, called):
        return CASES[name](np.random.default_rng(seed), flush), called


def main() -> None:
    """Answer requests from standard input until it ends."""
    faulthandler.enable(all_threads=True)
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        asked = json.loads(line)
        faulthandler.dump_traceback_later(asked.pop("hangs_s", HANGS_S), exit=True)
        counts, called = run(asked["case"], asked["seed"], asked["flush"])
        faulthandler.cancel_dump_traceback_later()
        print(json.dumps({**asked, "counts": counts, "called": sorted(called)}), file=answers, flush=True)


if __name__ == "__main__":
    main()
