"""The paper's experiments repeated: figures agree with pictures, and the page with its figures."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from farside.clients.bench import paper as module
from farside.clients.bench.paper import command, distant_cameras, show_experiments
from farside.clients.bench.paper_report import PaperReport
from farside.engine.background.report import UpdateReport
from farside.engine.evaluation.experiments import WAYS, FixedExperiment, farthest_camera, play_fixed
from farside.engine.evaluation.exposed import ExposedTriangles
from farside.engine.evaluation.hole_tint import HOLE_RGB, tinted
from farside.engine.evaluation.published import TABLE_3
from farside.engine.evaluation.twin_recording import TwinRecording
from farside.engine.rig.camera import Camera, Pose
from farside.engine.synth import make_twin
from PIL import Image
from support.recordings import Bare, MemoryRecording
from support.rooms import camera_row, frame, see

CHROMIUM = Path("/usr/bin/chromium")
BOXES = (-0.4, 0.0, 0.4, 0.8)
QUALITIES = ("paper", "balanced")
SIZE = (64, 48)


def room() -> MemoryRecording:
    """A box that moves along a wall. t0 stands in a row of six cameras. t1, far outside of it, also sees some of the
    wall that the box hides from them at present."""
    cameras = camera_row(6, SIZE, spacing=0.2)
    targets = [
        dataclasses.replace(cameras[2], name="t0"),
        Camera("t1", cameras[0].projection, Pose((0.3, 1.3, 0.0)), cameras[0].depth),
    ]
    truth = {target.name: [see(target, box).texture for box in BOXES] for target in targets}
    return MemoryRecording([frame(index, cameras, box) for index, box in enumerate(BOXES)], targets, truth)


@pytest.fixture(scope="module")
def experiment() -> FixedExperiment:
    steps: list[int] = []
    played = play_fixed(Bare(room()), ["t0", "t1"], 4, 3, QUALITIES, lambda: steps.append(1))  # type: ignore[arg-type]
    assert len(steps) == 4
    return played


def test_each_quality_is_played_in_every_way(experiment: FixedExperiment) -> None:
    rows = experiment.summaries()
    assert [(row.quality, row.way) for row in rows] == [(quality, way.name) for quality in QUALITIES for way in WAYS]
    assert {(each.camera, each.frame) for each in experiment.judged} == {(c, f) for c in ("t0", "t1") for f in (0, 3)}
    assert [cost.frame for cost in experiment.costs if cost.quality == "paper"] == [0, 1, 2, 3]
    drawn = {each.way: len(each.warped.report.views) for each in experiment.pictures if each.quality == "paper"}
    assert drawn == {"all views": 6, "five views": 5, "five views, model": 5, "three views, model": 3}
    assert (experiment.shown, experiment.views, experiment.eye) == ("t1", 6, SIZE)


def test_the_model_closes_holes_and_filling_all_of_them(experiment: FixedExperiment) -> None:
    for quality in QUALITIES:
        rows = {way.name: experiment.summary(quality, way.name) for way in WAYS}
        assert 0 < rows["five views, model"].holes < rows["five views"].holes
        assert all(row.psnr_y_filled > row.psnr_y for row in rows.values() if row.holes)
    with pytest.raises(ValueError, match="fast, all views: not measured: expected one of paper, balanced"):
        experiment.summary("fast", "all views")


def test_summaries_are_means_and_medians(experiment: FixedExperiment) -> None:
    row = experiment.summary("balanced", "five views")
    judged = [each for each in experiment.judged if (each.quality, each.way) == ("balanced", "five views")]
    times = [each for each in experiment.times if (each.quality, each.way) == ("balanced", "five views")]
    assert (len(judged), len(times)) == (4, 2)
    assert row.holes == pytest.approx(sum(each.holes for each in judged) / 4)
    assert row.iv_psnr_filled == pytest.approx(sum(each.iv_psnr_filled for each in judged) / 4)
    assert row.filled_ms == pytest.approx((times[0].filled_ms + times[1].filled_ms) / 2)


def test_tinted_are_the_holes_of_the_picture(experiment: FixedExperiment) -> None:
    for each in experiment.pictures:
        blue = (tinted(each.warped) == HOLE_RGB).all(axis=-1)
        np.testing.assert_array_equal(blue, each.warped.disparity <= 0)
        np.testing.assert_array_equal(tinted(each.filled), np.where(
            blue[..., None], HOLE_RGB, tinted(dataclasses.replace(each.filled, disparity=np.ones(blue.shape, "f4")))
        ))  # fmt: skip
        (last,) = [
            judged.holes for judged in experiment.judged
            if (judged.quality, judged.way, judged.camera, judged.frame) == (each.quality, each.way, "t1", 3)
        ]  # fmt: skip
        assert blue.mean() == last
        if each.quality == "paper":
            assert blue.mean() == each.warped.report.holes_backdrop


def test_newly_exposed_triangles_are_those_of_the_p_pbs_and_all_that_were_culled_from_it() -> None:
    exposed, updates = ExposedTriangles(), [
        UpdateReport(0, (), culled=70, s_pbs=1000, s_pbs_valid=1000, p_pbs=0),  # culled before the S-PBS was there
        UpdateReport(1, (), culled=0, s_pbs=1000, s_pbs_valid=1000, p_pbs=50),
        UpdateReport(2, (), culled=30, s_pbs=1000, s_pbs_valid=990, p_pbs=45),  # 10 of the S-PBS, 20 of the P-PBS
        UpdateReport(3, (), culled=5, s_pbs=1000, s_pbs_valid=985, p_pbs=45),  # of the S-PBS only
    ]  # fmt: skip
    assert [exposed.take(update) for update in updates] == [0, 50, 65, 65]


def test_in_a_run_the_p_pbs_is_what_is_left_of_what_was_exposed(experiment: FixedExperiment) -> None:
    for quality in QUALITIES:
        costs = [cost for cost in experiment.costs if cost.quality == quality]
        assert (costs[0].exposed, costs[0].p_pbs) == (0, 0)
        assert all(cost.exposed >= cost.p_pbs for cost in costs)
        assert costs[-1].p_pbs > 0  # the wall behind the box


def test_cameras_outside_the_rig_are_preferred() -> None:
    recording = room()
    assert distant_cameras(recording) == ["t1"]
    assert farthest_camera(recording, ["t0", "t1"]) == "t1"
    inside = MemoryRecording(recording._frames, recording._virtual[:1], {"t0": recording._truth["t0"]})
    assert distant_cameras(inside) == ["t0"]
    with pytest.raises(ValueError, match="in memory: no virtual camera with ground truth"):
        farthest_camera(recording, [])


class Page(HTMLParser):
    """The tables, links, pictures and tags of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self.links: list[str] = []
        self.sources: list[str] = []
        self.tags: list[str] = []
        self._cell: list[str] | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        given = dict(attrs)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self._cell = []
        self.links += [given["href"] or ""] if "href" in given else []
        self.sources += [given["src"] or ""] if "src" in given else []

    def handle_data(self, data: str) -> None:
        if self._cell is not None:
            self._cell.append(data)

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th") and self._cell is not None:
            self.tables[-1][-1].append("".join(self._cell))
            self._cell = None


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of two frames of two recordings."""
    path = tmp_path_factory.mktemp("report")
    report = PaperReport(path, {"machine": "one & only"})
    twin = TwinRecording(make_twin("gymnasium-a", 0.03))
    show_experiments([room(), twin], ["t1"], 2, 5, 6, report, QUALITIES)
    return path


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / "paper.html").read_text("utf-8"))


@pytest.fixture(scope="module")
def figures(folder: Path) -> Any:
    return json.loads((folder / "paper.json").read_text("utf-8"))


def test_the_tables_show_the_figures(page: Page, figures: Any) -> None:
    table_2, table_3, spbs, moving = page.tables
    rows = figures["table_2"]
    assert len(table_2) == 1 + len(rows) == 9
    for cells, row in zip(table_2[1:], rows, strict=True):
        assert cells[:2] == [row["quality"], row["way"]]
        numbers = [float(cell.removesuffix(" %")) for cell in cells[2:]]
        names = ("warped_ms", "filled_ms", "holes", "psnr_y", "iv_psnr", "psnr_y_filled", "iv_psnr_filled")
        assert numbers == pytest.approx([row[name] * (100 if name == "holes" else 1) for name in names], abs=0.051)
    measured = {(cells[0], cells[1]): cells for cells in table_3[1 + len(TABLE_3) :]}
    assert set(measured) == {("in memory", quality) for quality in QUALITIES}
    for (_, quality), cells in measured.items():
        all_views, few = (
            next(row["filled_ms"] for row in rows if (row["quality"], row["way"]) == (quality, way))
            for way in ("all views", "five views, model")
        )
        assert float(cells[4]) == pytest.approx(all_views / few, abs=0.0051)
    firsts = {cost["quality"]: cost for cost in reversed(figures["fixed"][0]["costs"])}
    assert [cells[3] for cells in spbs[1:]] == [f"{firsts[quality]['s_pbs']:,}" for quality in QUALITIES]
    for cells, row in zip(moving[1:], figures["moving"], strict=True):
        last = row["moments"][-1]
        assert cells[:4] == ["gymnasium-a", row["quality"], "6", "t1"]
        assert cells[11:] == [f"{last['exposed']:,}", f"{last['p_pbs'][1]:,}"]
        times = ("picture_fixed_ms", "picture_moving_ms", "update_fixed_ms", "update_moving_ms")
        assert cells[7:11] == [f"{row[name]:.1f}" for name in times]
        updates = np.median([moment["update_ms"] for moment in row["moments"][1:]], axis=0)
        assert [row[name] for name in times[2:]] == pytest.approx(list(updates))
        assert min(row[name] for name in times) > 0
        holes = [float(cell.removesuffix(" %")) / 100 for cell in cells[5:7]]
        assert holes == pytest.approx(last["holes"]["t1"], abs=1e-5)


def test_published_figures_stand_beside_with_their_table(page: Page, figures: Any) -> None:
    shown = page.tables[1][1 : 1 + len(TABLE_3)]
    assert shown[0] == ["Museum", "published, Table 3: 3090", "30.36 (46.32)", "8.93 (15.31)", "3.40"]
    assert [float(cells[4]) for cells in shown] == [3.4, 3.17, 3.46, 3.01, 3.76]
    assert [gpu["name"] for gpu in figures["published"]["Table 3"]] == [gpu.name for gpu in TABLE_3]


def test_the_page_needs_nothing_from_elsewhere(folder: Path, page: Page) -> None:
    text = (folder / "paper.html").read_text("utf-8")
    assert "machine: one &amp; only" in text
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    assert all(source.startswith("data:image/jpeg;base64,") for source in page.sources)
    assert re.findall(r'(?:href|src|url\()\s*=?"?https?:', text) == []
    assert all((folder / link).is_file() for link in page.links)
    assert page.tags.count("svg") == (2 + 2) + 3 * 2  # Fig. 11; 12b
    # In both qualities: Fig. 9 and 10 with two rows of four ways and the truth; Fig. 13 in two frames.
    assert len(page.sources) == 2 * (2 * 5) + 2 * (2 * 4)


def test_the_files_of_pictures_show_their_holes(folder: Path, figures: Any) -> None:
    for judged in figures["fixed"][0]["judged"]:
        if judged["frame"] == 1:
            way = re.sub(r"\W", "_", judged["way"])
            with Image.open(folder / "pictures" / f"in_memory_{judged['quality']}_{way}.png") as image:
                blue = (np.asarray(image) == HOLE_RGB).all(axis=-1)
            assert blue.mean() == judged["holes"]


@pytest.fixture
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"there is no {CHROMIUM} (apt-get install chromium)")
    with sync_api.sync_playwright() as playwright:
        flags = "--headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking"
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=flags.split())
        yield started
        started.close()


def test_a_browser_opens_it_from_disk(browser: Any, folder: Path) -> None:
    shown = browser.new_page(viewport={"width": 1200, "height": 900})
    asked: list[str] = []
    problems: list[str] = []
    shown.on("request", lambda request: asked.append(request.url))
    shown.on("console", lambda message: problems.append(message.text))
    shown.on("pageerror", lambda error: problems.append(str(error)))
    path = (folder / "paper.html").as_uri()
    shown.goto(path)
    assert problems == []
    assert [url for url in asked if not url.startswith("data:")] == [path]
    assert shown.evaluate("[...document.images].every((image) => image.naturalWidth > 1)")
    assert shown.evaluate("[...document.querySelectorAll('svg')].every((plot) => plot.getBBox().width > 300)")
    assert shown.evaluate("document.documentElement.scrollWidth") <= 1200


class Walk(MemoryRecording):
    """Every camera moves."""

    name = "walk"

    def poses(self, name: str) -> list[Pose]:
        return [Pose((0.0, 0.1 * k, 0.0)) for k in range(self.frame_count)]


def test_a_walk_is_left_out_and_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walk = Walk([frame(index, camera_row(2)) for index in range(2)])
    show_experiments([walk], None, 2, 1, 2, PaperReport(tmp_path, {}), QUALITIES)
    assert capsys.readouterr().out == "walk: left out: all of its cameras move\n"


def test_the_command_repeats_them_with_a_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gains: list[Any] = []
    asked: list[Any] = []
    monkeypatch.setattr(module, "show_paper", lambda *given: gains.append(given))
    monkeypatch.setattr(module, "show_experiments", lambda *given: asked.append(given))
    command(scale=0.02)
    assert asked == []
    command(scale=0.02, report=tmp_path)
    command(twins="frog", scale=0.02, frames=4, moving_frames=7, report=tmp_path)
    assert len(gains) == 3
    names = [[recording.name for recording in given[0]] for given in asked]
    assert names == [["museum", "hijack", "painter", "frog", "gymnasium-a", "gymnasium-b"], ["frog"]]
    assert [given[2:5] for given in asked] == [(21, 5, 105), (4, 5, 7)]
    assert asked[0][5].folder == tmp_path
    assert asked[0][5].about["scale of twins"] == "0.02"
