"""Morphological anti-aliasing against exact coverage and a slow twin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from farside.engine.kernels.rendering.morphology import DOWN, RIGHT, SPAN, blend_steps, mark_steps
from farside.engine.rendering.antialiasing import smooth_outlines
from farside.engine.rig.frame import Texture

Floats = npt.NDArray[np.float64]
NEAR, FAR = 0.8, 0.2  # disparities
BRIGHT, DARK = 900, 100


def blended(near: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16]]:
    """Luma and chroma of a bright shape in front of a dark background, blended along the outline of `near`."""
    disparity = np.where(near, np.float32(NEAR), np.float32(FAR))
    marks, found = marked(disparity)
    luma = np.where(near, BRIGHT, DARK).astype(np.uint16)
    chroma = np.ascontiguousarray(luma[::2, ::2])
    outs = (luma.copy(), chroma.copy(), chroma.copy())
    blend_steps(marks, found, (luma, chroma, chroma), outs)
    assert np.array_equal(outs[1], outs[2])
    return outs[0], outs[1]


def marked(disparity: npt.NDArray[np.float32], step: float = 0.1) -> tuple[npt.NDArray[np.uint8], ...]:
    h, w = disparity.shape
    marks, found = np.full((h, w), 255, np.uint8), np.zeros((h, -(-w // SPAN)), np.uint8)
    mark_steps(disparity, step, marks, found)
    return marks, found


def half_plane(h: int, w: int, slope: float, offset: float, samples: int) -> Floats:
    """Coverage of each pixel by the half plane above v = slope * u + offset."""
    at = (np.arange(samples) + 0.5) / samples
    v, u = (np.arange(h)[:, None] + at).ravel(), (np.arange(w)[:, None] + at).ravel()
    inside = v[:, None] < slope * u[None, :] + offset
    return inside.reshape(h, samples, w, samples).mean(axis=(1, 3))


# Slopes whose phase relative to the pixels varies along the outline: a staircase does not reveal the phase.
@pytest.mark.parametrize("slope", [0.3141, 0.1379, 0.0813, -0.2113, -0.0507])
@pytest.mark.parametrize("upright", [False, True])
def test_a_straight_outline_comes_close_to_its_coverage(slope: float, upright: bool) -> None:
    h, w = 64, 150
    offset = 20.3 if slope > 0 else 55.3
    exact, centre = (half_plane(h, w, slope, offset, n) for n in (16, 1))
    if upright:
        exact, centre = np.ascontiguousarray(exact.T), np.ascontiguousarray(centre.T)
    near = centre > 0.5
    luma, _ = blended(near)
    coverage = (luma.astype(float) - DARK) / (BRIGHT - DARK)
    # Runs that the picture's border cuts off lack one end.
    inner = (slice(20, -20), slice(0, None)) if upright else (slice(0, None), slice(20, -20))
    error, aliased = (np.abs(c - exact)[inner] for c in (coverage, near.astype(float)))
    edge = (exact > 0)[inner] & (exact < 1)[inner]
    assert error[edge].mean() < 0.4 * aliased[edge].mean()
    assert abs((coverage - exact)[inner][edge].mean()) < 0.02  # shapes do not grow


def test_upright_and_level_silhouettes_are_treated_alike() -> None:
    near = np.add.outer((np.arange(40) - 20.0) ** 2, 0.6 * (np.arange(40) - 19.0) ** 2) < 180
    luma, chroma = blended(near)
    turned, turned_chroma = blended(np.ascontiguousarray(near.T))
    assert np.array_equal(luma, turned.T)
    assert np.array_equal(chroma, turned_chroma.T)


def test_straight_sides_and_slopes_stay() -> None:
    near = np.zeros((30, 70), bool)
    near[10:20, 15:50] = True
    luma, _ = blended(near)
    inside = np.zeros_like(near)
    inside[12:18, 22:43] = True
    assert (luma[inside] == BRIGHT).all()
    assert (luma[14:16, :15] == DARK).all()
    slope = np.tile(np.linspace(0.1, 2.0, 90, dtype=np.float32), (30, 1))
    marks, _ = marked(slope, 0.01)
    assert not marks[:, 1:-2].any()


def test_marks_say_between_which_pixels() -> None:
    disparity = np.full((5, 130), FAR, np.float32)
    disparity[2, 70] = NEAR
    marks, found = marked(disparity)
    expected = np.zeros_like(marks)
    expected[2, 70] = RIGHT | DOWN
    expected[2, 69], expected[1, 70] = RIGHT, DOWN
    assert np.array_equal(marks, expected)
    assert np.array_equal(found > 0, [[0, 0, 0], [0, 1, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2), (3, 5)])
def test_small_pictures(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    near = rng.random(shape) < 0.5
    luma, _ = blended(near)
    assert luma.shape == shape
    assert luma.min() >= DARK - 1
    assert luma.max() <= BRIGHT + 1


@pytest.mark.parametrize("shape", [(24, 31), (1, 40), (40, 1), (7, 130)])
def test_a_picture_is_smoothed_as_its_planes_are_and_kept_where_there_is_no_outline(shape: tuple[int, int]) -> None:
    h, w = shape
    near = half_plane(h, w, 0.3141, 0.4 * h, 1) > 0.5
    disparity = np.where(near, np.float32(NEAR), np.float32(FAR))
    luma = np.where(near, BRIGHT, DARK).astype(np.uint16)
    chroma = np.ascontiguousarray(luma[::2, ::2])
    before = Texture(luma, chroma, chroma + np.uint16(1))
    kept = [plane.copy() for plane in (before.y, before.cb, before.cr)]
    after = smooth_outlines(before, disparity, 0.1)
    expected_luma, expected_chroma = blended(near)
    np.testing.assert_array_equal(after.y, expected_luma)
    np.testing.assert_array_equal(after.cb, expected_chroma)
    np.testing.assert_array_equal(after.cr, expected_chroma + np.uint16(1))
    assert min(h, w) == 1 or (after.y != luma).any()
    for plane, copy in zip((before.y, before.cb, before.cr), kept, strict=True):
        np.testing.assert_array_equal(plane, copy)
    assert smooth_outlines(before, disparity, NEAR - FAR + 0.01) is before
