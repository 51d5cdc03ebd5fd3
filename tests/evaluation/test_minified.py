"""`farside bench minified`: its figures are those of the pictures, computed again, and grow apart as they must."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re

import numpy as np
import pytest
from farside.clients.cli import app
from farside.engine.evaluation import minified
from farside.engine.evaluation.minified import RATIOS, halving_cost, measure_minified
from farside.engine.geometry.minification import level_for
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Camera, Perspective
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, render_view, twin_frame
from support.clocks import Clock
from typer.testing import CliRunner

SCALE, QUALITY, VIEWS = 0.05, "fast", 3
FOV = math.radians(75)


@pytest.fixture(scope="module")
def rows():
    return {row.ratio: row for row in measure_minified("museum", SCALE, QUALITY, VIEWS)}


def test_pictures_are_as_much_coarser_as_is_said(rows):
    assert tuple(rows) == RATIOS
    lens = make_twin("museum", SCALE).sources[0].projection
    a_radian = min(lens.width / np.ptp(lens.hor_range), lens.height / np.ptp(lens.ver_range))
    for ratio, row in rows.items():
        # Pixels a radian in the middle of a picture, which is an even number of pixels wide.
        assert row.width / (2 * math.tan(FOV / 2)) == pytest.approx(a_radian / ratio, abs=1 / (2 * math.tan(FOV / 2)))


def test_what_is_hardly_coarser_is_not_prefiltered_and_all_else_gains_by_it(rows):
    for ratio, row in rows.items():
        if level_for(ratio) == 0:
            assert row.on == row.off
        elif ratio >= 2:
            assert all(on > off for on, off in zip(row.on, row.off, strict=True)), row
    assert {level_for(ratio) for ratio in rows} == {0, 1, 2}
    for before, after in itertools.pairwise(RATIOS):
        assert rows[after].off < rows[before].off  # the coarser, the more of it aliases


@pytest.mark.parametrize("prefilter", [False, True])
def test_psnr_is_that_of_the_eyes_picture(rows, prefilter):
    """Of an eye in the middle of the first views, by the definition of PSNR, at a ratio of 3."""
    twin = make_twin("museum", SCALE)
    names = twin.source_names[:VIEWS]
    cameras = [twin.camera(name) for name in names]
    middle = np.mean([camera.pose.position for camera in cameras], axis=0)
    pose = dataclasses.replace(cameras[0].pose, position=tuple(middle.tolist()))
    eye = Camera("eye", Perspective.from_fov(rows[3.0].width, rows[3.0].width, FOV), pose, cameras[0].depth)
    engine = Engine(cameras, Settings.preset(QUALITY, background=False, prefilter=prefilter))
    engine.update(twin_frame(twin, 0, names))
    truth = render_view(twin.scene, eye, 0.0, samples=5).texture.y.astype(float)
    error = np.mean((engine.render_camera(eye).texture.y - truth) ** 2)
    found = rows[3.0].on if prefilter else rows[3.0].off
    assert found[0] == pytest.approx(10 * math.log10(1023**2 / error), abs=1e-6)


def test_halving_costs_the_least_time_for_each_megapixel(monkeypatch):
    """By a clock that halving moves on; the first time it compiles."""
    view = make_twin("museum", SCALE).view("v0", 0)
    clock, took, halved = Clock(), iter((90.0, 5.0, 3.0, 0.5, 9.0, 4.0)), minified.halved

    def timed(level, options):
        clock.advance(next(took))
        return halved(level, options)

    clock.instead_of(monkeypatch, minified)
    monkeypatch.setattr(minified, "halved", timed)
    assert halving_cost(view) == pytest.approx(500.0 / (1e-6 * view.codes.size))


def test_the_command_prints_a_row_a_ratio(rows):
    done = CliRunner().invoke(
        app, ["bench", "minified", "museum", "--scale", str(SCALE), "--quality", QUALITY, "--views", str(VIEWS)]
    )
    assert done.exit_code == 0, done.output
    assert f"museum at scale {SCALE}, quality {QUALITY}, {VIEWS} views" in done.output
    printed = [re.findall(r"[\d.]+", line) for line in done.output.splitlines() if line.startswith("│")]
    expected = []
    for ratio, row in rows.items():
        figures = (f"{psnr:.2f} {iv:.2f} {ssim:.4f}".split() for psnr, iv, ssim in (row.off, row.on))
        expected.append([f"{ratio:g}", str(row.width), *next(figures), *next(figures)])
    assert printed == expected
    assert re.search(r"halving a view costs \d+\.\d\d ms of CPU time", done.output)
