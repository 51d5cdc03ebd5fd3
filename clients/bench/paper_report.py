"""The paper's experiments repeated, as one HTML page that opens from disk, with all figures as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from farside.engine.evaluation import published
from farside.engine.evaluation.experiments import WAYS, FixedExperiment, Summary
from farside.engine.evaluation.hole_tint import tinted
from farside.engine.evaluation.moving_experiment import MovingExperiment
from farside.engine.rig.texture import to_rgb
from farside.engine.support.array_types import U8
from PIL import Image

from .page import data_uri, page, table, thumbnail
from .paper_plots import cost_plots, moving_plots

__all__ = ["TABLE_2", "TABLE_3", "PaperReport", "heading", "moving_table", "ratio", "table_2_cells", "table_3_rows"]

THUMBNAIL_PX = 420
TABLE_2 = (
    "quality", "views drawn", "pair, ms", "filled", "holes", "PSNR-Y", "IV-PSNR", "filled PSNR-Y", "filled IV-PSNR",
)  # fmt: skip
TABLE_3 = ("sequence", "quality", "all views, ms", "five with the model, ms", "ratio")

MEANING_2 = """Warping all views, and five and three views with the background model. pair: wall time of a stereo pair,
without filling, and with it; the meshes of the views have been made before, once a frame. Holes: pixels before filling
in which nothing was drawn. dB against the ground truth, where holes are grey without filling. Holes and dB are means
over the virtual cameras and the judged frames; the paper does not give them. Its times of Museum stand below."""
MEANING_3 = """How many times longer a stereo pair of all views takes than one of five views with the model, both
filled. The first rows are the paper's (24 views of Museum, 1280 x 1440 pixels an eye, headset not synchronised, in
parentheses synchronised); the others are measured here, on a CPU and with pictures of another size, so that only ratios
can be compared."""
MEANING_9 = """The last frame, seen from the virtual camera that is farthest from the rig. Light blue: holes, pixels in
which nothing was drawn. Fig. 9 of the paper compares all views with five views and the model; Fig. 10 compares five
views without the model and with it, before filling (above) and after (below). A picture is a link to its file."""
MEANING_11 = """(a) Triangles of the P-PBS, and those it would have if foreground culling removed none (in the paper:
newly exposed triangles simply accumulated). (b) Time of the update of the PBS in each frame but the first, which builds
the S-PBS. (c) Time of a stereo pair; letters as in the paper: five views without the model (A, B), five views with it
(C, D), three views with it (E, F), each without filling and with it. The paper gives curves only; its numbers, where
its text names any, are dashed lines."""
MEANING_SPBS = """Time to build the S-PBS, and its valid triangles, in the first frame. Section 4.1 of the paper gives
both in its text. `paper` makes two triangles for each pixel, as in the paper, from views of the scale of this run; the
other qualities make as few as their error bound allows."""
MEANING_12 = """A camera that moves only updates the model; pictures are drawn from two of the fixed views. Newly
exposed triangles, accumulated, against those that survive foreground culling (Fig. 12b), and the time of an update. In
the table, holes are those of the last frame; times are medians, of a picture of the virtual camera (one eye) and of an
update. The paper gives curves, and in section 4.2 the time of a stereo pair of Gymnasium-a: {} ms ({} ms with the
headset synchronised) without the moving camera, {} ms ({} ms) with it: {} times as long.""".format(
    *(f"{value:.2f}" for pair in published.MOVING_MS for value in pair),
    f"{published.MOVING_MS[1][0] / published.MOVING_MS[0][0]:.2f}",
)
MEANING_13 = """Drawn views without the model; with the model of the fixed cameras (Fig. 13a); with the moving camera
(Fig. 13b and 13c); the truth. Light blue: holes before filling."""
STYLE = """
.plots { display: flex; flex-wrap: wrap; gap: 1rem } .plots svg { flex: 1 1 400px; max-width: 560px; height: auto }
.row + .row { margin-top: .5rem }
figure.part { flex: 0 1 420px } h3 { margin-bottom: .4rem }
.named td:nth-child(2), .named th:nth-child(2) { text-align: left }
"""


@dataclass(slots=True)
class PaperReport:
    """A folder with paper.html, paper.json and pictures/. about: what the figures depend on, by name: machine, commit,
    scale and so on."""

    folder: Path
    about: dict[str, str]
    fixed: list[FixedExperiment] = field(default_factory=list)
    moving: list[MovingExperiment] = field(default_factory=list)

    def write(self) -> Path:
        """Write all files with what has been measured so far, and paper.png, pictures of the first recording as in
        Fig. 9 and 10, for documents; returns the page's path."""
        (self.folder / "pictures").mkdir(parents=True, exist_ok=True)
        figures = json.dumps(self.figures(), indent=1)
        (self.folder / "paper.json").write_text(figures + "\n", "utf-8")
        if self.fixed:
            Image.fromarray(_strip(self.fixed[0])).save(self.folder / "paper.png")
        path = self.folder / "paper.html"
        path.write_text(page("The paper's experiments, repeated", "\n".join(self._parts()), STYLE), "utf-8")
        return path

    def figures(self) -> dict[str, Any]:
        """All figures as plain dictionaries and lists."""
        return {
            "about": self.about,
            "published": {
                "Table 3": [gpu._asdict() | {"ratio": gpu.ratio} for gpu in published.TABLE_3],
                "section 4.1, S-PBS": {name: spbs._asdict() for name, spbs in published.SPBS.items()},
                "Fig. 11b, limit of an update, ms": published.UPDATE_LIMIT_MS,
                "section 4.2, a pair without and with the moving camera, ms": published.MOVING_MS,
            },
            "table_2": [asdict(row) for experiment in self.fixed for row in experiment.summaries()],
            "fixed": [_plain(experiment) for experiment in self.fixed],
            "moving": [experiment.row() | {"moments": _moments(experiment)} for experiment in self.moving],
        }

    def _parts(self) -> Iterator[str]:
        yield "<p>" + "; ".join(f"{escape(name)}: {escape(value)}" for name, value in self.about.items()) + ".</p>"
        if self.fixed:
            yield f"<h2>Table 2: all views against few views with the model</h2><p>{MEANING_2}</p>"
            for each in self.fixed:
                yield f"<h3>{escape(heading(each))}</h3>"
                yield _named(TABLE_2, [table_2_cells(row) for row in each.summaries()])
            yield f"<h2>Table 3: the gain in speed</h2><p>{MEANING_3}</p>"
            yield _named(TABLE_3, table_3_rows(self.fixed))
            yield f"<h2>Fig. 9 and 10: holes</h2><p>{MEANING_9}</p>"
            yield from (self._pictures(each) for each in self.fixed)
            yield f"<h2>Fig. 11: cost</h2><p>{MEANING_11}</p>"
            for each in self.fixed:
                yield f'<h3>{escape(each.recording)}</h3><div class="plots">{"".join(cost_plots(each))}</div>'
            yield f"<h3>S-PBS</h3><p>{MEANING_SPBS}</p>"
            yield _named(("sequence", "quality", "seconds", "triangles"), list(_spbs_rows(self.fixed)))
        if self.moving:
            yield f"<h2>Fig. 12b: a camera that moves</h2><p>{MEANING_12}</p>"
            yield _named(*moving_table(self.moving))
            yield from (f'<div class="plots">{"".join(moving_plots(run))}</div>' for run in self.moving)
            yield f"<h2>Fig. 13: its effect</h2><p>{MEANING_13}</p>"
            yield from (self._moments(each) for each in self.moving)

    def _pictures(self, experiment: FixedExperiment) -> str:
        """Fig. 9 and 10: for each quality a row of all ways before filling, and one after it, with the truth."""
        shown = f"{experiment.recording}, {experiment.shown}, frame {experiment.frames - 1}"
        parts = [f"<h3>{escape(shown)}</h3>"]
        truth = self._figure(f"{experiment.recording}_truth", "truth", to_rgb(experiment.truth))
        for quality in experiment.qualities:
            pictures = [each for each in experiment.pictures if each.quality == quality]
            above, below = [], []
            for each in pictures:
                name = f"{experiment.recording}_{quality}_{each.way}"
                holes = f"{each.way}: {_percent(float(each.warped.holes().mean()))} holes"
                above.append(self._figure(name, holes, tinted(each.warped)))
                below.append(self._figure(f"{name}_filled", f"{each.way}, filled", to_rgb(each.filled.texture)))
            rows = "".join(f'<div class="row">{"".join(row)}{truth}</div>' for row in (above, below))
            parts.append(f"<article><h3>{escape(quality)}</h3>{rows}</article>")
        return "".join(parts)

    def _moments(self, experiment: MovingExperiment) -> str:
        """Fig. 13: the frames with pictures."""
        parts = [f"<article><h3>{escape(experiment.recording)}, {escape(experiment.quality)}</h3>"]
        for moment in experiment.moments:
            if not moment.pictures:
                continue
            camera = experiment.camera
            kinds = ("without the model", "fixed cameras' model", "with the moving camera")
            pictures = (moment.plain[camera], *moment.pictures[camera])
            figures = []
            for kind, picture in zip(kinds, pictures, strict=True):
                told = f"frame {moment.frame}, {kind}: {_percent(float(picture.holes().mean()))} holes"
                name = f"{experiment.recording}_{experiment.quality}_{moment.frame}_{kind}"
                figures.append(self._figure(name, told, tinted(picture)))
            truth = to_rgb(experiment.truths[moment.frame])
            figures.append(self._figure(f"{experiment.recording}_{moment.frame}_truth", "truth", truth))
            parts.append(f'<div class="row">{"".join(figures)}</div>')
        return "".join([*parts, "</article>"])

    def _figure(self, name: str, caption: str, picture: U8) -> str:
        """A picture as a file, and as a small one in the page that is a link to it."""
        file = "pictures/" + "".join(c if c.isalnum() or c in "-." else "_" for c in name) + ".png"
        Image.fromarray(picture).save(self.folder / file)
        uri = data_uri(thumbnail(picture, THUMBNAIL_PX), "JPEG", 88)
        image = f'<a href="{file}"><img src="{uri}" alt="{escape(caption)}"></a>'
        return f'<figure class="part">{image}<figcaption>{escape(caption)}</figcaption></figure>'


def heading(experiment: FixedExperiment) -> str:
    """What a table of an experiment is about."""
    w, h = experiment.eye
    cameras = ", ".join(experiment.cameras)
    return (
        f"{experiment.recording}: {experiment.views} views, {experiment.frames} frames, a pair of {w}x{h} an eye, "
        f"judged by {cameras}"
    )


def table_2_cells(row: Summary) -> list[str]:
    """A row of Table 2 as text, columns as in TABLE_2."""
    decibels = (row.psnr_y, row.iv_psnr, row.psnr_y_filled, row.iv_psnr_filled)
    return [
        row.quality, row.way, f"{row.warped_ms:.1f}", f"{row.filled_ms:.1f}", _percent(row.holes),
        *(f"{value:.2f}" for value in decibels),
    ]  # fmt: skip


def ratio(experiment: FixedExperiment, quality: str) -> tuple[float, float, float]:
    """Milliseconds of a filled pair of all views and of five views with the model, and their ratio (Table 3)."""
    all_views, few = (experiment.summary(quality, WAYS[k].name).filled_ms for k in (0, 2))
    return all_views, few, all_views / few


def table_3_rows(experiments: Sequence[FixedExperiment]) -> list[list[str]]:
    """The rows of Table 3: published ones, then those of each recording and quality."""
    rows = [
        ["Museum", f"published, Table 3: {gpu.name}", _both(gpu.dibr_ms), _both(gpu.ours_ms), f"{gpu.ratio:.2f}"]
        for gpu in published.TABLE_3
    ]
    for each in experiments:
        for quality in each.qualities:
            all_views, few, share = ratio(each, quality)
            rows.append([each.recording, quality, f"{all_views:.1f}", f"{few:.1f}", f"{share:.2f}"])
    return rows


def moving_table(experiments: Sequence[MovingExperiment]) -> tuple[tuple[str, ...], list[list[str]]]:
    """Titles and rows of the experiments with a moving camera."""
    titles = (
        "sequence", "quality", "frames", "camera", "holes, no model", "fixed cameras", "with the moving one",
        "picture, ms", "with it", "update, ms", "with it", "newly exposed", "P-PBS",
    )  # fmt: skip
    rows = []
    for row in (each.row() for each in experiments):
        holes = [_percent(float(row[name])) for name in ("holes_plain", "holes_fixed", "holes_moving")]
        names = ("picture_fixed_ms", "picture_moving_ms", "update_fixed_ms", "update_moving_ms")
        times = [f"{row[name]:.1f}" for name in names]
        of = [str(row[name]) for name in ("recording", "quality", "frames", "camera")]
        rows.append([*of, *holes, *times, f"{row['exposed']:,}", f"{row['p_pbs']:,}"])
    return titles, rows


def _strip(experiment: FixedExperiment) -> U8:  # [h, w, 3]
    """All views, five without the model, five with it, and the truth, next to each other; holes are light blue."""
    quality = experiment.qualities[-1]
    found = {each.way: tinted(each.warped) for each in experiment.pictures if each.quality == quality}
    return np.concatenate([*(found[way.name] for way in WAYS[:3]), to_rgb(experiment.truth)], axis=1)


def _spbs_rows(experiments: Sequence[FixedExperiment]) -> Iterator[list[str]]:
    for each in experiments:
        if each.recording in published.SPBS:
            spbs = published.SPBS[each.recording]
            cells = (f"{spbs.seconds:.2f}", f"{spbs.triangles:,.0f}")
            yield [each.recording, "published, section 4.1: 3090, two of them", *cells]
        for quality in each.qualities:
            first = next(cost for cost in each.costs if cost.quality == quality)
            yield [each.recording, quality, f"{first.update_ms / 1e3:.2f}", f"{first.s_pbs:,}"]


def _named(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose first two columns are names."""
    return f'<div class="named">{table(titles, rows)}</div>'


def _both(pair: tuple[float, float]) -> str:
    return f"{pair[0]:.2f} ({pair[1]:.2f})"


def _percent(value: float) -> str:
    return f"{100 * value:.3f} %"


def _plain(experiment: FixedExperiment) -> dict[str, Any]:
    names = ("recording", "qualities", "eye", "views", "frames", "cameras", "shown")
    lists = {name: [asdict(row) for row in getattr(experiment, name)] for name in ("judged", "times", "costs")}
    return {name: getattr(experiment, name) for name in names} | lists


def _moments(experiment: MovingExperiment) -> list[dict[str, Any]]:
    names = ("frame", "update_ms", "asked", "added", "culled", "p_pbs", "captures", "holes", "exposed")
    return [{name: getattr(moment, name) for name in names} for moment in experiment.moments]
