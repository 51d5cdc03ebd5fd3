"""A model in a file: it continues bit for bit, and what does not fit together is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.model import BackgroundModel
from farside.engine.background.saved_model import SavedModel
from farside.engine.geometry.scene_scale import Scene
from farside.engine.io.saved_file import read_about
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Perspective, Pose
from farside.engine.rig.frame import Fault
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from support.leaves import leaves
from support.rooms import camera_row, frame

FRAMES, HALF_WAY = 12, 6
SETTINGS = Settings(n_init=1)
HEAD = StereoView.symmetric(Pose((-0.3, 0.1, 0.0)), 48, 40, 1.0, 0.1)


def frames():
    """Someone walks; exposures differ."""
    cameras = camera_row()
    for index in range(FRAMES):
        one = frame(index, cameras, box_y=-0.5 + 0.1 * index)
        yield dataclasses.replace(one, views=tuple(brighter(view, 9 * k) for k, view in enumerate(one.views)))


def brighter(view, codes):
    """A view whose luma is higher."""
    return dataclasses.replace(view, texture=dataclasses.replace(view.texture, y=view.texture.y + np.uint16(codes)))


def engine_after(count, settings=SETTINGS):
    engine = Engine(camera_row(), settings)
    for one in list(frames())[:count]:
        engine.update(one, {"me": HEAD})
    return engine


def pictures(engine, viewer="me"):
    pair = engine.render(HEAD, viewer)
    planes = [(p.texture.y, p.texture.cb, p.texture.cr, p.disparity) for p in (pair.left, pair.right)]
    return [plane for eye in planes for plane in eye]


def assert_same(found, expected):
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "room.farside"
    engine = engine_after(HALF_WAY)
    size = engine.state().write(path)
    assert size == path.stat().st_size
    return path


def test_an_engine_continues_from_the_file_bit_for_bit(saved):
    first = engine_after(HALF_WAY)
    other = Engine(camera_row(), SETTINGS, saved=SavedModel.read(saved))
    assert other.export() == first.export()
    assert other.export("ply") == first.export("ply")
    for one in list(frames())[HALF_WAY:]:
        report, expected = (engine.update(one, {"me": HEAD}) for engine in (other, first))
        assert dataclasses.replace(report.background, stages={}) == dataclasses.replace(expected.background, stages={})
        assert_same(pictures(other), pictures(first))
        np.testing.assert_array_equal(other.tones, first.tones)
    assert np.ptp(first.tones[:, 0, 3]) > 5.0  # the exposures were followed
    for engine in (first, other):
        engine.close()


def test_a_picture_before_the_model_is_updated_is_the_one_before(saved):
    first = engine_after(HALF_WAY)
    other = Engine(camera_row(), SETTINGS, saved=SavedModel.read(saved), modelling=False)
    newest = list(frames())[HALF_WAY - 1]
    assert other.update(newest, {"me": HEAD}).background is None
    np.testing.assert_array_equal(other.tones, first.tones)
    assert_same(pictures(other), pictures(first))
    for engine in (first, other):
        engine.close()


def test_only_how_the_filling_of_a_viewers_holes_has_settled_is_not_continued(saved):
    """A viewer who comes back has another name, under which nothing has settled, whether there was a stop or not."""
    first = engine_after(HALF_WAY)
    pictures(first)
    other = Engine(camera_row(), SETTINGS, saved=SavedModel.read(saved))
    one = list(frames())[HALF_WAY]
    one = dataclasses.replace(one, views=tuple(brighter(view, 40) for view in one.views))
    for engine in (first, other):
        engine.update(one, {"me": HEAD, "again": HEAD})
    assert_same(pictures(other, "again"), pictures(first, "again"))
    settled, anew = (engine.render(HEAD, "me").left for engine in (first, other))
    differs = settled.texture.y != anew.texture.y
    assert differs.any()
    assert not differs[~anew.holes()].any()
    for engine in (first, other):
        engine.close()


WALK = Settings(n_init=1, n_render=2, draw_moving=False)  # what moves is not drawn, so what has moved matters
MISSING = Fault("missing")


def walk(moves=True, unseen=range(0), gone=range(0)):
    """Someone walks; the first camera moves in every frame. The last one is left out of the frames `unseen`, the first
    one of those `gone`."""
    for index, one in enumerate(frames()):
        views = list(one.views)
        if moves:
            place = dataclasses.replace(views[0].camera, pose=Pose((0.0, -0.4 - 0.08 * index, 0.0)))
            views[0] = frame(index, [place], box_y=-0.5 + 0.1 * index).views[0]
        for c, left_out in ((2, unseen), (0, gone)):
            if index in left_out:
                views[c] = dataclasses.replace(views[c], fault=MISSING)
        yield dataclasses.replace(one, views=tuple(views))


def continued(some, path):
    """An engine that takes all frames, and the states halfway and at the end; another one continues from a file, and
    shows and keeps the same after each frame."""
    cameras = camera_row()
    first = Engine(cameras, WALK)
    for one in some[:HALF_WAY]:
        first.update(one, {"me": HEAD})
    halfway = first.state()
    halfway.write(path)
    other = Engine(cameras, WALK, saved=SavedModel.read(path))
    assert dict(leaves(other.state())).keys() == dict(leaves(halfway)).keys()
    for one in some[HALF_WAY:]:
        report, expected = (engine.update(one, {"me": HEAD}) for engine in (other, first))
        assert dataclasses.replace(report.background, stages={}) == dataclasses.replace(expected.background, stages={})
        assert_same(pictures(other), pictures(first))
        np.testing.assert_array_equal(other.tones, first.tones)
    end, found = first.state(), dict(leaves(other.state()))
    for name, value in leaves(end):
        np.testing.assert_array_equal(found[name], value, err_msg=name)
    assert other.export() == first.export()
    for engine in (first, other):
        engine.close()
    return halfway, end


def test_a_rig_with_a_moving_camera_continues_bit_for_bit(tmp_path):
    halfway, end = continued(list(walk()), tmp_path / "room.farside")
    assert halfway.model.remains
    assert halfway.model.moving == halfway.moving == (0,)
    assert len(end.model.captures) == 4  # the moving camera's first one has a part of the S-PBS
    assert read_about(tmp_path / "room.farside").pictures == 4 + len(halfway.model.remains)


def test_a_moving_camera_that_is_left_out_then_is_where_it_was_seen_last(tmp_path):
    gone = range(HALF_WAY, HALF_WAY + 3)
    halfway, _ = continued(list(walk(gone=gone)), tmp_path / "room.farside")
    assert halfway.placed[0].position == (0.0, -0.4 - 0.08 * (HALF_WAY - 1), 0.0)
    assert halfway.rig[0].position == (0.0, -0.4, 0.0)


@pytest.mark.parametrize("moves", [False, True])
def test_a_rig_with_an_unseen_camera_continues_bit_for_bit(tmp_path, moves):
    some = list(walk(moves, unseen=range(HALF_WAY + 2)))
    halfway, end = continued(some, tmp_path / "room.farside")
    assert halfway.model.unseen == (2,)
    assert halfway.model.captures[2].codes.max() == 0
    assert end.model.unseen == ()
    (capture,) = [c for c in end.model.captures if c.index == 2]
    assert capture.codes.max() > 0


def test_a_moving_camera_may_be_announced_elsewhere_and_others_may_not(tmp_path):
    continued(list(walk()), path := tmp_path / "room.farside")
    saved = SavedModel.read(path)
    elsewhere = [dataclasses.replace(c, pose=c.pose.translated((0.3, 0.0, 0.0))) for c in camera_row()]
    Engine([elsewhere[0], *camera_row()[1:]], WALK, saved=saved).close()
    with pytest.raises(ValueError, match=r"camera v1: position: .*: expected \(0.3, 0.0, 0.0\), as the source has it"):
        Engine([camera_row()[0], elsewhere[1], camera_row()[2]], WALK, saved=saved)


def test_a_first_frame_of_nothing_leaves_no_trace_in_a_model_that_is_continued(saved):
    engine = Engine(camera_row(), SETTINGS, saved=SavedModel.read(saved))
    before = dict(leaves(engine.state()))
    nothing = dataclasses.replace(
        one := list(frames())[HALF_WAY], views=tuple(dataclasses.replace(view, fault=MISSING) for view in one.views)
    )
    engine.update(nothing, {"me": HEAD})
    assert np.ptp(pictures(engine)[0]) == 0  # a picture, of nothing
    after = dict(leaves(engine.state()))
    assert after.keys() == before.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value, err_msg=name)
    engine.update(one, {"me": HEAD})
    assert np.ptp(pictures(engine)[0]) > 0
    engine.close()


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "walk.farside"
    engine = Engine(camera_row(), WALK)
    for one in list(walk())[:HALF_WAY]:
        engine.update(one)
    engine.state().write(path)
    engine.close()
    return path


def remains_with(model, **changes):
    return {"remains": (dataclasses.replace(model.remains[0], **changes), *model.remains[1:])}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: remains_with(m, cb=m.remains[0].cb[1:]), r"remains\[0\].cb: shape"),
        (lambda m: remains_with(m, codes=m.remains[0].codes[:, 1:]), r"remains\[0\].codes: shape"),
        (lambda m: remains_with(m, index=3), r"remains\[0\].index: 3: expected 0 to 2"),
        (lambda m: remains_with(m, index=1), "camera: 0: expected 1, as its capture has it"),
        (lambda m: remains_with(m, edge=-1), r"remains\[0\].edge: -1"),
        (lambda m: remains_with(m, reach=0), r"remains\[0\].reach: 0"),
        (lambda m: remains_with(m, capture=m.current[0]), "captures: .* of different numbers"),
        (lambda m: remains_with(m, capture=1 << 40), "captures: .*: expected numbers from 0 to 65535"),
        (
            lambda m: {"surfaces": tuple(s for s in m.surfaces if s.capture != m.remains[0].capture)},
            r"remains\[0\]: .*: expected the number of a surface's capture",
        ),
        (
            lambda m: {"surfaces": tuple(dataclasses.replace(s, static=True) for s in m.surfaces)},
            "static: True: expected false, as its capture is older",
        ),
        (lambda m: {"moving": (3,)}, r"moving: \(3,\): expected numbers from 0 to 2"),
        (lambda m: {"unseen": (-1,)}, r"unseen: \(-1,\): expected numbers from 0 to 2"),
        (lambda m: {"looks": (0, 0)}, "looks: 2: expected one for each of 3 cameras"),
        (lambda m: {"looks": (0, 0, -1)}, r"looks: \(0, 0, -1\): expected 0 or more"),
    ],
)
def test_a_file_whose_older_captures_do_not_fit_is_refused(walked, tmp_path, change, message):
    path = changed(walked, tmp_path / "odd.farside", **change(SavedModel.read(walked).model))
    with pytest.raises(ValueError, match=f"^{path}: .*{message}"):
        SavedModel.read(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: {"placed": s.placed[1:]}, "placed: 2: expected one for each of 3 cameras"),
        (lambda s: {"placed": s.placed[::-1]}, r"placed\[0\]: .*: expected .*, in any pose"),
        (lambda s: {"moving": (0, 3)}, r"moving: \(0, 3\): expected numbers from 0 to 2"),
    ],
)
def test_a_file_whose_cameras_are_nowhere_is_refused(walked, tmp_path, change, message):
    read = SavedModel.read(walked)
    path = tmp_path / "odd.farside"
    dataclasses.replace(read, **change(read)).write(path)
    with pytest.raises(ValueError, match=f"^{path}: .*{message}"):
        SavedModel.read(path)


def test_what_is_written_twice_is_the_same(saved, tmp_path):
    again = tmp_path / "again.farside"
    SavedModel.read(saved).write(again)
    found, expected = read_about(again), read_about(saved)
    assert dataclasses.replace(found, saved=expected.saved) == expected
    assert expected.cameras == tuple((f"v{k}", 96, 64) for k in range(3))
    assert expected.frame == HALF_WAY - 1
    assert expected.s_pbs_valid > 0
    assert expected.seeded == 0
    one, other = SavedModel.read(again), SavedModel.read(saved)
    assert len(one.model.surfaces) == len(other.model.surfaces)
    for a, b in zip(one.model.surfaces, other.model.surfaces, strict=True):
        np.testing.assert_array_equal(a.points, b.points)


def test_another_rig_is_refused(saved):
    for change, message in (
        (lambda cs: cs[:2], "cameras: v0, v1, v2: expected those of the source, v0, v1"),
        (
            lambda cs: [*cs[:2], dataclasses.replace(cs[2], pose=Pose((0.0, 0.5, 0.0)))],
            r"camera v2: position: .*0.4.*: expected \(0.0, 0.5, 0.0\), as the source has it",
        ),
        (
            lambda cs: [dataclasses.replace(cs[0], projection=Perspective.from_fov(96, 64, 1.1)), *cs[1:]],
            "camera v0: lens: .*: expected .*, as the source has it",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            Engine(change(camera_row()), SETTINGS, saved=SavedModel.read(saved))


def test_settings_that_matter_must_be_the_same_and_others_may_change(saved):
    with pytest.raises(ValueError, match=r"setting tolerance_px: 0.25: expected 0.5, as it is set now"):
        Engine(camera_row(), dataclasses.replace(SETTINGS, tolerance_px=0.5), saved=SavedModel.read(saved))
    engine = Engine(camera_row(), Settings(n_init=3, jpeg_quality=50, blend=1), saved=SavedModel.read(saved))
    engine.update(list(frames())[HALF_WAY], {"me": HEAD})
    assert engine.model.settings.blend == 1
    engine.close()


def test_an_older_file_lacks_newer_settings_and_goes_on_with_those_of_now(saved, tmp_path):
    kept = tuple(pair for pair in SavedModel.read(saved).model.settings if pair[0] != "cull_stale")
    older = changed(saved, tmp_path / "older.farside", settings=kept)
    for stale in (False, True):
        settings = dataclasses.replace(SETTINGS, cull_stale=stale)
        engine = Engine(camera_row(), settings, saved=SavedModel.read(older))
        engine.update(list(frames())[HALF_WAY], {"me": HEAD})
        assert engine.model.settings.cull_stale == stale
        engine.close()


def test_an_engine_without_a_model_has_nothing_to_save():
    engine = Engine(camera_row(), Settings(background=False))
    engine.update(next(frames()))
    assert engine.state() is None
    engine.close()


def changed(saved, path, **changes):
    """The file with other fields of its model."""
    read = SavedModel.read(saved)
    dataclasses.replace(read, model=dataclasses.replace(read.model, **changes)).write(path)
    return path


def surface_with(model, k=0, **changes):
    return (*model.surfaces[:k], dataclasses.replace(model.surfaces[k], **changes), *model.surfaces[k + 1 :])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: {"surfaces": surface_with(m, triangles=m.surfaces[0].triangles + 10**6)}, r"\[0\].triangles"),
        (lambda m: {"surfaces": surface_with(m, triangles=m.surfaces[0].triangles - 1)}, r"\[0\].triangles: -1"),
        (lambda m: {"surfaces": surface_with(m, points=m.surfaces[0].points * np.float32(np.nan))}, "points: a number"),
        (lambda m: {"surfaces": surface_with(m, uv=m.surfaces[0].uv + np.float32(1e9))}, r"surfaces\[0\].uv"),
        (lambda m: {"surfaces": surface_with(m, invalid=m.surfaces[0].invalid[1:])}, r"surfaces\[0\].invalid: shape"),
        (lambda m: {"surfaces": surface_with(m, marks=m.surfaces[0].marks[:, :0])}, r"surfaces\[0\].marks: shape"),
        (lambda m: {"surfaces": surface_with(m, capture=3)}, r"surfaces\[0\].capture: 3: expected the number"),
        (lambda m: {"surfaces": surface_with(m, camera=(m.surfaces[0].camera + 1) % 3)}, r"surfaces\[0\].camera"),
        (lambda m: {"surfaces": (*m.surfaces, m.surfaces[0])}, "surfaces: .* of different captures"),
        (lambda m: {"captures": m.captures[1:]}, "captures: 2: expected at least 3"),
        (
            lambda m: {"captures": (dataclasses.replace(m.captures[0], y=m.captures[0].y[1:]), *m.captures[1:])},
            r"captures\[0\].y: shape \(63, 96\): expected \(64, 96\)",
        ),
        (lambda m: {"current": (0, 1, 1)}, r"current\[2\]: 1: expected a capture of camera 2"),
        (lambda m: {"current": (0, 1)}, "current: 2: expected one for each of 3 cameras"),
        (lambda m: {"next": 3}, "next: 3: expected 0 to 2"),
        (lambda m: {"changed": m.changed[:, 1:]}, "changed: shape"),
        (lambda m: {"settings": (*m.settings, ("speed", 1))}, "speed"),
        (lambda m: {"settings": (("blend", 0),)}, "blend: 0: expected at least 1"),
        (lambda m: {"tolerances": m.tolerances[1:]}, "tolerances: .*: expected the fields of Tolerances"),
        (lambda m: {"version": 99}, "model state: version 99: expected"),
        (
            lambda m: {"cameras": (dataclasses.replace(m.cameras[0], projection="os.system"), *m.cameras[1:])},
            r"cameras\[0\]: projection: 'os.system': expected one of",
        ),
    ],
)
def test_a_file_whose_parts_do_not_fit_is_refused(saved, tmp_path, change, message):
    path = changed(saved, tmp_path / "odd.farside", **change(SavedModel.read(saved).model))
    with pytest.raises(ValueError, match=f"^{path}: .*{message}"):
        SavedModel.read(path)


def test_a_model_that_was_read_renders_what_the_one_before_renders(saved):
    cameras, first = camera_row(), next(frames())
    model = BackgroundModel(cameras, SETTINGS, Scene.of(cameras, SETTINGS, first))
    model.update(first)
    saved_now = SavedModel.of(cameras, 0, model, None)
    other = BackgroundModel.from_state(saved_now.model)
    assert other.counts() == model.counts()
