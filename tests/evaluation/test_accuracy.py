"""`farside bench --accuracy`: its figures against those of files that were written, and its page."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from farside.clients.bench import accuracy
from farside.clients.bench.accuracy import make_plan
from farside.clients.compare import compare
from farside.engine.evaluation.accuracy import Case, Plan, Sample, judge_pictures, picture_count, summarise
from farside.engine.evaluation.flicker import measure_flicker
from farside.engine.evaluation.metrics import erp_range
from farside.engine.evaluation.peers import nearest_views
from farside.engine.evaluation.twin_recording import TwinRecording, default_targets, find_recordings
from farside.engine.io.tmiv import open_sequence
from farside.engine.io.yuv import RawVideo
from farside.engine.pipeline.offline import OfflineRenderer, PictureWriter, RenderJob
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, write_twin

TWIN, SCALE, VIEWS = "hijack", 0.06, 3
TARGETS = ["t0", "t2"]  # perspective and equirectangular
FIGURES = ("psnr_y", "ws_psnr_y", "iv_psnr", "ssim", "ms_ssim", "iv_ssim", "iv_ms_ssim")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A report on a twin that was written to disk."""
    root = tmp_path_factory.mktemp("accuracy")
    write_twin(TWIN, root / "sequences" / TWIN, SCALE, frames=2)
    accuracy.command(
        [root / "sequences"], cameras=TARGETS, views=f"{VIEWS},all", quality="fast", report=root / "report"
    )
    return root


@pytest.fixture(scope="module")
def rows(folder):
    with (folder / "report" / "accuracy.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def judged():
    """The same pictures of the twin in memory."""
    plan = Plan((VIEWS, 0), qualities=("fast",), frames=2)
    return list(judge_pictures(TwinRecording(make_twin(TWIN, SCALE)), TARGETS, plan))


def row_of(rows, sample):
    case = sample.case
    key = (case.camera, str(case.views), str(case.model), str(sample.frame))
    return next(r for r in rows if (r["camera"], r["views"], r["model"], r["frame"]) == key)


@pytest.mark.parametrize("model", [False, True])
@pytest.mark.parametrize("target", TARGETS)
def test_figures_are_those_of_the_files_that_render_writes(folder, rows, tmp_path, target, model):
    sequence = open_sequence(folder / "sequences" / TWIN)
    settings, viewers = Settings.preset("fast", n_render=VIEWS, background=model), {target: sequence.camera(target)}
    job = RenderJob(sequence, nearest_views(sequence, target, VIEWS), lambda index: viewers, 0, 2)
    with PictureWriter(tmp_path) as writer:
        for index, pictures, _row in OfflineRenderer(job, settings).frames():
            writer.write(target, index, pictures[target])
    camera = sequence.camera(target)
    (file,) = tmp_path.glob(f"{target}_texture*.yuv")
    written = RawVideo(file, camera.width, camera.height, "yuv420p10le")
    report = compare(sequence.video(target, "texture"), written, erp_range(camera))
    case = Case(TWIN, target, VIEWS, model, "fast")
    for expected in report["frames"]:
        row = row_of(rows, Sample(case, expected["frame"], 0, None, 0, 0, None, 0, None, 0, 0))
        for name in FIGURES:
            assert row[name] == ("" if name not in expected else str(expected[name]))
    assert 25 < float(row["psnr_y"]) < 60


def test_a_twin_in_memory_has_the_figures_of_the_files_and_more(rows, judged):
    assert len(judged) == len(rows) == 2 * 2 * 2 * 2
    for each in judged:
        row = row_of(rows, each.sample)
        for name in (*FIGURES, "flicker", "holes_warped", "holes_backdrop"):
            value = getattr(each.sample, name)
            assert row[name] == ("" if value is None else str(value))
        assert row["bias_px"] == row["ghosts"] == ""
        assert each.sample.silhouettes > 5
        assert abs(each.sample.bias_px) < 0.5
        assert 0.3 < each.sample.thin <= 1
        assert (each.sample.ghosts is not None) == each.sample.case.model


def test_flicker_is_that_of_the_frame_and_the_one_before(judged):
    for before, now in zip(judged[: len(judged) // 2], judged[len(judged) // 2 :], strict=True):
        assert (before.sample.case, before.sample.frame, now.sample.frame) == (now.sample.case, 0, 1)
        pair = before, now
        expected = measure_flicker(
            [p.picture.texture.y for p in pair], [p.truth.y for p in pair], [p.picture.holes() for p in pair]
        )
        assert now.sample.flicker == pytest.approx(expected.whole.ratio)
        assert before.sample.flicker is None


def test_a_camera_of_the_rig_is_its_own_view():
    material = TwinRecording(make_twin(TWIN, SCALE))
    for own in judge_pictures(material, ["v9"], Plan((1,), qualities=("best",), frames=1)):
        assert own.sample.psnr_y > (45 if own.sample.case.model else 60)
        assert own.sample.ssim > 0.99
        assert abs(own.sample.bias_px) < 0.1  # the picture has four samples a pixel, its judge sixteen
        assert own.sample.roughness_px == pytest.approx(own.sample.truth_roughness_px, abs=0.03)
        assert own.sample.holes_warped < 0.01


def test_the_page_shows_the_worst_first_and_needs_nothing_else(folder, rows):
    page = (folder / "report" / "index.html").read_text("utf-8")
    shown = [float(figure) for figure in re.findall(r"<h3>([\d.]+) dB", page)]
    assert shown == sorted(round(float(row["iv_psnr"]), 2) for row in rows)
    assert shown[0] < shown[-1]
    assert {source[:11] for source in re.findall(r'src="([^"]*)"', page)} == {"data:image/"}
    assert not re.search(r"<script|<link|@import|https?:|url\(", page)
    linked = re.findall(r'href="([^"]*)"', page)
    assert len(linked) == 4 * len(rows)
    assert all((folder / "report" / name).is_file() for name in linked)


def test_json_and_table_agree_with_the_samples(folder, rows):
    figures = json.loads((folder / "report" / "accuracy.json").read_text())
    assert [str(sample["iv_psnr"]) for sample in figures["samples"]] == [row["iv_psnr"] for row in rows]
    for row in figures["summary"]:
        group = [r for r in rows if (r["views"], r["model"]) == (str(row["views"]), str(row["model"]))]
        assert row["pictures"] == len(group)
        assert row["iv_psnr"] == pytest.approx(np.mean([float(r["iv_psnr"]) for r in group]))
        assert row["worst"] == min(float(r["iv_psnr"]) for r in group)
        assert row["ws_psnr_y"] == pytest.approx(np.mean([float(r["ws_psnr_y"]) for r in group if r["ws_psnr_y"]]))


def test_a_table_is_printed_without_a_report_too(capsys):
    accuracy.command(
        twins=TWIN, scale=0.03, cameras=["t0"], views="2", quality="fast", frames=1, background=False
    )
    printed = capsys.readouterr().out
    assert TWIN in printed
    assert "bias px" in printed
    assert "WS-PSNR" not in printed  # no equirectangular camera


def test_what_was_measured_before_an_interrupt_is_reported(judged, tmp_path, monkeypatch, capsys):
    def interrupted(*_arguments):
        yield judged[0]
        raise KeyboardInterrupt

    monkeypatch.setattr(accuracy, "judge_pictures", interrupted)
    accuracy.command(twins=TWIN, scale=SCALE, report=tmp_path)
    assert f"{judged[0].sample.iv_psnr:.2f}" in capsys.readouterr().out
    assert len(json.loads((tmp_path / "accuracy.json").read_text())["samples"]) == 1


def test_silhouettes_weigh_as_many_as_they_are():
    case = Case("s", "t0", 2, True, "best")
    alike = 0.9, None, 0.8, None, 0.0, 0.0  # SSIMs and holes
    plain = Sample(case, 0, 30.0, None, 40.0, *alike)
    few = Sample(case, 1, 32.0, None, 42.0, *alike, bias_px=1.0, silhouettes=10, thin=0.0, thin_pixels=0)
    many = Sample(case, 2, 31.0, None, 38.0, *alike, bias_px=0.0, silhouettes=30, thin=0.5, thin_pixels=8)
    (row,) = summarise([plain, few, many])
    assert (row["bias_px"], row["thin"], row["worst"], row["psnr_y"]) == (0.25, 0.5, 38.0, 31.0)
    assert row["ws_psnr_y"] is None
    assert (row["ssim"], row["iv_ssim"], row["ms_ssim"]) == (pytest.approx(0.9), pytest.approx(0.8), None)


def test_plans_and_what_they_refuse(tmp_path):
    material = TwinRecording(make_twin(TWIN, SCALE))
    assert default_targets(material) == ["t0", "t1", "t2"]
    plan = make_plan("2,all", False, "fast,best", 30, 7)
    assert plan == Plan((2, 0), (False,), ("fast", "best"), 30, 7)
    assert plan.indices(material) == [0, 7, 14, 21, 28, 29]
    assert picture_count(material, TARGETS, plan) == 6 * 2 * 2 * 2
    for text in ("0", "2,", "a", "-1"):
        with pytest.raises(ValueError, match=r"--views: .*expected numbers"):
            make_plan(text, None, "best", None, None)
    with pytest.raises(ValueError, match="expected a TMIV sequence, or a folder of sequences"):
        find_recordings([tmp_path])
    with pytest.raises(ValueError, match="nothing to render"):
        accuracy.command()
    with pytest.raises(ValueError, match="quality: 'good': expected one of"):
        accuracy.command(twins=TWIN, scale=0.03, quality="good")
