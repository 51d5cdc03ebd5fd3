"""Double buffering: rendering reads the front buffer and nothing else, and the swap loses no setting."""

from __future__ import annotations

import dataclasses
import gc
import sys
import types
import weakref

import numpy as np
import pytest
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from support.rooms import camera_row, frame

HEAD = StereoView.symmetric(Pose((0.0, 0.9, 0.0)), 48, 40, 1.2, 0.2)
OTHERWISE = Settings(
    n_render=1, fill="none", settles=False, overdraw=False, rims=False, output_scale=0.5, blend=1, edge_px=99.0,
    tolerance_px=5.0, antialias="none", cubic=False, prefilter=False, backdrop_m=3.0, delta_m=2.0, jpeg_quality=1,
)  # fmt: skip


class Poison:
    """An object whose every use fails the test."""

    def _refuse(self, *asked):
        raise AssertionError(f"read from outside the front buffer: {asked}")

    __getattr__ = __call__ = __iter__ = __len__ = __getitem__ = __bool__ = __float__ = _refuse


def reachable(*roots):
    """Objects of ours and arrays that are reached from some, by id."""
    found, waiting = {}, list(roots)
    while waiting:
        one = waiting.pop()
        if type(one) in weakref.ProxyTypes:  # of whatever ran before: what it stood for may be gone
            continue
        if id(one) not in found and not isinstance(one, type | types.ModuleType | types.FunctionType | Poison):
            found[id(one)] = one
            waiting += gc.get_referents(one)
    return found


def poison(engine):
    """Break all of the back end, and all settings, that the front buffer does not hold."""
    back_end, buffers = engine._back_end, engine._buffers
    constants = [vars(module) for name, module in sys.modules.items() if name.startswith(("farside.", "numba."))]
    shown = reachable(engine.front, back_end._renderer, *constants)
    spoilt = 0
    for key, one in reachable(engine.model, back_end).items():
        if key not in shown and isinstance(one, np.ndarray) and one.flags.writeable:
            one.view(np.uint8)[...] = 0x55 if one.flags.c_contiguous else 0
            spoilt += 1
    assert spoilt > 10
    for owner in (engine.model, back_end):
        for name in vars(owner):
            setattr(owner, name, Poison())
    for name, value in vars(buffers).items():
        if isinstance(value, Settings):
            setattr(buffers, name, OTHERWISE)
    assert engine.settings == OTHERWISE


def planes(picture):
    texture = picture.texture
    return texture.y, texture.cb, texture.cr, picture.disparity, picture.winner


@pytest.mark.parametrize("quality", ["fast", "balanced", "best"])
def test_pictures_are_drawn_from_the_front_buffer_alone(quality):
    cameras = camera_row(2, spacing=0.2)
    engine = Engine(cameras, Settings.preset(quality, settles=False, n_update=2, baseline_m=1.0))
    for index, box in enumerate((0.0, 1.2, 0.0)):
        engine.update(frame(index, cameras, box), {"me": HEAD})

    def pictures():
        pair = engine.render(HEAD, "me")
        return pair.left, pair.right, engine.render_camera(cameras[0], "me")

    before = pictures()
    assert before[0].report.holes_warped > before[0].report.holes_backdrop  # the backdrop shows
    poison(engine)
    for one, other in zip(before, pictures(), strict=True):
        for was, now in zip(planes(one), planes(other), strict=True):
            np.testing.assert_array_equal(was, now)


def test_the_front_buffer_stays_as_it_is_while_the_next_frame_is_taken():
    cameras = camera_row()
    engine = Engine(cameras, Settings.preset("balanced", settles=False))
    engine.update(frame(0, cameras, 0.0), {"me": HEAD})
    before, pictures = engine.render(HEAD, "me"), []

    def look():
        pictures.append(engine.render(HEAD, "me"))
        return {"me": HEAD}

    engine.update(frame(1, cameras, 0.5), look)
    assert [pair.frame_index for pair in pictures] == [0, 0]
    for pair in pictures:
        np.testing.assert_array_equal(pair.left.texture.y, before.left.texture.y)
    assert engine.render(HEAD, "me").frame_index == 1


def test_settings_that_change_during_an_update_are_not_lost_by_the_swap():
    cameras = camera_row()
    engine = Engine(cameras, Settings.preset("balanced"))

    def look():
        engine.retune(dataclasses.replace(engine.settings, output_scale=0.5))
        return {"me": HEAD}

    engine.update(frame(0, cameras, 0.0), look)
    assert engine.front.settings is engine.settings
    assert engine.render(HEAD, "me").left.camera.width == HEAD.left.width // 2
