"""Colour maps against the formulas of BT.709."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.rig import texture as colour
from farside.engine.rig.frame import Texture


def reference_rgb(texture: Texture) -> np.ndarray:
    """R'G'B' by the formulas of BT.709, in floating point, unclipped: the oracle."""
    h, w = texture.y.shape
    chroma = [np.repeat(np.repeat(p, 2, 0), 2, 1)[:h, :w].astype(float) for p in (texture.cb, texture.cr)]
    y, cb, cr = (texture.y - 64.0) / 876, (chroma[0] - 512) / 896, (chroma[1] - 512) / 896
    r, b = y + 1.5748 * cr, y + 1.8556 * cb
    return 255 * np.stack([r, (y - 0.2126 * r - 0.0722 * b) / 0.7152, b], axis=-1)


def random_texture(h: int, w: int, seed: int = 0) -> Texture:
    rng = np.random.default_rng(seed)
    chroma = (h + 1) // 2, (w + 1) // 2
    return Texture(
        rng.integers(0, 1024, (h, w), np.uint16),
        *(rng.integers(0, 1024, chroma, np.uint16) for _ in range(2)),
    )


@pytest.mark.parametrize(("h", "w"), [(6, 8), (7, 9), (1, 1), (2, 31)])
def test_rgb_is_bt709(h: int, w: int) -> None:
    texture = random_texture(h, w)
    expected = np.clip(reference_rgb(texture), 0, 255)
    assert np.abs(colour.to_rgb(texture) - expected).max() <= 0.51


def test_black_white_and_primaries() -> None:
    rgb = np.array([[0, 0, 0], [255, 255, 255], [255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8)
    for value in rgb:
        picture = np.broadcast_to(value, (4, 6, 3)).copy()
        texture = colour.from_rgb(picture)
        assert np.abs(colour.to_rgb(texture).astype(int) - picture).max() <= 1
    assert colour.from_rgb(np.zeros((2, 2, 3), np.uint8)).y[0, 0] == 64
    white = colour.from_rgb(np.full((2, 2, 3), 255, np.uint8))
    assert (white.y[0, 0], white.cb[0, 0], white.cr[0, 0]) == (940, 512, 512)
