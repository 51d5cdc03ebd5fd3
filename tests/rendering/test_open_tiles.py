"""Surfaces that cannot win are not drawn: tiles that stay open, and pictures with and without this rule."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from farside.engine.evaluation.metrics import iv_psnr
from farside.engine.kernels.rendering.tiles import HOLE, SILHOUETTE, TILE, mark_open_tiles
from farside.engine.pipeline.engine import Engine
from farside.engine.rendering.rasteriser import Rasteriser
from farside.engine.rendering.tiles import EVERYWHERE
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame


def open_tiles(disparity, step):
    """The definition, one pixel after the other."""
    h, w = disparity.shape
    tiles = np.zeros((-(-h // TILE), -(-w // TILE)), np.uint8)
    for y in range(h):
        for x in range(w):
            q = disparity[y, x]
            above, below = disparity[max(y - 1, 0), x], disparity[min(y + 1, h - 1), x]
            bends = abs(above - q - q + below) > step
            if 0 < x < w - 1:
                bends |= abs(disparity[y, x - 1] - q - q + disparity[y, x + 1]) > step
            tiles[y // TILE, x // TILE] |= (SILHOUETTE if bends else 0) | (HOLE if q <= 0 else 0)
    return tiles


@pytest.mark.parametrize("shape", [(3, 3), (24, 40), (37, 51)])
def test_open_tiles_have_a_hole_or_a_silhouette(shape):
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
    disparity = (0.5 + 0.01 * u + 0.004 * v).astype(np.float32)  # a slope is not a silhouette
    disparity[:, shape[1] * 2 // 3 :] += 0.3
    disparity[rng.random(shape) < 0.005] = 0.0
    tiles = np.full((-(-shape[0] // TILE), -(-shape[1] // TILE)), 7, np.uint8)
    mark_open_tiles(disparity, 0.1, tiles)
    assert np.array_equal(tiles, open_tiles(disparity, np.float32(0.1)))


@pytest.mark.parametrize("name", ["museum", "hijack", "doorway"])
def test_pictures_are_as_good_as_from_drawing_everything(name, monkeypatch):
    twin = make_twin(name, 0.12)
    frame = twin_frame(twin, 0)
    camera = twin.camera("t0")

    def picture():
        engine = Engine(twin.sources, Settings.preset("balanced", background=False))
        engine.update(frame)
        return engine.render_camera(camera)

    sparing = picture()
    everywhere = Rasteriser.draw

    def draw(self, *given):
        bound = inspect.signature(everywhere).bind(self, *given)
        bound.arguments["open_tiles"] = EVERYWHERE
        return everywhere(*bound.args, **bound.kwargs)

    monkeypatch.setattr(Rasteriser, "draw", draw)
    full = picture()
    assert sparing.report.warped < 0.8 * full.report.warped
    assert np.array_equal(sparing.holes(), full.holes())
    # Surfaces that only a later view has between a small triangle's corners may be missed: quality does not suffer.
    truth = twin.truth(camera, 0).texture
    assert iv_psnr(truth, sparing.texture) > iv_psnr(truth, full.texture) - 0.02
