"""Twins: exact depth, repeatable pictures, views that agree, people who uncover the background behind them."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numba
import numpy as np
import numpy.typing as npt
import pytest
from farside.clients.synth import command
from farside.engine.io.tmiv import open_sequence
from farside.engine.kernels.synth import patterns
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import View
from farside.engine.rig.viewer import home_pose
from farside.engine.synth import (
    FPS,
    TWINS,
    Scene,
    make_scene,
    make_twin,
    render_view,
    twin_cameras,
    twin_frame,
    write_twin,
)
from farside.engine.synth.parts import Palette, box, capsule, cylinder, ellipsoid, turn
from farside.engine.synth.people import Path as Way

SCALE = 0.04
VIEWS = {
    "museum": 24, "hijack": 10, "painter": 16, "frog": 13, "gymnasium-a": 5, "gymnasium-b": 5,
    "doorway": 8, "street": 8, "lounge": 8, "museum-lamps": 24, "gymnasium-lamps": 5,
}  # fmt: skip


def planes(view: View) -> list[npt.NDArray[np.uint16]]:
    return [view.texture.y, view.texture.cb, view.texture.cr, view.codes]


def same(a: View, b: View) -> bool:
    return all(np.array_equal(p, q) for p, q in zip(planes(a), planes(b), strict=True))


def scene_of(*groups: list) -> Scene:  # type: ignore[type-arg]
    palette = Palette()
    palette.add(patterns.CHECKER, (0.7, 0.6, 0.5), scale=0.2)
    return Scene("test", palette.packed(), np.array([[0.0, 0.0, 2.0, 0.5, 4.0]]), groups, [])


def grid(camera: Camera) -> npt.NDArray[np.float64]:  # [h, w, 2] pixel centres
    return np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)


def rays(camera: Camera) -> npt.NDArray[np.float64]:  # [h, w, 3] world directions
    return camera.projection.directions(grid(camera)) @ camera.pose.rotation().T


CODING = DepthCoding(0.5, 25.0)
POSE = Pose.from_euler((0.2, -0.1, 0.3), 0.3, 0.2, 0.1)
LENS = Perspective(48, 36, 30.0, 31.0, 22.0, 19.0)
HALF = Equirectangular(48, 48, (-math.pi / 2, math.pi / 2), (-math.pi / 2, math.pi / 2))


@pytest.mark.parametrize("projection", [LENS, dataclasses.replace(LENS, fx=-30.0, fy=-31.0), HALF])
def test_depth_of_a_wall_is_the_plane_equation(projection: Perspective | Equirectangular) -> None:
    camera = Camera("c", projection, POSE, CODING)
    wall = box(0, (3.1, 0.0, 0.0), (0.2, 400.0, 400.0))
    view = render_view(scene_of([wall]), camera, 0.0)
    with np.errstate(divide="ignore"):
        expected = (3.0 - POSE.position[0]) / rays(camera)[..., 0]
    seen = (expected > 0.5) & (expected < 24.0)
    assert seen.mean() > 0.2
    np.testing.assert_array_equal(view.codes[seen], CODING.codes(expected)[seen])
    assert (view.codes[~seen & (expected < 0)] == 0).all()


@pytest.mark.parametrize(
    ("part", "implicit"),
    [
        (
            ellipsoid(0, (4.0, 0.3, 0.0), (0.9, 1.2, 1.0)),
            lambda p: np.linalg.norm((p - (4.0, 0.3, 0.0)) / (0.9, 1.2, 1.0), axis=-1) - 1,
        ),
        (
            capsule(0, (4.0, -1.0, 0.0), (4.0, 1.0, 0.0), 0.6, (0, 0, 1)),
            lambda p: np.linalg.norm(p - np.clip(p, (4.0, -1.0, 0.0), (4.0, 1.0, 0.0)), axis=-1) - 0.6,
        ),
        (
            cylinder(0, (4.0, 0.0, -1.0), 0.7, 1.5),
            lambda p: np.maximum(np.hypot(p[..., 0] - 4.0, p[..., 1]) - 0.7, np.abs(p[..., 2] + 0.25) - 0.75),
        ),
        (
            box(0, (4.0, 0.0, 0.0), (1.0, 1.4, 1.2), turn(0.5, 0.3, 0.2)),
            lambda p: np.max(np.abs((p - (4.0, 0.0, 0.0)) @ turn(0.5, 0.3, 0.2)) - (0.5, 0.7, 0.6), axis=-1),
        ),
    ],
    ids=["ellipsoid", "capsule", "cylinder", "box"],
)
def test_hits_lie_on_the_surface_and_nothing_before_them_is_inside(part, implicit) -> None:  # type: ignore[no-untyped-def]
    camera = Camera("c", HALF, POSE, CODING)
    view = render_view(scene_of([part]), camera, 0.0)
    hit = view.codes > 0
    depth = CODING.depth(view.codes)
    points = camera.unproject(grid(camera), depth)
    assert 20 < hit.sum() < 0.5 * hit.size
    np.testing.assert_allclose(implicit(points[hit]), 0.0, atol=4e-3)
    for share in np.linspace(0.05, 0.98, 40):  # and a miss goes past the body
        along = np.where(hit, share * depth, share * 8.0)
        assert (implicit(camera.unproject(grid(camera), along)) > -1e-3).all()


@pytest.mark.parametrize("name", list(TWINS))
def test_rigs_are_those_of_the_paper(name: str) -> None:
    rig, full = twin_cameras(name, SCALE), twin_cameras(name)
    assert len(rig.source_names) == VIEWS[name]
    assert len(rig.target_names) >= 4
    assert not set(rig.target_names) & set(rig.source_names)
    assert rig.camera("viewport").name == "viewport"
    for small, big in zip(rig.cameras, full.cameras, strict=True):
        assert small.projection == big.projection.scaled(SCALE)
        assert small.width % 2 == small.height % 2 == 0
    inside = [
        min(math.dist(rig.camera(t).pose.position, rig.camera(s).pose.position) for s in rig.source_names)
        for t in rig.target_names
    ]
    assert sorted(inside)[1] < 0.35
    assert sorted(inside)[-2] > 0.1


def test_museum_cameras_look_outward_evenly() -> None:
    rig = twin_cameras("museum")
    offsets = np.array([rig.camera(n).pose.position for n in rig.source_names]) - (0, 0, 1.65)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 0.3)
    forward = np.array([rig.camera(n).pose.rotation()[:, 0] for n in rig.source_names])
    np.testing.assert_allclose(forward, offsets / 0.3, atol=1e-12)
    cosines = forward @ forward.T - 2 * np.eye(24)
    assert np.degrees(np.arccos(cosines.max(axis=1))) == pytest.approx(43.69, abs=0.01)  # a snub cube


@pytest.mark.parametrize("name", list(TWINS))
def test_cached_frames_are_what_a_full_render_gives(name: str) -> None:
    twin = make_twin(name, SCALE, seed=3)
    for index in (0, 41):
        for camera in (twin.source_names[0], twin.source_names[-1], "t0", "t2"):
            at = twin.camera(camera, index)
            assert same(twin.truth(at, index), render_view(twin.scene, at, index / 30.0))


@pytest.mark.parametrize("name", ["painter", "gymnasium-b"])
def test_bits_depend_on_the_seed_only(name: str) -> None:
    def frame(seed: int, threads: int) -> list[View]:
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        try:
            return list(twin_frame(make_twin(name, SCALE, seed), 7, ("v1", "v4")).views)
        finally:
            numba.set_num_threads(before)

    first, again = frame(5, 1), frame(5, numba.get_num_threads())
    assert all(same(a, b) for a, b in zip(first, again, strict=True))
    assert not any(same(a, b) for a, b in zip(first, frame(6, 1), strict=True))


@pytest.mark.parametrize("name", ["museum", "hijack", "street"])
def test_views_agree_where_they_see_the_same_point(name: str) -> None:
    twin = make_twin(name, 0.12)
    a, b = twin.view(twin.source_names[0], 20), twin.truth(twin.camera("t0"), 20)
    depth = a.camera.depth.depth(a.codes)
    uv, expected = b.camera.project(a.camera.unproject(grid(a.camera), depth))
    inside = (
        np.isfinite(uv).all(-1) & (uv > 1).all(-1) & (uv < (b.camera.width - 1, b.camera.height - 1)).all(-1)
    )
    x, y = (np.where(inside, uv[..., k], 0).astype(int) for k in (0, 1))
    seen = b.camera.depth.depth(b.codes)[y, x]
    agree = inside & (np.abs(seen / expected - 1) < 0.01)
    assert inside.sum() > 500
    assert agree.sum() > 0.75 * inside.sum()
    difference = np.abs(a.texture.y.astype(float) - b.texture.y[y, x])[agree]
    shuffled = np.abs(a.texture.y.astype(float) - b.texture.y[y[::-1], x[::-1]])[agree]
    assert np.median(difference) < 20  # of 876: the pixels' footprints differ
    assert np.median(shuffled) > 4 * np.median(difference)


@pytest.mark.parametrize("name", list(TWINS))
def test_people_move_and_uncover_background(name: str) -> None:
    twin = make_twin(name, SCALE, depth_noise=0.0)
    uncovered = share = 0.0
    for source in twin.source_names[:: max(1, len(twin.source_names) // 4)]:
        camera = twin.camera(source)
        background = render_view(twin.scene, camera, 0.0, background_only=True)
        start, later = twin.truth(camera, 0), twin.truth(camera, 60)
        hidden = start.codes > background.codes  # larger codes are nearer: a person stands in front
        assert (start.codes >= background.codes).all()
        changed = (start.texture.y != background.texture.y) & ~_wider(hidden)
        assert changed.mean() < 0.002  # limbs thinner than a pixel; the light in the scene does not change
        uncovered += (hidden & (later.codes == background.codes)).sum()
        share += hidden.sum()
    assert share > 100
    assert uncovered > 0.15 * share


def _wider(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The mask and all neighbouring pixels: one of their samples may see what their centre does not."""
    padded = np.pad(mask, 1)
    h, w = mask.shape
    return np.any([padded[y : y + h, x : x + w] for y in range(3) for x in range(3)], axis=0)


@pytest.mark.parametrize("name", list(TWINS))
def test_every_depth_is_inside_its_range(name: str) -> None:
    twin = make_twin(name, 0.02, depth_noise=0.0)
    for index in (0, 77, 180):
        for listed in twin.cameras:
            camera = twin.camera(listed.name, index)
            codes = render_view(twin.scene, camera, index / 30.0, samples=1).codes
            assert codes.min() > 0
            assert codes.max() < camera.depth.max_code


def test_the_street_reaches_from_people_near_by_to_hills_far_away() -> None:
    twin = make_twin("street", SCALE)
    view = twin.view("v3", 0)
    depth = view.camera.depth.depth(view.codes)
    assert depth.min() < 6.0
    assert depth.max() > 310.0
    # A camera at height h that looks down by an angle sees level ground at the depth of that plane.
    away = rays(view.camera)
    with np.errstate(divide="ignore"):
        ground = np.where(away[..., 2] < 0, -view.camera.pose.position[2] / away[..., 2], np.inf)
    agree = np.abs(view.codes.astype(float) - view.camera.depth.codes(ground)) <= 1
    assert agree.mean() > 0.15  # asphalt; the rest is pavements, houses and people
    assert (depth[~agree] < ground[~agree]).all()  # and nothing is below it


@pytest.mark.parametrize(("name", "plain"), [("museum-lamps", "museum"), ("gymnasium-lamps", "gymnasium-a")])
def test_light_fades_and_gets_warmer_here_and_there(name: str, plain: str) -> None:
    twin, steady = make_twin(name, SCALE), make_twin(plain, SCALE)
    dimming = twin.scene.dimming
    assert dimming is not None
    start, end = round(dimming.start * FPS), round(dimming.end * FPS)
    camera = twin.camera("t2")
    assert same(twin.truth(camera, start), steady.truth(camera, start))
    halfway = (start + end) // 2
    assert same(twin.truth(camera, halfway), render_view(twin.scene, camera, halfway / FPS))
    changes = []
    for source in twin.source_names:
        now, before = (t.view(source, end) for t in (twin, steady))
        np.testing.assert_array_equal(now.codes, before.codes)
        gain = (now.texture.y - 64.0) / np.maximum(before.texture.y - 64.0, 1.0)
        redder = now.texture.cr.astype(float) - before.texture.cr
        changes.append([*np.percentile(gain, [1, 99]), *np.percentile(redder, [1, 99])])
    darkest, brightest, least, most = np.array(changes).T
    assert darkest.min() < 0.8  # at one end
    assert brightest.max() > 0.9  # while there is hardly a change at the other, but that
    assert most.max() > 15  # it is redder
    assert least.min() < 3


def test_the_runner_of_gymnasium_b_is_the_only_difference() -> None:
    a, b = (make_scene(name, 0) for name in ("gymnasium-a", "gymnasium-b"))
    at = 2.0
    moved = [
        not np.allclose([p.centre for p in x(at)], [p.centre for p in y(at)])
        for x, y in zip(a.actors, b.actors, strict=True)
    ]
    assert moved == [True] + [False] * (len(a.actors) - 1)


def test_depth_errors_grow_with_their_strength_and_leave_the_texture() -> None:
    clean = make_twin("painter", 0.1, depth_noise=0.0)
    truth = clean.view("v5", 9)
    spread = []
    for strength in (0.5, 1.0, 2.0):
        noisy = make_twin("painter", 0.1, depth_noise=strength).view("v5", 9)
        assert all(np.array_equal(p, q) for p, q in zip(planes(noisy)[:3], planes(truth)[:3], strict=True))
        error = np.abs(noisy.codes.astype(float) - truth.codes)
        spread.append(np.median(error))
    assert spread[0] > 20
    assert spread[1] == pytest.approx(2 * spread[0], rel=0.3)
    assert spread[2] == pytest.approx(2 * spread[1], rel=0.3)
    other = make_twin("painter", 0.1).view("v5", 10)
    assert not np.array_equal(other.codes, make_twin("painter", 0.1).view("v5", 9).codes)


def test_a_way_goes_to_and_fro() -> None:
    way = Way([(0.0, 0.0), (3.0, 0.0), (3.0, 4.0)], speed=1.0, start=2.0)
    for time, position, heading in (
        (0.0, (0, 0), 0.0),
        (3.0, (1, 0), 0.0),
        (6.0, (3, 1), math.pi / 2),
        (10.0, (3, 3), 1.5 * math.pi),
        (15.5, (0.5, 0), math.pi),
        (17.0, (1, 0), 0.0),
    ):
        where, facing, _ = way.at(time)
        np.testing.assert_allclose(where, position, atol=1e-12)
        assert facing == pytest.approx(heading)


@pytest.mark.parametrize(
    "pattern", [k for k in range(8) if k != patterns.PICTURE]
)  # a picture ends at its frame
def test_patterns_fade_to_their_mean_far_away(pattern: int) -> None:
    palette = Palette()
    palette.add(pattern, (0.8, 0.5, 0.2), (0.1, 0.2, 0.6), scale=0.2, rough=0.3)
    materials = palette.packed()
    rng = np.random.default_rng(0)
    at = rng.uniform(-3, 3, (400, 2))

    def colours(footprint: float) -> npt.NDArray[np.float64]:
        return np.array(
            [patterns.pattern_colour(materials, 0, x, y, 0.3, x, y, 4.0, 4.0, footprint) for x, y in at]
        )

    near, far = colours(0.002), colours(20.0)
    assert near.std(axis=0).max() > 0.03
    assert (far.std(axis=0) < 0.35 * near.std(axis=0)).all()
    if pattern != patterns.MARBLE:  # its veins go, its ground stays
        np.testing.assert_allclose(far.mean(axis=0), near.mean(axis=0), atol=0.08)


def test_written_twin_reads_back_with_its_moving_camera(tmp_path: Path) -> None:
    folder = tmp_path / "gym"
    done = []
    write_twin("gymnasium-a", folder, SCALE, 3, progress=lambda k, total: done.append((k, total)))
    assert done[-1] == (30, 30)
    sequence, twin = open_sequence(folder), make_twin("gymnasium-a", SCALE)
    assert sequence.source_names == twin.source_names
    assert sequence.frame_count == 3
    for index in range(3):
        expected = twin_frame(twin, index)
        for read, made in zip(sequence.frame(index).views, expected.views, strict=True):
            assert same(read, made)
            np.testing.assert_allclose(read.camera.pose.position, made.camera.pose.position, atol=1e-9)
            np.testing.assert_allclose(read.camera.pose.rotation(), made.camera.pose.rotation(), atol=1e-9)
    cameras = {c["Name"]: c for c in json.loads((folder / "gym.json").read_text())["cameras"]}
    rows = (folder / cameras["v4"]["Poses"]).read_text().split()
    assert len(rows) == 4  # a header and three frames
    assert "Poses" not in cameras["v0"]
    positions = [sequence.view("v4", k).camera.pose.position[0] for k in range(3)]
    assert positions[0] < positions[1] < positions[2]
    for name in twin.rig.target_names:
        camera = twin.camera(name)
        files = {p.name for p in (folder / "truth").glob(f"{name}_*")}
        size = f"{camera.width}x{camera.height}"
        assert files == {f"{name}_texture_{size}_yuv420p10le.yuv", f"{name}_depth_{size}_yuv420p16le.yuv"}


def test_the_views_that_a_viewer_in_the_middle_needs_are_written_first(tmp_path: Path) -> None:
    folder, first = tmp_path / "museum", list[str]()

    def note(done: int, _total: int) -> None:
        if done == 8:
            sequence = open_sequence(folder, growing=True)
            first.extend(name for name in sequence.source_names if sequence.pictures_of(name))

    write_twin("museum", folder, SCALE, 1, progress=note, truth=False)
    assert len(first) == 8
    twin = make_twin("museum", SCALE)
    cameras = {camera.name: camera for camera in twin.sources}
    home = home_pose(twin.sources)
    ahead = {name: float(cameras[name].pose.rotation()[:, 0] @ home.rotation()[:, 0]) for name in cameras}
    assert set(first) == set(sorted(ahead, key=lambda name: -ahead[name])[:8])  # they look where the viewer looks


def test_the_command_writes_a_sequence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command("frog", tmp_path / "Frog", scale=0.02, frames=2, seed=1, depth_noise=0.0)
    assert "13 source views, 4 virtual cameras" in capsys.readouterr().out
    sequence, twin = open_sequence(tmp_path / "Frog"), make_twin("frog", 0.02, 1, 0.0)
    assert same(sequence.view("v13", 1), twin.view("v13", 1))
    assert sequence.fps == 30


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("zoo",), "twin: 'zoo'"),
        (("museum", -1.0), "scale: -1.0"),
        (("museum", math.nan), "scale: nan"),
        (("museum", SCALE, 0), "frames: 0"),
        (("museum", SCALE, 1, 0, -1.0), "depth noise: -1.0"),
    ],
)
def test_bad_parameters_are_named(tmp_path: Path, arguments: tuple[object, ...], message: str) -> None:
    name, *rest = arguments
    with pytest.raises(ValueError, match=message):
        write_twin(name, tmp_path / "out", *rest)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()
