"""A model that is restored from its state continues bit for bit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.model import BackgroundModel
from farside.engine.background.state import VERSION, ModelState
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.rig.camera import Equirectangular, Pose
from farside.engine.rig.frame import Fault, Frame
from farside.engine.settings import Settings
from support.leaves import leaves
from support.rooms import CODING, camera_row, frame

FRAMES, HALF_WAY = 24, 11
PATH = np.interp(np.arange(FRAMES), [0, 6, 13, 20], [-0.4, 0.0, 0.0, 0.7])
CASES = {
    "by triangle": Settings(n_init=1),
    "by pixel": Settings(n_init=1, n_update=2, culling_stride=2),
    "every other frame": Settings(n_init=1, update_interval=2),
    "paper": Settings.preset("paper", n_init=1),
    "stale foreground": Settings(n_init=1, cull_stale=True),
    "middle layers": Settings(n_init=1, cull_stale=True, middle_layers=40, late_rounds=0),
    "late layers": Settings(n_init=1, cull_stale=True, middle_layers=4000),
    "viewing space": Settings(n_init=1, viewing_space=(0.0, 0.0, 0.0, 0.5)),
}


def walk(noise, moves=None):
    """Frames in which someone walks, stands a while and walks on, with noisy depth or without; from frame `moves` on a
    camera moves."""
    cameras, rng = camera_row(), np.random.default_rng(0)
    for index in range(FRAMES):
        if moves is not None and index >= moves:
            cameras[0] = dataclasses.replace(cameras[0], pose=Pose((0.0, -0.4 - 0.01 * index, 0.0)))
        views = []
        for view in frame(index, cameras, box_y=PATH[index]).views:
            depth = CODING.depth(view.codes) * (1 + noise * rng.standard_normal(view.codes.shape))
            views.append(dataclasses.replace(view, codes=CODING.codes(depth)))
        yield Frame(index, tuple(views))


def everything(model, seen):
    """All that can be seen of a model, and what it keeps for itself, by name."""
    scene, settings = model.state().scene.scene(), model.settings
    present = ViewTable([PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in seen.views])
    found = {}
    for name, projection in (("eye", None), ("sphere", Equirectangular(60, 40, (-0.5, 0.5), (-0.3, 0.3)))):
        camera = dataclasses.replace(camera_row()[1], pose=Pose((-0.2, 0.1, 0.05)))
        camera = camera if projection is None else dataclasses.replace(camera, projection=projection)
        for kind, table in (("farthest", None), ("standing", present)):
            image = model.render_pbi(camera, table, near=0.1)
            texture = image.view.texture
            planes = image.view.codes, texture.y, texture.cb, texture.cr
            found |= {f"{name} {kind} {plane}": values for plane, values in enumerate(planes)}
            found[f"{name} {kind} rays"] = image.rays
    mesh = model.mesh()
    found |= {"vertices": mesh.vertices, "triangles": mesh.triangles, "colours": mesh.colours}
    return found | dict(leaves(model.state()))


def assert_same(found, expected):
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_array_equal(found[name], value, err_msg=name)
        assert getattr(found[name], "dtype", None) == getattr(value, "dtype", None), name


def without_times(report):
    return dataclasses.replace(report, stages={})


@pytest.mark.parametrize("noise", [0.0, 0.004])
@pytest.mark.parametrize("case", CASES)
def test_a_model_put_back_half_way_continues_bit_for_bit(case, noise):
    frames = list(walk(noise, moves=18 if case == "by triangle" else None))
    settings = CASES[case]
    cameras = [view.camera for view in frames[0].views]
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0]))
    for one in frames[:HALF_WAY]:
        model.update(one)
    before = everything(model, frames[HALF_WAY - 1])
    other = BackgroundModel.from_state(model.state())
    assert_same(everything(other, frames[HALF_WAY - 1]), before)
    accepted = culled = late = 0
    for one in frames[HALF_WAY:]:
        report = model.update(one)
        assert without_times(other.update(one)) == without_times(report)
        accepted, culled = accepted + report.accepted, culled + report.culled
        late += sum(remains.late for remains in model.state().remains)
    assert (late > 0) == (case == "late layers")
    assert_same(everything(other, frames[-1]), everything(model, frames[-1]))
    assert accepted > 0
    assert culled > 0
    assert (model.tolerances.noise > 0) == (noise > 0 and settings.refine)


def test_a_second_capture_is_put_back_as_well():
    frames = list(walk(0.0))
    cameras = [view.camera for view in frames[0].views]
    settings = CASES["by triangle"]
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0]))
    for one in frames[:5]:
        model.update(one)
    elsewhere = dataclasses.replace(cameras[0], pose=Pose((0.0, -0.35, 0.0)))
    moved = [frame(index, [elsewhere, *cameras[1:]], box_y=PATH[index]) for index in range(FRAMES)]
    model.recapture(0, moved[5].views[0], np.array(IDENTITY))
    other = BackgroundModel.from_state(model.state())
    assert [capture.pose for capture in other.captures] == [capture.pose for capture in model.captures]
    for one in moved[5:]:
        assert without_times(other.update(one)) == without_times(model.update(one))
    assert_same(everything(other, moved[-1]), everything(model, moved[-1]))


def test_a_camera_that_was_left_out_so_far_is_put_back_as_well():
    """It begins after that, in both."""
    fault, frames = Fault("missing"), list(walk(0.0))
    for index in range(HALF_WAY + 3):
        views = frames[index].views
        frames[index] = dataclasses.replace(
            frames[index], views=(dataclasses.replace(views[0], fault=fault), *views[1:])
        )
    cameras = [view.camera for view in frames[0].views]
    settings = CASES["by triangle"]
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0]))
    for one in frames[:HALF_WAY]:
        model.update(one)
    other = BackgroundModel.from_state(model.state())
    for one in frames[HALF_WAY:]:
        assert without_times(other.update(one)) == without_times(model.update(one))
    assert len(model.captures) == len(cameras)
    assert_same(everything(other, frames[-1]), everything(model, frames[-1]))


def test_a_state_holds_only_arrays_and_scalars_and_owns_them():
    frames = list(walk(0.0))
    cameras = [view.camera for view in frames[0].views]
    settings = CASES["by triangle"]
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0]))
    for one in frames[:8]:
        model.update(one)
    state = model.state()
    kinds = {type(value) for _name, value in leaves(state)}
    assert kinds <= {np.ndarray, int, float, str, bool, type(None)}
    kept = {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in leaves(state)}
    other = BackgroundModel.from_state(state)
    for one in frames[8:]:
        model.update(one)
        other.update(one)
    assert_same(dict(leaves(state)), kept)


@pytest.mark.parametrize("version", [0, VERSION + 1])
def test_a_state_of_another_version_is_refused(version):
    cameras = camera_row()
    settings, first = CASES["by triangle"], frame(0, cameras, box_y=0.0)
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    model.update(first)
    state = dataclasses.replace(model.state(), version=version)
    assert isinstance(state, ModelState)
    with pytest.raises(ValueError, match=f"model state: version {version}: expected {VERSION}"):
        BackgroundModel.from_state(state)


def test_what_is_left_of_older_captures_is_put_back_as_well():
    cameras, settings = camera_row(), Settings(n_init=1, n_update=2)
    walks = [dataclasses.replace(cameras[0], pose=Pose((0.0, -0.4 - 0.1 * index, 0.0))) for index in range(FRAMES)]
    frames = [frame(index, [walks[index], *cameras[1:]], box_y=PATH[index]) for index in range(FRAMES)]
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0]))
    for one in frames[:HALF_WAY]:
        model.update(one)
    state = model.state()
    assert state.remains
    assert state.moving == (0,)
    other = BackgroundModel.from_state(state)
    assert_same(everything(other, frames[HALF_WAY - 1]), everything(model, frames[HALF_WAY - 1]))
    added = 0
    for one in frames[HALF_WAY:]:
        report = model.update(one)
        assert without_times(other.update(one)) == without_times(report)
        added += report.added
    assert added > 0
    assert_same(everything(other, frames[-1]), everything(model, frames[-1]))
