from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.tolerances import Tolerances
from farside.engine.geometry.triangulation import TriangulationOptions, triangulate
from farside.engine.kernels.background.flags import KEPT, PROVISIONAL, UPDATED
from farside.engine.kernels.background.fusion import COLOUR_FRAMES, DEPTH_FRAMES
from farside.engine.kernels.background.maximum_depth import PHASES, TILE
from farside.engine.kernels.background.nontrivial import farther_than
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import View
from oracle.maximum_depth import settle, update
from support.rooms import BOX_X, BOX_Y, CODING, WALL_X, WALL_Y, camera_row, see, texture_of

TOLERANCES = Tolerances(delta_m=0.1, margin_m=0.05)


def random_view(camera, seed, invalid=0.2):
    rng = np.random.default_rng(seed)
    shape = (camera.height, camera.width)
    codes = rng.integers(1, camera.depth.max_code + 1, shape, np.uint16)
    codes[rng.random(shape) < invalid] = 0
    return View(camera, texture_of(rng.integers(64, 940, shape)), codes)


@pytest.mark.parametrize("size", [(150, 30), (64, 2), (33, 7)])
@pytest.mark.parametrize("has_invalid", [True, False])
@pytest.mark.parametrize("bits", [16, 8])
def test_updates_are_those_of_the_slow_twin(size, has_invalid, bits):
    coding = DepthCoding(0.5, 20.0, bits, has_invalid)
    camera = Camera("c", Perspective.from_fov(*size, 1.0), Pose(), coding)
    image = MaximumDepthImage(random_view(camera, 0), TOLERANCES, edge=1e9)
    for seed in (1, 2):
        view = random_view(camera, seed)
        codes, luma, updated = update(
            (image.codes, image.texture.y), view, TOLERANCES.margin_m, TOLERANCES.margin_disparity(coding)
        )
        assert image.update(view) == np.count_nonzero(updated) > 0
        np.testing.assert_array_equal(image.codes, codes)
        np.testing.assert_array_equal(image.texture.y, luma)
        np.testing.assert_array_equal(image.flags & UPDATED != 0, updated)
        image.flags[:] = 0  # delayed colours have their own tests


@pytest.mark.parametrize("has_invalid", [True, False])
@pytest.mark.parametrize("far", [20.0, 1000.0])
@pytest.mark.parametrize(("margin_m", "noise"), [(0.0, 0.0), (0.002, 0.0), (0.002, 1e-3), (0.5, 0.0)])
def test_the_least_that_is_farther_than_any_code_is_found(has_invalid, far, margin_m, noise):
    coding, tolerances = DepthCoding(0.5, far, 16, has_invalid), Tolerances(0.1, margin_m, noise)
    each = np.arange(1 << 16).reshape(-1, 32)
    camera = Camera("c", Perspective.from_fov(32 * TILE, 2 * len(each), 1.0), Pose(), coding)
    codes = np.kron(each, np.ones((2, TILE))).astype(np.uint16)  # the same code in all pixels that are compared at once
    view = View(camera, texture_of(np.full(codes.shape, 500)), codes)
    margins = coding.offset, coding.step, has_invalid, margin_m, tolerances.margin_disparity(coding)
    limits = np.array([[farther_than(code, *margins) for code in row] for row in each])
    farthest = np.ceil(limits).clip(has_invalid, 1 << 16) - 1  # an invalid one where nothing is farther
    image = MaximumDepthImage(view, tolerances, edge=1e9)
    for more, found in ((1, 0), (0, np.count_nonzero(farthest >= has_invalid))):
        new = codes.copy()
        new[1::2, 37::TILE] = np.where(np.isinf(limits), 65535 if found else 0, (farthest + more).clip(0, 65535))
        assert image.update(dataclasses.replace(view, codes=new)) == found


@pytest.mark.parametrize("size", [(150, 70), (33, 7)])
def test_a_sample_of_rows_finds_everything_within_some_views(size):
    camera = Camera("c", Perspective.from_fov(*size, 1.0), Pose(), DepthCoding(0.5, 20.0, 16, True))
    first = random_view(camera, 0)
    codes = first.codes.copy()
    rng = np.random.default_rng(1)
    for _ in range(6):  # of two rows at most: few are in the first sample
        row, column = rng.integers(size[1] - 1), rng.integers(size[0] - 5)
        codes[row : row + 2, column : column + 5] = 1
    view = dataclasses.replace(first, codes=codes)
    expected, luma, updated = update((first.codes, first.texture.y), view, 0.05, 1.5 * camera.depth.step)
    image = MaximumDepthImage(first, Tolerances(0.1, 0.05), edge=1e9)
    found = [image.update(view, whole=False) for _ in range(PHASES)]
    assert sum(found) == np.count_nonzero(updated) > found[0] or size[0] < TILE
    np.testing.assert_array_equal(image.codes, expected)
    np.testing.assert_array_equal(image.texture.y, luma)
    np.testing.assert_array_equal(image.flags & UPDATED != 0, updated)
    rows, columns = np.nonzero(updated)
    blocks = np.zeros(image.pending.shape, bool)
    blocks[rows // (2 * PHASES), columns // TILE] = True
    np.testing.assert_array_equal(image.pending, blocks)


def test_what_is_as_high_as_a_block_is_found_at_once():
    camera = Camera("c", Perspective.from_fov(4 * TILE, 10 * PHASES, 1.0), Pose(), CODING)
    shape = (camera.height, camera.width)
    near = View(camera, texture_of(np.full(shape, 500)), np.full(shape, 40000, np.uint16))
    codes = near.codes.copy()
    codes[5 : 5 + 4 * PHASES, 20:200] = 20000
    image = MaximumDepthImage(near, TOLERANCES, edge=1e9)
    image.update(dataclasses.replace(near, codes=codes), whole=False)
    np.testing.assert_array_equal(image.codes[2 * PHASES : 4 * PHASES], codes[2 * PHASES : 4 * PHASES])
    image.update(dataclasses.replace(near, codes=codes), whole=False)  # the blocks next to the change
    np.testing.assert_array_equal(image.codes, codes)


@pytest.mark.parametrize("size", [(150, 30), (3, 2)])
def test_colours_beside_something_nearer_are_provisional(size):
    coding = DepthCoding(0.5, 20.0, 16, True)
    view = random_view(Camera("c", Perspective.from_fov(*size, 1.0), Pose(), coding), 3)
    image = MaximumDepthImage(view, TOLERANCES, edge=20000 * coding.step)
    padded = np.pad(view.codes.astype(int), 1, mode="edge")
    h, w = view.codes.shape
    nearest = np.max([padded[y : y + h, x : x + w] for y in range(3) for x in range(3)], axis=0)
    provisional = image.flags & PROVISIONAL != 0
    np.testing.assert_array_equal(provisional, nearest > view.codes.astype(int) + 20000)
    assert 0 < np.mean(provisional) < 1


def test_the_same_view_again_changes_nothing():
    view = see(camera_row(1)[0], box_y=0.0)
    image = MaximumDepthImage(view, TOLERANCES, edge=0.1)
    assert image.update(view) == 0
    assert not np.any(image.flags & UPDATED)


def test_what_belongs_to_the_model_stays_so_whatever_else_is_noted():
    camera = camera_row(1)[0]
    image = MaximumDepthImage(see(camera, box_y=0.0), TOLERANCES, edge=0.05)
    kept = np.arange(image.flags.size).reshape(image.flags.shape) % 3 == 0
    image.flags[kept] |= KEPT
    uncovered = image.update(see(camera))
    assert uncovered == np.count_nonzero(image.flags & UPDATED) > 0
    flags = image.flags & UPDATED
    image.compare_by(dataclasses.replace(TOLERANCES, noise=SIGMA * CODING.step))
    fuses(image, [see(camera)] * PHASES)
    np.testing.assert_array_equal(image.kept != 0, kept)
    np.testing.assert_array_equal(image.flags & UPDATED, flags)


def test_someone_who_leaves_uncovers_depth_and_colour():
    camera = camera_row(1)[0]
    image = MaximumDepthImage(see(camera, box_y=0.0), TOLERANCES, edge=0.05)
    covered = see(camera, box_y=0.0).texture.y == BOX_Y
    empty = see(camera)
    assert image.update(empty) == np.count_nonzero(covered)
    np.testing.assert_array_equal(image.codes, empty.codes)
    for plane in ("y", "cb", "cr"):
        np.testing.assert_array_equal(getattr(image.texture, plane), getattr(empty.texture, plane))
    assert image.update(see(camera, box_y=0.5)) == 0  # someone who comes back does not cover it


def test_colours_from_a_rim_are_replaced_when_it_has_gone():
    camera = camera_row(1)[0]
    first = see(camera, box_y=0.0)
    mixed = first.texture.y.copy()
    box = first.texture.y == BOX_Y
    rim = np.zeros_like(box)
    rim[1:-1, 1:-1] = (box[:-2, 1:-1] | box[2:, 1:-1] | box[1:-1, :-2] | box[1:-1, 2:])[:] & ~box[1:-1, 1:-1]
    mixed[rim] = (BOX_Y + WALL_Y) // 2
    image = MaximumDepthImage(dataclasses.replace(first, texture=texture_of(mixed)), TOLERANCES, edge=0.05)
    assert np.count_nonzero(image.texture.y == (BOX_Y + WALL_Y) // 2) == np.count_nonzero(rim) > 20
    for _ in range(PHASES):
        image.update(see(camera, box_y=1.5, half=0.1))
    np.testing.assert_array_equal(image.texture.y, WALL_Y)
    np.testing.assert_array_equal(image.texture.cb, WALL_Y // 2)


def test_chroma_waits_while_something_nearer_shares_it():
    camera = camera_row(1)[0]
    wall, box = see(camera), see(camera, box_y=0.0, half=9.0)

    def wall_but_for(row, column):
        codes, luma = wall.codes.copy(), wall.texture.y.copy()
        codes[row, column], luma[row, column] = box.codes[row, column], BOX_Y
        return View(camera, texture_of(luma), codes)

    image = MaximumDepthImage(wall_but_for(10, 20), TOLERANCES, edge=9.0)
    assert image.texture.cb[5, 10] == BOX_Y // 2
    image.update(wall_but_for(10, 21))
    assert image.texture.y[10, 20] == WALL_Y
    assert image.texture.cb[5, 10] == BOX_Y // 2
    for _ in range(PHASES):
        image.update(wall)
    assert image.texture.cb[5, 10] == WALL_Y // 2


# Fusion of what is seen again and again

SIGMA = 100.0  # codes


def noisy(view, rng, sigma=SIGMA, luma=0.0):
    """A view whose depth and luma flicker."""
    codes = np.rint(view.codes + rng.normal(0, sigma, view.codes.shape)).clip(1, CODING.max_code).astype(np.uint16)
    values = np.rint(view.texture.y + rng.normal(0, luma, view.codes.shape) if luma else view.texture.y)
    return View(view.camera, texture_of(values), codes)


def fuses(image, views):
    for view in views:
        image.update(view)
        image.fuse(view)


def fusing(view, deviations=1.0):
    """A maximum depth image that tolerates `deviations` times the actual noise."""
    noise = Tolerances(0.1, 1e-6, deviations * SIGMA * CODING.step)
    return MaximumDepthImage(view, noise, edge=0.05)


def rms(values):
    return np.sqrt(np.mean(np.asarray(values, float) ** 2))


def test_noise_falls_with_the_square_root_of_the_views_to_a_floor():
    rng, wall = np.random.default_rng(0), see(camera_row(1)[0])
    image = fusing(noisy(wall, rng), deviations=2.0)  # nothing strays so far that it would look like a change
    for rounds in range(1, 3 * DEPTH_FRAMES + 1):
        fuses(image, (noisy(wall, rng) for _ in range(PHASES)))
        off = image.codes.astype(int) - wall.codes
        seen = rounds + 1
        # A recursive mean of the capped kind: the variance of weights 1 / DEPTH_FRAMES that fall off geometrically.
        expected = SIGMA / np.sqrt(min(seen, 2 * DEPTH_FRAMES - 1))
        if seen <= DEPTH_FRAMES // 2 or rounds == 3 * DEPTH_FRAMES:
            assert rms(off) == pytest.approx(expected, rel=0.06)
            assert abs(off.mean()) < 0.05 * SIGMA + 1
    assert image.rounds == 3 * DEPTH_FRAMES
    assert (image.fused == DEPTH_FRAMES).all()


def test_a_maximum_that_is_not_fused_strays_and_a_fused_one_does_not():
    wall, off = see(camera_row(1)[0]), {}
    for fuse in (False, True):
        rng = np.random.default_rng(0)
        image = fusing(noisy(wall, rng))
        for _ in range(20 * PHASES):
            view = noisy(wall, rng)
            image.update(view)
            if fuse:
                image.fuse(view)
        assert image.fused.shape == (wall.codes.shape if fuse else (0, 0))  # without fusion it takes no memory
        off[fuse] = rms(image.codes.astype(int) - wall.codes)
    assert off[False] > 1.2 * SIGMA
    assert off[True] < 0.3 * SIGMA


def test_a_change_is_followed_at_once_and_not_averaged():
    rng, camera = np.random.default_rng(0), camera_row(1)[0]
    before, after = see(camera, box_y=0.0), see(camera)
    box = before.codes != after.codes
    image = fusing(before, deviations=2.0)
    fuses(image, (noisy(before, rng) for _ in range(10 * PHASES)))
    now = noisy(after, rng)
    image.update(now)
    np.testing.assert_array_equal(image.codes[box], now.codes[box])
    np.testing.assert_array_equal(image.fused[box], 1)
    fuses(image, (noisy(after, rng) for _ in range(15 * PHASES)))
    assert rms(image.codes[box].astype(int) - after.codes[box]) == pytest.approx(SIGMA / 4, rel=0.1)


def test_who_comes_and_stands_before_the_wall_pulls_nothing():
    rng, camera = np.random.default_rng(0), camera_row(1)[0]
    wall, someone = see(camera), see(camera, box_y=0.0)
    box = wall.codes != someone.codes
    image = fusing(wall, deviations=2.0)
    fuses(image, (noisy(someone, rng) for _ in range(10 * PHASES)))
    np.testing.assert_array_equal(image.codes[box], wall.codes[box])
    np.testing.assert_array_equal(image.texture.y, WALL_Y)
    np.testing.assert_array_equal(image.texture.cb, WALL_Y // 2)


def test_colours_are_averaged_and_follow_the_light():
    rng, wall = np.random.default_rng(0), see(camera_row(1)[0])
    image = fusing(wall, deviations=2.0)
    fuses(image, (noisy(wall, rng, luma=20.0) for _ in range(40 * PHASES)))
    floor = 20.0 / np.sqrt(2 * COLOUR_FRAMES - 1)
    assert rms(image.texture.y.astype(int) - WALL_Y) == pytest.approx(floor, rel=0.1)
    darker = View(wall.camera, texture_of(np.full(wall.codes.shape, WALL_Y - 40)), wall.codes)
    fuses(image, [darker] * (40 * PHASES))
    assert rms(image.texture.y.astype(int) - (WALL_Y - 40)) < 1.0
    assert rms(image.texture.cb.astype(int) - (WALL_Y - 40) // 2) < 1.0


def test_a_colour_that_was_someones_is_forgotten():
    """Depth shows that someone has left some pixels whose colour is still theirs, because estimated edges wander."""
    camera = camera_row(1)[0]
    there, gone = see(camera, box_y=0.0), see(camera)
    late = View(camera, there.texture, gone.codes)
    image = fusing(there, deviations=2.0)
    image.update(late)
    assert np.count_nonzero(image.texture.y == BOX_Y) > 100
    fuses(image, [gone] * (40 * PHASES))
    assert rms(image.texture.y.astype(int) - WALL_Y) < 1.0  # rounding by chance, of 500 codes
    assert np.abs(image.texture.y.astype(int) - WALL_Y).max() < 10


@pytest.mark.parametrize("extend_edges", [False, True])
def test_points_settle_where_the_fused_depth_is(extend_edges):
    rng, camera = np.random.default_rng(0), camera_row(1)[0]
    view = see(camera, box_y=0.0)
    first = noisy(view, rng)
    image = fusing(first, deviations=1.5)
    mesh = triangulate(camera, first.codes, TriangulationOptions(0.002, 0.05, extend_edges=extend_edges))
    np.testing.assert_allclose(image.settled(mesh, camera.packed()), mesh.points, atol=0.05)
    fuses(image, (noisy(view, rng) for _ in range(20 * PHASES)))
    image.codes[20:24, 10:20] = CODING.codes(np.array(9.0))  # something farther: not these points' surface
    points = image.settled(mesh, camera.packed())
    expected = settle(mesh, camera, image.codes, 1e-6, 6.0 * SIGMA * CODING.step)
    np.testing.assert_allclose(points, expected, atol=1e-4)
    depth = np.where(np.abs(points[:, 0] - BOX_X) < 0.5, BOX_X, WALL_X)
    assert rms(points[:, 0] - depth) < 0.4 * rms(mesh.points[:, 0] - depth)
