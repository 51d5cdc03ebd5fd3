from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.tolerances import Tolerances
from farside.engine.camera import Camera, Perspective, Pose
from farside.engine.depth import DepthCoding
from farside.engine.frame import View
from farside.engine.kernels.maximum_depth import PHASES
from oracle.maximum_depth import update
from rooms import BOX_Y, WALL_Y, camera_row, see, texture_of

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
        np.testing.assert_array_equal(image.updated != 0, updated)
        image.updated[:] = image.provisional[:] = 0  # colours that are taken later have their own tests


@pytest.mark.parametrize("size", [(150, 30), (3, 2)])
def test_colours_beside_something_nearer_are_provisional(size):
    coding = DepthCoding(0.5, 20.0, 16, True)
    view = random_view(Camera("c", Perspective.from_fov(*size, 1.0), Pose(), coding), 3)
    image = MaximumDepthImage(view, TOLERANCES, edge=20000 * coding.step)
    padded = np.pad(view.codes.astype(int), 1, mode="edge")
    h, w = view.codes.shape
    nearest = np.max([padded[y : y + h, x : x + w] for y in range(3) for x in range(3)], axis=0)
    np.testing.assert_array_equal(image.provisional != 0, nearest > view.codes.astype(int) + 20000)
    assert 0 < np.mean(image.provisional) < 1


def test_the_same_view_again_changes_nothing():
    view = see(camera_row(1)[0], box_y=0.0)
    image = MaximumDepthImage(view, TOLERANCES, edge=0.1)
    assert image.update(view) == 0
    assert not image.updated.any()


def test_someone_who_leaves_uncovers_depth_and_colour():
    camera = camera_row(1)[0]
    image = MaximumDepthImage(see(camera, box_y=0.0), TOLERANCES, edge=0.05)
    covered = see(camera, box_y=0.0).texture.y == BOX_Y
    empty = see(camera)
    assert image.update(empty) == np.count_nonzero(covered)
    np.testing.assert_array_equal(image.codes, empty.codes)
    for plane in ("y", "cb", "cr"):
        np.testing.assert_array_equal(getattr(image.texture, plane), getattr(empty.texture, plane))
    assert image.update(see(camera, box_y=0.5)) == 0  # someone who comes back covers nothing of it


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
