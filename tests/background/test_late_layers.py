"""What is put into a room stays in the model while it stands; people who walk, or stand and leave, do not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.capture import Remains
from farside.engine.background.late_layers import _beyond
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.model import BackgroundModel
from farside.engine.background.state_check import check_model
from farside.engine.background.tolerances import Tolerances
from farside.engine.geometry.prepared_view import PreparedView
from farside.engine.geometry.triangulation import TriangulationOptions
from farside.engine.kernels.background.late_layers import (
    PATIENCE,
    Before,
    Stood,
    clear_covered,
    note_standing,
    select_standing,
)
from farside.engine.kernels.background.surfaces import Triangles
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Fault, View
from farside.engine.settings import Settings
from oracle import late_layers as slow
from support.leaves import leaves
from support.moments import (
    CAMERAS,
    LAYERS,
    PERSON_X,
    PERSON_Y,
    TABLE_Y,
    look,
    moment,
    person,
    play,
    shown,
    triangles_at,
)
from support.rooms import BOX_X, WALL_X, WALL_Y, texture_of

ROUND = len(CAMERAS)
OLD, NEW = (BOX_X, -0.5, 0.25, TABLE_Y), (BOX_X, 0.6, 0.25, TABLE_Y)
CARRIED = [(OLD,)] * 10 + [(NEW,)] * 2 * ROUND
NEVER = dataclasses.replace(LAYERS, late_rounds=0)


def hidden_chair(view, *squares):
    """Pixels of a view, without the outermost ones, in which a person hides the chair at its new place."""
    chair = look(view.camera, NEW).texture.y == TABLE_Y
    return ((look(view.camera, *squares).texture.y == PERSON_Y) & chair)[1:-1, 1:-1]


def late(model):
    return [surface for surface in model._pbs.surfaces() if surface.late]


@pytest.mark.parametrize("settings", [LAYERS, NEVER], ids=["late", "never"])
@pytest.mark.parametrize("walks", [False, True])
def test_a_chair_is_there_where_someone_hides_it_one_round_after_it_was_carried(settings, walks):
    model = play(settings, CARRIED)
    path = np.linspace(1.3, 0.55, 9) if walks else [0.55]
    for index, y in enumerate(path, len(CARRIED)):
        model.update(moment(index, NEW, person(y)))
    now = moment(99, NEW, person(path[-1]))
    hidden = hidden_chair(now.views[2], NEW, person(path[-1]))
    depth, luma = shown(model, CAMERAS[2], now)
    assert hidden.sum() > 100
    if settings is LAYERS:
        there = np.isclose(depth[hidden], BOX_X, atol=0.02)
        assert there.mean() > 0.98
        assert (luma[hidden][there] == TABLE_Y).all()
    else:
        assert (np.abs(depth[hidden] - BOX_X) > 0.5).all()
    assert len(triangles_at(model, PERSON_X)) == 0  # nobody who walks becomes a layer


def test_one_round_is_enough_and_it_is_there_once():
    model = play(LAYERS, CARRIED[: 10 + ROUND])
    assert not late(model)  # each camera has seen it once
    model.update(moment(50, NEW))
    first = len(triangles_at(model, BOX_X))
    assert first > 100
    for index in range(51, 60):
        model.update(moment(index, NEW))
    assert len(triangles_at(model, BOX_X)) == first  # the other cameras see it there already


def test_a_chair_that_is_carried_away_again_is_gone_after_one_round():
    model = play(LAYERS, CARRIED)
    captures = len(model.captures)
    for index in range(50, 50 + ROUND):
        model.update(moment(index))
        for camera in CAMERAS:
            assert_only_the_wall(model, camera, moment(index))
    assert len(triangles_at(model, BOX_X)) == 0
    assert not late(model)
    assert len(model.captures) == ROUND < captures  # its pictures are gone, too


def assert_only_the_wall(model, camera, now):
    depth, luma = shown(model, camera, now)
    np.testing.assert_allclose(depth, WALL_X - camera.pose.position[0], atol=0.02)
    assert (luma == WALL_Y).all()


@pytest.mark.parametrize("stays", [10, 300])
def test_who_came_and_stood_still_and_left_leaves_only_the_wall_after_one_round(stays):
    model = play(LAYERS, [()] * 10 + [(person(0.15),)] * stays)
    assert len(triangles_at(model, PERSON_X)) > 20
    for index in range(stays, stays + ROUND):
        model.update(moment(index))
        for camera in CAMERAS:
            assert_only_the_wall(model, camera, moment(index))
    assert len(triangles_at(model, PERSON_X)) == 0


def test_many_triangles_are_looked_at_over_some_rounds(monkeypatch):
    model = play(LAYERS, CARRIED)
    there = len(triangles_at(model, BOX_X))
    monkeypatch.setattr("farside.engine.background.late_layers._LOOKED_AT", there // 4)
    monkeypatch.setattr("farside.engine.background.stale._LOOKED_AT", 1)
    report = model.update(moment(50))
    assert there // 6 < report.culled <= there // 4 + 2
    for index in range(51, 50 + 5 * ROUND):
        model.update(moment(index))
        assert_only_the_wall(model, CAMERAS[1], moment(index))
    assert not late(model)


def test_who_moves_towards_the_cameras_never_becomes_a_layer():
    model = play(LAYERS, [()] * 10)
    for index in range(60):
        x = 2.2 - 0.01 * index
        model.update(moment(index, (x, 0.15, 0.2, PERSON_Y)))
        assert not late(model)


def test_a_camera_that_moves_takes_no_part():
    """Neither that of the chair's capture: what it added stays while it stands."""
    model = play(LAYERS, CARRIED[: 10 + ROUND + 1])
    (own,) = {surface.camera for surface in late(model)}
    before = len(triangles_at(model, BOX_X))
    for index in range(50, 50 + 2 * ROUND):
        views = list(moment(index, NEW).views)
        moved = dataclasses.replace(CAMERAS[own], pose=Pose((0.0, CAMERAS[own].pose.position[1] - 0.02 * index, 0.0)))
        model.update(dataclasses.replace(moment(index), views=(*views[:own], look(moved, NEW), *views[own + 1 :])))
    assert len(triangles_at(model, BOX_X)) >= before
    assert own not in {state.index for state in model.state().late}
    assert len(model.state().late) == ROUND - 1


def test_of_views_that_are_left_out_nothing_is_noted():
    model = play(LAYERS, CARRIED[:10])
    for index in range(10, 40):
        views = [dataclasses.replace(view, fault=Fault("missing")) for view in moment(index, NEW).views]
        model.update(dataclasses.replace(moment(index), views=tuple(views)))
    assert not late(model)


def test_late_layers_share_the_budget():
    everything = len(triangles_at(play(LAYERS, CARRIED), BOX_X))
    budget = everything // 3
    model = play(dataclasses.replace(LAYERS, middle_layers=budget), CARRIED)
    assert 10 < budget == sum(surface.valid_count for surface in late(model))


def test_without_middle_layers_nothing_is_noted():
    model = play(dataclasses.replace(LAYERS, middle_layers=0), CARRIED)
    assert not late(model)
    assert model.state().late == ()
    assert len(triangles_at(model, BOX_X)) == 0


def test_what_the_farthest_backdrop_never_shows_is_not_kept():
    assert not late(play(dataclasses.replace(LAYERS, backdrop="farthest"), CARRIED))


@pytest.mark.parametrize("rounds", [1, 2, 3])
def test_it_comes_after_as_many_rounds_as_are_set(rounds):
    model = play(dataclasses.replace(LAYERS, late_rounds=rounds), CARRIED[: 10 + rounds * ROUND])
    if rounds * ROUND <= 2 * ROUND:
        assert not late(model)
    for index in range(50, 50 + ROUND * max(rounds - 2, 0) + 1):
        model.update(moment(index, NEW))
    assert late(model)


@pytest.mark.parametrize(("n_update", "interval", "most"), [(5, 1, 5), (3, 1, 7), (2, 1, 7), (2, 3, 11)])
def test_where_rounds_are_short_it_stands_for_five_frames(n_update, interval, most):
    settings = dataclasses.replace(LAYERS, n_update=n_update, update_interval=interval)
    model = play(settings, [()] * 12)
    for index in range(30):
        model.update(moment(index, NEW))
        if late(model):
            break
    assert 5 <= index <= most


@pytest.mark.parametrize("rounds", [-1, 101])
def test_numbers_of_rounds_that_make_no_sense_are_refused(rounds):
    with pytest.raises(ValueError, match=f"late_rounds: {rounds}: expected 0 to 100"):
        Settings(late_rounds=rounds)


def test_a_model_put_back_at_any_time_continues_bit_for_bit():
    moments = [*CARRIED, *[(NEW, person(0.55))] * 3, *[()] * ROUND]
    for half_way in (12, 16, 18, 21):  # noted, added, added by more cameras, hidden
        model = play(LAYERS, moments[:half_way])
        other = BackgroundModel.from_state(model.state())
        for index, squares in enumerate(moments[half_way:], half_way):
            reports = [each.update(moment(index, *squares)) for each in (model, other)]
            one, same = (dataclasses.replace(report, stages={}) for report in reports)
            assert one == same
            found, expected = (dict(leaves(each.state())) for each in (other, model))
            assert found.keys() == expected.keys()
            for name, value in expected.items():
                np.testing.assert_array_equal(found[name], value, err_msg=name)
            one, same = (shown(each, CAMERAS[1], moment(index, *squares)) for each in (model, other))
            np.testing.assert_array_equal(one, same)


def noted(**changes):
    def change(state):
        return dataclasses.replace(state, late=(dataclasses.replace(state.late[1], **changes), *state.late[2:]))

    return change


def twice(name):
    def change(state):
        return dataclasses.replace(state, **{name: (*getattr(state, name), getattr(state, name)[-1])})

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (noted(index=9), r"late: \[9, .*: expected different numbers from 0 to 4"),
        (noted(index=-1), r"late: \[-1, .*: expected different numbers from 0 to 4"),
        (twice("late"), r"late: \[.*: expected different numbers from 0 to 4"),
        (noted(codes=np.zeros((32, 47), np.uint16)), r"late\[0\].codes: shape \(32, 47\): expected \(32, 48\)"),
        (noted(turns=np.zeros((31, 48), np.uint8)), r"late\[0\].turns: shape \(31, 48\): expected \(32, 48\)"),
        (noted(waiting=-1), r"late\[0\].waiting: -1: expected 0 or more"),
    ],
)
def test_a_state_that_does_not_fit_is_refused(change, message):
    state = play(LAYERS, CARRIED).state()
    check_model(state, state.cameras)
    with pytest.raises(ValueError, match=message):
        check_model(change(state), state.cameras)


def test_two_late_layers_of_one_camera_are_refused():
    state = play(LAYERS, CARRIED).state()
    (remains,) = state.remains
    more = dataclasses.replace(remains, capture=remains.capture + 1)
    surface = next(each for each in state.surfaces if each.capture == remains.capture)
    surfaces = (*state.surfaces, dataclasses.replace(surface, capture=more.capture))
    doubled = dataclasses.replace(state, remains=(remains, more), surfaces=surfaces)
    with pytest.raises(ValueError, match=r"remains: \[.*: expected different numbers from 0 to 4"):
        check_model(doubled, state.cameras)


def test_questions_know_when_it_was_seen():
    model = play(LAYERS, CARRIED)
    (remains,) = [capture for capture in model.captures if isinstance(capture, Remains)]
    _capture, stamps = model._sightings._known[remains.number]
    assert 10 + ROUND < stamps.max() <= len(CARRIED)


# Kernels

DELTA, MARGINS = (0.1, 0.01), (0.03, 0.002)
CODINGS = [DepthCoding(0.5, 20.0, 16, has_invalid=True), DepthCoding(0.5, np.inf, 10)]


def random_codes(rng, coding, shape):
    depth = np.kron(rng.uniform(1.0, 7.0, (6, 6)), np.ones((8, 8)))[: shape[0], : shape[1]]
    codes = coding.codes(depth)
    return np.where(rng.random(shape) < 0.05, 0 if coding.has_invalid else 900, codes).astype(np.uint16)


@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize("shape", [(20, 31), (33, 24)])
def test_what_stands_is_noted_and_selected_as_by_the_slow_twin(coding, shape):
    rng = np.random.default_rng(3)
    camera = Camera("v", Perspective.from_fov(shape[1], shape[0], 1.1), Pose(), coding)
    known, near = random_codes(rng, coding, shape), random_codes(rng, coding, shape)
    image = MaximumDepthImage(View(camera, texture_of(np.zeros(shape)), known), Tolerances(*MARGINS), 0.01)
    before = Before(image.rules, _beyond(coding, DELTA))
    margins = image.rules.margin_m, image.rules.margin_disparity
    half = tuple(-(-size // 2) for size in shape)
    stood = Stood(np.zeros(half, np.uint16), np.zeros(half, np.uint8))
    codes, turns = np.zeros((2, *half), int)
    counts = []
    for _turn in range(16):
        new = np.where(rng.random(shape) < 0.2, random_codes(rng, coding, shape), near)
        new = np.where(rng.random(shape) < 0.1, np.clip(new + rng.integers(-40, 40, shape), 1, coding.max_code), new)
        new = new.astype(np.uint16)
        counts.append(note_standing(new, known, before, 3, stood))
        assert counts[-1] == slow.note(coding, new, known, margins, DELTA, 3, codes, turns)
        np.testing.assert_array_equal(stood.turns, turns)
        np.testing.assert_array_equal(stood.codes[turns > 0], codes[turns > 0])
        keep = np.zeros(shape, np.uint8)
        count = select_standing(new, known, before, 20, 3, stood, keep)
        expected = slow.select(coding, new, known, margins, DELTA, 20, 3, codes, turns)
        np.testing.assert_array_equal(keep, expected)
        assert count == expected.sum()
    assert counts[:2] == [0, 0]
    assert min(counts[2:]) > 0
    assert 10 < count < 0.9 * keep.size


def test_turns_are_counted_up_to_their_limit():
    coding, shape = CODINGS[0], (4, 4)
    camera = Camera("v", Perspective.from_fov(4, 4, 1.1), Pose(), coding)
    known, new = (np.full(shape, coding.codes(np.array(z)), np.uint16) for z in (5.0, 2.0))
    image = MaximumDepthImage(View(camera, texture_of(np.zeros(shape)), known), Tolerances(*MARGINS), 0.01)
    stood = Stood(np.zeros((2, 2), np.uint16), np.zeros((2, 2), np.uint8))
    before = Before(image.rules, _beyond(coding, DELTA))
    counts = [note_standing(new, known, before, 100, stood) for _ in range(300)]
    assert (stood.turns == 100 + PATIENCE).all()
    assert np.flatnonzero(counts).tolist() == [99]
    nearer = np.full(shape, coding.codes(np.array(1.5)), np.uint16)
    turns = [(note_standing(nearer, known, before, 100, stood), stood.turns.max())[1] for _ in range(PATIENCE + 1)]
    assert turns == [*range(100 + PATIENCE - 1, 99, -1), 1]


LENSES = {"flat": Perspective.from_fov(48, 36, 1.1), "sphere": Equirectangular(60, 30, (-np.pi, np.pi), (-1.2, 1.1))}


@pytest.mark.parametrize("lens", LENSES)
def test_covered_pixels_are_those_of_the_slow_twin(lens):
    rng, coding = np.random.default_rng(4), CODINGS[0]
    camera = Camera("v", LENSES[lens], Pose.from_euler((0.1, -0.2, 0.1), 0.2, 0.1, -0.1), coding)
    shape, covered, unsure = (camera.height, camera.width), 0, 0
    codes = random_codes(rng, coding, (48, 48))
    codes = np.ascontiguousarray(np.pad(codes, ((0, 0), (0, 16)), mode="wrap")[: shape[0], : shape[1]])
    view = View(camera, texture_of(np.zeros(shape)), codes)
    uv = rng.uniform((0, 2), (shape[1], shape[0] - 2), (300, 1, 2)) + rng.uniform(-5, 5, (300, 3, 2))
    at = np.floor(uv.mean(axis=1)).astype(int)
    depth = coding.depth(np.maximum(codes[at[:, 1].clip(0, shape[0] - 1), at[:, 0] % shape[1]], 1))
    points = camera.unproject(uv, depth[:, None] + rng.uniform(-0.1, 0.1, (300, 3)))
    mesh = Triangles(
        points.reshape(-1, 3).astype(np.float32), np.zeros((900, 2), np.float32),
        np.arange(900, dtype=np.int32).reshape(-1, 3),
    )  # fmt: skip
    row = PreparedView(view, TriangulationOptions(0.0, 0.2), np.zeros(3)).table_row
    for i in range(300):
        keep, invalid = (codes > 0).astype(np.uint8), np.ones(300, np.uint8)
        invalid[i] = 0
        clear_covered(row, codes, mesh, invalid, DELTA, camera.wraps, keep)
        expected, near = slow.covered(camera, codes, points[i].astype(np.float32).astype(float), DELTA)
        np.testing.assert_array_equal(((keep == 0) & (codes > 0))[~near], expected[~near])
        covered, unsure = covered + expected.sum(), unsure + near.sum()
    assert covered > 1000
    assert unsure < 0.1 * covered
    keep = np.ones(shape, np.uint8)
    clear_covered(row, codes, mesh, np.ones(300, np.uint8), DELTA, camera.wraps, keep)
    assert keep.all()
