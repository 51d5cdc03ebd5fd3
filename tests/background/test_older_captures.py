"""What is left of older captures: triangles, marks and colours stay as they are, in less memory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.capture import Captures
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.older_captures import OlderCaptures, condense
from farside.engine.background.pbs import ProbableBackgroundSurface
from farside.engine.background.tolerances import Tolerances
from farside.engine.geometry.triangulation import TriangulationOptions, triangulate
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture, View
from farside.engine.support.packed import CAMERA_SIZE

SPHERE = Equirectangular(160, 80, (-np.pi, np.pi), (-np.pi / 2, np.pi / 2))
FLAT = Perspective.from_fov(150, 110, 1.2)


def capture_of(captures, projection, seed):
    """A capture of a rough surface, begun by camera 0."""
    rng = np.random.default_rng(seed)
    camera = Camera("v0", projection, Pose((0.0, 0.1 * seed, 0.0)), DepthCoding(0.3, 20.0, 16, has_invalid=True))
    shape = camera.height, camera.width
    half = -(-shape[0] // 2), -(-shape[1] // 2)
    texture = Texture(*(rng.integers(64, 940, size).astype(np.uint16) for size in (shape, half, half)))
    codes = camera.depth.codes(3.0 + 0.02 * rng.random(shape))
    view = View(camera, texture, codes)
    return captures.add(0, MaximumDepthImage(view, Tolerances(0.1, 0.01), 0.05), np.zeros(CAMERA_SIZE))


def surface_of(pbs, capture, seed, share=0.4):
    """A surface of some pixels of a capture, some of its triangles culled, with marks."""
    rng = np.random.default_rng(100 + seed)
    camera, codes = capture.image.camera, capture.image.codes
    keep = np.zeros(codes.shape, np.uint8)
    for _ in range(6):
        y, x = rng.integers(0, codes.shape[0]), rng.integers(0, codes.shape[1])
        keep[y : y + rng.integers(1, 40), x : x + rng.integers(1, 40)] = 1
    keep[:, -2:] = keep[:, :2] = 1  # over the seam of a sphere
    mesh = triangulate(camera, codes, TriangulationOptions(0.01, 0.5, extend_edges=True), keep=keep)
    surface = pbs.set_progressive(capture.number, 0, mesh)
    surface.invalid[rng.random(len(surface.invalid)) < share] = 1
    surface.marks[:] = rng.integers(1, 8, surface.marks.shape)
    return surface


def corners_of(surface, captures):
    """Points, marks and colours of the corners of valid triangles, in an order of their own."""
    valid = surface.invalid == 0
    corners = surface.mesh.triangles[valid]
    middles = surface.mesh.uv[corners].mean(axis=1)
    colours = np.stack([captures.colours(surface.capture, uv) for uv in (
        surface.mesh.uv[corners[:, 0]], surface.mesh.uv[corners[:, 1]], surface.mesh.uv[corners[:, 2]], middles,
    )], axis=1)  # fmt: skip
    points = surface.mesh.points[corners].reshape(len(corners), -1)
    rows = np.concatenate([points, surface.marks[valid], colours.reshape(len(corners), -1)], axis=1)
    return rows[np.lexsort(rows.T[::-1])]


@pytest.mark.parametrize("projection", [FLAT, SPHERE], ids=["flat", "sphere"])
@pytest.mark.parametrize("count", [1, 3])
def test_points_marks_and_colours_stay(projection, count):
    captures, pbs = Captures(), ProbableBackgroundSurface(1)
    made = [capture_of(captures, projection, seed) for seed in range(count)]
    surfaces = [surface_of(pbs, capture, seed) for seed, capture in enumerate(made)]
    expected = np.concatenate([corners_of(surface, captures) for surface in surfaces])
    remains, joined = condense(surfaces, captures, 0, 9)
    captures.put(remains)
    assert (joined.capture, joined.camera, remains.number, remains.camera) == (9, 0, 9, 0)
    assert not joined.invalid.any()
    found = corners_of(joined, captures)
    expected = expected[np.lexsort(expected.T[::-1])]
    assert found.shape == expected.shape
    points = 9 + pbs.words
    np.testing.assert_array_equal(found[:, :points], expected[:, :points])
    np.testing.assert_allclose(found[:, points:], expected[:, points:], atol=0.3)
    # Parts lie apart, so that what is nearer than `reach` belongs to one part.
    assert remains.reach > 0
    inside = joined.mesh.uv
    assert inside.min() >= remains.reach / 2
    assert (inside.max(axis=0) <= np.array(remains.codes.shape[::-1]) - remains.reach / 2).all()


def test_remains_can_be_joined_again():
    captures, pbs = Captures(), ProbableBackgroundSurface(1)
    surfaces = [surface_of(pbs, capture_of(captures, FLAT, seed), seed) for seed in range(2)]
    expected = np.concatenate([corners_of(surface, captures) for surface in surfaces])
    first, one = condense(surfaces[:1], captures, 0, 7)
    captures.put(first)
    second, both = condense([one, surfaces[1]], captures, 0, 8)
    captures.put(second)
    found = corners_of(both, captures)
    expected = expected[np.lexsort(expected.T[::-1])]
    np.testing.assert_array_equal(found[:, :9], expected[:, :9])
    np.testing.assert_allclose(found[:, 10:], expected[:, 10:], atol=0.3)


def test_a_capture_without_triangles_is_dropped():
    captures, pbs = Captures(), ProbableBackgroundSurface(1)
    older = OlderCaptures(pbs, captures)
    first, second = (capture_of(captures, FLAT, seed) for seed in range(2))
    surface_of(pbs, first, 0, share=1.1)  # all culled
    older.retire(first)
    assert [capture.number for capture in captures] == [second.number]
    assert not pbs.progressive
    assert captures.free == first.number


def test_a_capture_with_a_part_of_the_s_pbs_stays_whole():
    captures, pbs = Captures(), ProbableBackgroundSurface(1)
    first = capture_of(captures, FLAT, 0)
    mesh = surface_of(pbs, first, 0).mesh
    pbs.set_static(first.number, 0, mesh)
    OlderCaptures(pbs, captures).retire(first)
    assert list(captures) == [first]


def test_the_number_of_remains_grows_with_the_logarithm_of_that_of_captures():
    captures, pbs = Captures(), ProbableBackgroundSurface(1)
    older = OlderCaptures(pbs, captures)
    most, triangles = 0, 0
    for seed in range(60):
        capture = capture_of(captures, FLAT, seed)
        triangles += surface_of(pbs, capture, seed).valid_count
        older.retire(capture)
        pbs.commit()
        most = max(most, len(captures))
    assert most < 20
    assert pbs.counts()["p_pbs"] == triangles
    for surface in pbs.surfaces():
        surface.invalid[:] = 1
    older.retire(capture_of(captures, FLAT, 99))
    assert len(captures) == 0  # nothing refers to any of them


def test_readers_in_other_threads_keep_the_pictures_that_they_look_at():
    captures, pbs = Captures(), ProbableBackgroundSurface(1)
    older, capture = OlderCaptures(pbs, captures), capture_of(captures, FLAT, 0)
    surface = surface_of(pbs, capture, 0)
    seen, expected = captures.snapshot(), captures.colours(0, surface.mesh.uv)
    older.retire(capture)
    del capture
    capture_of(captures, dataclasses.replace(FLAT), 5)
    np.testing.assert_array_equal(seen.colours(0, surface.mesh.uv), expected)
