"""Pictures thrown onto a picture's surfaces: as the slow twin, levels, alpha, and what numbers may be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.engine.kernels.rendering.projector import Eye, ProjectedPicture, project
from farside.engine.kernels.rendering.records import DepthBuffer, Planes
from farside.engine.rendering.effects import levels_of_rgba, levels_of_texture
from farside.engine.rendering.target import Target
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.effects import AddedMesh, Projector
from farside.engine.rig.texture import from_rgb
from oracle import effects as oracle

CODING = DepthCoding(0.3, 20.0, 16, has_invalid=True)
ORIGIN = np.array([0.3, -0.2, 0.1])
PROJECTIONS = (
    Perspective.from_fov(40, 30, 1.4),
    Perspective(40, 30, -30.0, 28.0, 17.0, 12.0),
    Equirectangular(48, 24, (-1.2, 1.3), (-0.8, 0.7)),
)


def wavy_room(camera, seed):
    """Depths [h, w] of something irregular."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    return 3.0 + 0.5 * np.sin(0.4 * u + rng.uniform(0, 6)) + 0.4 * np.cos(0.3 * v) + (u > 0.6 * camera.width)


@pytest.mark.parametrize("adds", [False, True])
@pytest.mark.parametrize("projection", PROJECTIONS, ids=["perspective", "mirrored", "sphere"])
def test_pictures_are_thrown_as_by_the_slow_twin(projection, adds):
    rng = np.random.default_rng(int(adds))
    eye = Camera("eye", projection, Pose.from_euler((0.2, 0.1, 0.0), 0.1, -0.05, 0.2), CODING)
    projector = Camera("p", Perspective.from_fov(32, 20, 0.9), Pose.from_euler((0.1, 0.8, 0.1), -0.2, 0.1, 0.1), CODING)
    map_camera = Camera("map", Perspective.from_fov(16, 10, 0.9), projector.pose, CODING)
    codes = CODING.codes(wavy_room(map_camera, 1))
    codes[rng.random(codes.shape) < 0.1] = 0
    depths = np.where(codes > 0, CODING.depth(codes), np.nan)
    disparity = (1 / wavy_room(eye, 2)).astype(np.float32)
    disparity[rng.random(disparity.shape) < 0.1] = 0.0
    winner = (rng.random(disparity.shape) < 0.4).astype(np.uint8)
    push, delta, strength = (0.05, 0.004), (0.5, 0.05), 0.7
    rgba = rng.integers(0, 256, (20, 32, 4)).astype(np.uint8)
    picture = levels_of_rgba(rgba)
    planes = Planes(*(rng.uniform(100, 900, disparity.shape).astype(np.float32) for _ in range(3)))
    stacked = [picture.texels[at : at + w * h].reshape(h, w, 4).astype(float) for at, w, h in picture.levels]
    expected = oracle.project(
        eye, planes, disparity, winner == 1, push, projector, stacked, (map_camera, depths), delta, strength, adds
    )
    target = Target(eye, ORIGIN)
    thrown = ProjectedPicture(
        picture.texels, picture.levels, projector.packed(ORIGIN), codes, CODING.offset, CODING.step, delta, strength,
        adds,
    )  # fmt: skip
    before = [plane.copy() for plane in planes]
    project(DepthBuffer(disparity, winner), Eye(target.packed, target.radians_a_pixel, 1, push), thrown, planes)
    assert (np.abs(planes.luma - before[0]) > 1).mean() > 0.03
    for plane, wanted in zip(planes, expected, strict=True):
        # Where rounding decides whether a texel lies within delta, a share of the picture is there or not.
        assert (np.abs(plane - wanted) < 0.05).mean() > 0.998


def test_a_picture_has_all_levels_down_to_one_texel():
    rng = np.random.default_rng(0)
    rgba = rng.integers(0, 256, (13, 20, 4)).astype(np.uint8)
    picture = levels_of_rgba(rgba)
    assert picture.size == (20, 13)
    assert picture.levels[:, 1:].tolist() == [[20, 13], [10, 7], [5, 4], [3, 2], [2, 1], [1, 1]]
    first = picture.texels[: 20 * 13].reshape(13, 20, 4).astype(float)
    second = picture.texels[260 : 260 + 70].reshape(7, 10, 4)
    blocks = first[:12].reshape(6, 2, 10, 2, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(second[:6], blocks, atol=0.51)
    np.testing.assert_allclose(second[6], first[12].reshape(10, 2, 4).mean(axis=1), atol=0.51)


def test_an_opaque_picture_is_the_same_from_rgb_and_from_a_view():
    rgb = np.repeat(np.repeat(np.random.default_rng(1).integers(0, 256, (5, 6, 3)), 2, 0), 2, 1).astype(np.uint8)
    alpha = np.full((10, 12, 1), 255, np.uint8)
    a, b = levels_of_rgba(np.concatenate([rgb, alpha], axis=2)), levels_of_texture(from_rgb(rgb))
    np.testing.assert_allclose(a.texels.astype(int), b.texels.astype(int), atol=1)
    assert (a.texels[:, 3] == 1023).all()


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: Projector(Pose(), 0.0), "fov: 0.0: expected more than 0"),
        (lambda: Projector(Pose(), math.nan), "fov: nan"),
        (lambda: Projector(Pose(), 3.1), "at most 2.9671 radians"),
        (lambda: Projector(Pose(), 1.0, 1.5), "strength: 1.5: expected a number from 0 to 1"),
        (lambda: Projector(Pose(), 1.0, 1.0, "burn"), "blend: 'burn': expected one of mix, add"),
        (lambda: AddedMesh(Pose(), 0.0), "scale: 0.0: expected a number from 1e-06 to 1e"),
        (lambda: AddedMesh(Pose(), math.nan), "scale: nan"),
    ],
)
def test_what_makes_no_sense_is_refused(made, said):
    with pytest.raises(ValueError, match=said):
        made()
