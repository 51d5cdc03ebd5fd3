"""The flicker measure: analytic pictures with known changes, and a rig whose truth keeps still."""

from __future__ import annotations

import numpy as np
import pytest
from farside.clients.bench import flicker
from farside.engine.evaluation.flicker import REACH_PX, ROUNDING, STILL, Steadiness, measure_flicker, watch_flicker
from farside.engine.io.tmiv import open_sequence
from farside.engine.settings import Settings
from farside.engine.synth import write_twin


def still(count, shape=(40, 60), level=500):
    return [np.full(shape, level, np.uint16) for _ in range(count)]


def test_what_keeps_still_does_not_flicker():
    found = measure_flicker(still(4), still(4), [np.ones((40, 60), bool)] * 4)
    assert found.whole == found.holes == Steadiness(1.0, 0.0, 0.0)
    assert found.whole.ratio == 0.0


def test_a_change_of_the_renderers_own_counts_by_its_size_and_place():
    rendered, holes = still(3), [np.zeros((40, 60), bool) for _ in range(3)]
    holes[1][:, :6] = True
    rendered[1][:, :6] -= 30  # only while it is a hole; both of its steps count
    found = measure_flicker(iter(rendered), iter(still(3)), iter(holes))
    assert found.holes == Steadiness(0.1, 30.0, 0.0)
    assert found.whole.rendered == pytest.approx(3.0)
    assert found.whole.ratio == pytest.approx(3.0 / ROUNDING)


def test_steps_are_not_averaged_out_and_the_truths_own_noise_is_allowed_for():
    truth = [frame + np.uint16(2 * (k % 2)) for k, frame in enumerate(still(5))]
    rendered = [frame + np.uint16(6 * (k % 2)) for k, frame in enumerate(still(5))]
    assert measure_flicker(rendered, truth).whole.ratio == pytest.approx(3.0)


def test_what_moves_in_truth_and_round_it_does_not_count():
    truth, rendered = still(2), still(2)
    truth[1][20, 30] += int(STILL) + 1
    rendered[1][20 - REACH_PX : 21 + REACH_PX, 30 - REACH_PX : 31 + REACH_PX] += 100
    side = 2 * REACH_PX + 1
    assert measure_flicker(rendered, truth).whole == Steadiness(1 - side * side / 2400, 0.0, 0.0)
    rendered[1][20 - REACH_PX - 1, 30] += 100
    assert measure_flicker(rendered, truth).whole.rendered > 0


def test_codes_of_other_depths_measure_the_same():
    rendered, truth = still(2), still(2)
    rendered[1] += np.uint16(40)
    eight = [frame // 4 for frame in rendered], [frame // 4 for frame in truth]
    assert measure_flicker(*eight, bits=8) == measure_flicker(rendered, truth)


def test_no_holes_are_a_share_of_nothing():
    assert measure_flicker(still(2), still(2)).holes == Steadiness(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("rendered", "truth", "message"),
    [
        (still(1), still(1), "frames"),
        ([], [], "frames"),
        (still(2), still(3), "argument 2"),
        (still(2, (40, 61)), still(2), "rendered"),
        ([*still(1), *still(1, (2, 3))], [*still(1), *still(1, (2, 3))], "rendered"),
    ],
)
def test_bad_input_is_refused(rendered, truth, message):
    with pytest.raises(ValueError, match=message):
        measure_flicker(rendered, truth)


@pytest.fixture(scope="module")
def painter(tmp_path_factory):
    """Three frames of a small twin whose depth is off differently in each."""
    folder = tmp_path_factory.mktemp("twins") / "painter"
    write_twin("painter", folder, 0.04, 3)
    return open_sequence(folder)


def test_depth_errors_make_a_still_rig_flicker(painter):
    sources, settings = painter.source_names[:3], Settings.preset("balanced", background=False)
    found = watch_flicker(painter, "t0", 60, settings, sources)
    assert found.whole.share > 0.5
    assert found.whole.rendered > found.whole.truth
    assert 0.0 < found.holes.share < 0.2
    assert found.holes.rendered > found.whole.rendered
    assert watch_flicker(painter, "t0", 60, settings, sources) == found


def test_watching_needs_a_still_camera(painter):
    with pytest.raises(ValueError, match="nowhere"):
        watch_flicker(painter, "nowhere", 2, Settings())


def test_the_command_prints_a_row_a_camera(painter, capsys):
    flicker.command(painter.folder, ["t0", "t1"], views=2, quality="fast", background=False)
    printed = capsys.readouterr().out
    assert "painter, quality fast, 2 views" in printed
    assert all(name in printed for name in ("t0", "t1", "ratio"))
