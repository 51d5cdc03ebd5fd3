"""`farside bench --trade` at a small size: no row is missing, the front is one, and accuracy goes where it must."""

from __future__ import annotations

import csv
import dataclasses
import itertools

import numpy as np
import pytest
from farside.clients.bench import trade as command
from farside.clients.bench.trade_report import fronts, plot_trade, write_report
from farside.engine.evaluation.trade import Plan, sweep
from farside.engine.evaluation.trade_points import Point, pareto, summarise
from farside.engine.evaluation.trade_variants import KNOBS, MODEL_KNOBS, variants
from farside.engine.evaluation.twin_recording import TwinRecording
from farside.engine.live.governor import LADDER
from farside.engine.settings import QUALITIES, Settings
from farside.engine.synth import make_twin, write_twin

PLAN = Plan(frames=4, step=12, judged=2, rounds=1)


@pytest.fixture(scope="module")
def swept():
    return variants()


@pytest.fixture(scope="module")
def rows(swept):
    return sweep(TwinRecording(make_twin("museum", 0.04)), swept, PLAN)


@pytest.fixture(scope="module")
def points(rows, swept):
    return summarise(rows, swept)


def row(rows, kind, knob, value):
    (found,) = [r for r in rows if (r.kind, r.knob, r.value) == (kind, knob, value)]
    return found


def test_every_knob_preset_and_rung_has_its_row(rows, swept):
    assert len(rows) == len(swept) == len({(r.kind, r.knob, r.value) for r in rows})
    for quality in QUALITIES:
        row(rows, "preset", "preset", quality)
    for kind, knobs in (("picture", KNOBS), ("model", MODEL_KNOBS)):
        for knob, values in knobs.items():
            found = {r.value for r in rows if (r.kind, r.knob) == (kind, knob)}
            default = getattr(Settings.preset("balanced"), knob)
            assert len(found) == len([value for value in values if value != default])
    for name, *_, preset, changes in LADDER:
        wanted = Settings.preset(preset, **changes)
        assert any(variant.settings == wanted for variant in swept), name
    assert len({variant.settings for variant in swept if variant.kind == "grid"}) > 10


def test_figures_are_in_range_and_the_bases_have_the_times_of_themselves(rows):
    for r in rows:
        assert 20 < r.sent <= r.iv_psnr + 0.5 < 70
        assert 0 <= r.holes_backdrop <= r.holes_warped < 0.5
        assert min(r.time, r.total, r.update, r.first, r.bytes, r.triangles) > 0
    base = row(rows, "preset", "preset", "balanced")
    assert base.update == base.first == 1.0


def test_accuracy_goes_where_it_must(rows):
    base, best = row(rows, "preset", "preset", "balanced"), row(rows, "preset", "preset", "best")
    assert row(rows, "picture", "tolerance_px", "0").iv_psnr >= base.iv_psnr - 0.05
    coarse, fine = (row(rows, "picture", "tolerance_px", value).triangles for value in ("1", "0"))
    assert coarse < base.triangles < fine
    fast = row(rows, "preset", "preset", "fast")
    assert min(best.iv_psnr, base.iv_psnr) > fast.iv_psnr + 0.2
    assert best.psnr_y > base.psnr_y > fast.psnr_y
    scales = [row(rows, "picture", "output_scale", value) for value in ("0.5", "0.7", "0.85")] + [base]
    assert all(a.iv_psnr < b.iv_psnr for a, b in itertools.pairwise(scales))
    assert all(a.bytes < b.bytes for a, b in itertools.pairwise(scales))
    few, many = (row(rows, "picture", "n_render", value) for value in ("2", "8"))
    assert few.iv_psnr < base.iv_psnr
    assert few.holes_warped >= base.holes_warped >= many.holes_warped
    assert few.triangles < base.triangles < many.triangles


def test_bytes_and_what_arrives_fall_with_jpeg_quality_and_nothing_else_does(rows):
    jpegs = [row(rows, "picture", "jpeg_quality", value) for value in ("50", "70", "80")]
    jpegs += [row(rows, "preset", "preset", "balanced"), row(rows, "picture", "jpeg_quality", "95")]
    assert all(a.bytes < b.bytes and a.sent < b.sent for a, b in itertools.pairwise(jpegs))
    assert len({(r.iv_psnr, r.triangles, r.holes_backdrop, r.rays) for r in jpegs}) == 1


def test_the_models_knobs_change_the_model(rows):
    base = row(rows, "model", "n_render", "1")
    without = row(rows, "model", "background", "False")
    assert without.rays == 0
    assert without.holes_backdrop == without.holes_warped == base.holes_warped > base.holes_backdrop
    assert without.iv_psnr < base.iv_psnr
    rays = [row(rows, "model", "pbi_scale", value).rays for value in ("0.25", "1")]
    assert rays[0] < base.rays < rays[1]
    margins = [row(rows, "model", "pbi_margin_rad", value).rays for value in ("0", "0.1")]
    assert margins[0] < margins[1]  # the default lies between, by less than a cell of such small pictures
    strides = [row(rows, "model", "culling_stride", value).rays for value in ("1", "4")]
    assert strides[0] > strides[1]


def dominated(point, others, cost, worth):
    def beats(other):
        cheaper, better = getattr(other, cost) - getattr(point, cost), getattr(other, worth) - getattr(point, worth)
        return cheaper <= 0 and better >= 0 and (cheaper < 0 or better > 0)

    return any(map(beats, others))


def test_the_fronts_rise_and_nothing_dominates_them(points):
    by_time, by_bytes = fronts(points)
    assert len(by_bytes) >= 3  # times of such small pictures may leave one point that beats all others
    for front, cost, worth in ((by_time, "time", "iv_psnr"), (by_bytes, "bytes", "sent")):
        assert front
        for a, b in itertools.pairwise(front):
            assert getattr(a, cost) < getattr(b, cost)
            assert getattr(a, worth) < getattr(b, worth)
        rivals = [p for p in points if p.kind != "model" and (front is by_bytes or p.knob != "jpeg_quality")]
        assert not any(dominated(point, rivals, cost, worth) for point in front)
    assert all(point.kind != "model" for point in by_time)


def test_a_front_of_random_points_is_that_of_trying_all():
    random = np.random.default_rng(4)
    points = [
        Point("grid", "k", str(k), *random.normal(size=2), *random.uniform(0.1, 2.0, 6)) for k in range(200)
    ]
    expected = {p.value for p in points if not dominated(p, points, "time", "iv_psnr")}
    assert {p.value for p in pareto(points, "time", "iv_psnr", least=0.0)} == expected
    model = dataclasses.replace(points[0], kind="model", time=0.0, iv_psnr=99.0)
    assert model not in pareto([*points, model], "time", "iv_psnr")


def test_points_are_means_of_gains_and_of_ratios(rows, swept):
    other = [dataclasses.replace(r, material="other", iv_psnr=r.iv_psnr + 3, time=4 * r.time) for r in rows]
    for one, two in zip(summarise(rows, swept), summarise([*rows, *other], swept), strict=True):
        assert two.iv_psnr == pytest.approx(one.iv_psnr)
        assert two.time == pytest.approx(2 * one.time)
    base = next(p for p in summarise(rows, swept) if p.value == "balanced")
    assert (base.iv_psnr, base.sent, base.bytes, base.update) == (0.0, 0.0, 1.0, 1.0)


def test_files_hold_all_rows_and_the_front(rows, points, tmp_path):
    summary = write_report(tmp_path / "out", rows, points)
    with (summary.parent / "trade.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [(r["kind"], r["knob"], r["value"]) for r in read] == [(r.kind, r.knob, r.value) for r in rows]
    assert [float(r["iv_psnr"]) for r in read] == [r.iv_psnr for r in rows]
    with (summary.parent / "front.csv").open(newline="") as file:
        assert [r["value"] for r in csv.DictReader(file)] == [p.value for p in fronts(points)[0]]
    text = summary.read_text("utf-8")
    assert all(f"| {p.label} |" in text for p in points)


def test_the_plot_is_a_picture(points, tmp_path):
    pytest.importorskip("matplotlib")
    plot_trade(points, "title", tmp_path / "trade.png")
    assert (tmp_path / "trade.png").read_bytes()[:4] == b"\x89PNG"


def test_a_sequence_is_swept_at_its_virtual_cameras_and_the_command_prints_it(tmp_path, capsys, monkeypatch):
    write_twin("painter", tmp_path / "painter", 0.04, frames=2)
    monkeypatch.setattr(command, "variants", lambda: variants()[:4])
    command.command([tmp_path / "painter"], frames=2, every=1, report=tmp_path / "report")
    printed = capsys.readouterr().out
    assert "time against IV-PSNR" in printed
    for quality in QUALITIES:
        assert quality in printed
    with (tmp_path / "report" / "trade.csv").open(newline="") as file:
        assert {row["material"] for row in csv.DictReader(file)} == {"painter"}


def test_plans_judge_the_later_half():
    material = TwinRecording(make_twin("museum", 0.03))
    assert Plan(4, 10).indices(material) == [0, 10, 20, 30]
    assert [k for k in range(12) if Plan(judged=3).is_judged(k, 12)] == [6, 8, 11]
    assert [k for k in range(1) if Plan(judged=3).is_judged(k, 1)] == [0]
    with pytest.raises(ValueError, match="rounds: 0: expected at least 1"):
        Plan(rounds=0)
