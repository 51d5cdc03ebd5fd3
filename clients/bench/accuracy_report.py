"""The figures of `accuracy` as CSV, JSON and one HTML page with pictures, the worst first."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
import numpy.typing as npt
from farside.engine.evaluation.accuracy import Judged, Sample, summarise
from farside.engine.rig.frame import Texture
from farside.engine.rig.texture import to_rgb
from PIL import Image

from .page import data_uri, page, table, thumbnail

__all__ = ["AccuracyReport", "summary_table"]

Rgb = npt.NDArray[np.uint8]  # [h, w, 3]

AMPLIFIED = 4  # factor by which differences are amplified
THUMBNAIL_PX = 300
SPOT_PX = 48  # side of the square around the worst place
SHOWN = 24  # most pictures of a sequence on the page; files are written for all pictures


def _percent(value: float) -> str:
    return f"{100 * value:.3f} %"


# The summary's columns: key, title, formatting of a value.
SUMMARY: tuple[tuple[str, str, Callable[..., str]], ...] = (
    ("sequence", "sequence", str),
    ("quality", "quality", str),
    ("views", "views", str),
    ("model", "model", lambda on: "on" if on else "off"),
    ("psnr_y", "PSNR-Y", "{:.2f}".format),
    ("ws_psnr_y", "WS-PSNR-Y", "{:.2f}".format),
    ("iv_psnr", "IV-PSNR", "{:.2f}".format),
    ("worst", "worst IV", "{:.2f}".format),
    ("ssim", "SSIM", "{:.4f}".format),
    ("ms_ssim", "MS-SSIM", "{:.4f}".format),
    ("iv_ssim", "IV-SSIM", "{:.4f}".format),
    ("iv_ms_ssim", "IV-MS-SSIM", "{:.4f}".format),
    ("holes_warped", "holes", _percent),
    ("holes_backdrop", "after backdrop", _percent),
    ("ghosts", "ghosts", _percent),
    ("flicker", "flicker", "{:.2f}".format),
    ("bias_px", "bias px", "{:+.3f}".format),
    ("roughness_px", "rough px", "{:.3f}".format),
    ("truth_roughness_px", "(truth)", "{:.3f}".format),
    ("thin", "thin", lambda share: f"{100 * share:.1f} %"),
)

MEANING = """Means over cameras and frames. PSNR in dB; WS-PSNR for equirectangular cameras only; worst IV: the lowest
IV-PSNR of a picture. Holes: pixels that no view drew; after backdrop: holes that the background model did not close
either. Ghosts: pixels where the model is nearer than both the background and the present scene. Flicker: change from
the previous frame, divided by that of the truth, where the truth keeps still. Bias: by how much silhouettes reach too
far out (above 0: fattened) or not far enough; rough: RMS deviation from their smooth course (serration), next to that
of the truth itself, whose pixels have four samples. Thin: the part of structures up to two pixels wide that is rendered
at their depth. Ghosts, bias, rough and thin: twins only."""



@dataclass(frozen=True, slots=True)
class _Entry:
    """A judged picture on the page: its figures, and its pictures as captions, linked files and data URIs."""

    sample: Sample
    pictures: list[tuple[str, str, str]]
    spots: list[tuple[str, str]]


class AccuracyReport:
    """A folder to which judged pictures are added; `finish` writes accuracy.csv, accuracy.json and index.html."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._entries: list[_Entry] = []
        folder.mkdir(parents=True, exist_ok=True)

    def add(self, judged: Judged) -> None:
        """Write a picture's PNG files and keep its figures and thumbnails."""
        sample, case = judged.sample, judged.sample.case
        truth, ours = to_rgb(judged.truth), to_rgb(judged.picture.texture)
        of = re.sub(r"[^\w.-]", "_", f"{case.sequence}_{case.camera}_f{sample.frame:03d}")
        made = f"{of}_{case.quality}_v{case.views}_{'model' if case.model else 'plain'}"
        difference = np.minimum(AMPLIFIED * np.abs(truth.astype(np.int16) - ours), 255).astype(np.uint8)
        holes = _hole_picture(ours, judged.picture.holes(), judged.picture.holes(warped=True))
        pictures = [
            ("truth", f"{of}_truth.png", truth),
            ("ours", f"{made}.png", ours),
            (f"difference, {AMPLIFIED} times", f"{made}_difference.png", difference),
            ("holes: red filled, blue backdrop", f"{made}_holes.png", holes),
        ]
        for _caption, name, picture in pictures:
            Image.fromarray(picture).save(self.folder / name)
        place = _worst_place(judged.truth, judged.picture.texture)
        spots = [(caption, data_uri(picture[place], "PNG")) for caption, _name, picture in pictures[:2]]
        shown = [
            (caption, name, data_uri(thumbnail(picture, THUMBNAIL_PX), "JPEG")) for caption, name, picture in pictures
        ]
        self._entries.append(_Entry(sample, shown, spots))

    def finish(self, title: str) -> Path:
        """Write the three files; returns the page's path. Raises ValueError if no picture was added."""
        if not self._entries:
            raise ValueError("report: no picture: expected at least one")
        samples = [entry.sample for entry in self._entries]
        rows = [sample.row() for sample in samples]
        with (self.folder / "accuracy.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        figures = {"title": title, "summary": summarise(samples), "samples": rows}
        (self.folder / "accuracy.json").write_text(json.dumps(figures, indent=1) + "\n", "utf-8")
        path = self.folder / "index.html"
        path.write_text(_page(title, self._entries), "utf-8")
        return path


def summary_table(samples: Sequence[Sample]) -> tuple[list[str], list[list[str]]]:
    """The titles and the rows of `summarise` as text, without columns that are empty in every row."""
    rows = summarise(samples)
    columns = [column for column in SUMMARY if any(row[column[0]] is not None for row in rows)]
    cells = [["" if row[key] is None else form(row[key]) for key, _title, form in columns] for row in rows]
    return [title for _key, title, _form in columns], cells


def _hole_picture(picture: Rgb, holes: npt.NDArray[np.bool_], warped: npt.NDArray[np.bool_]) -> Rgb:
    """The picture in dark grey; pixels that only filling coloured are red, pixels that only the backdrop drew blue."""
    out = np.repeat((picture.mean(axis=2, keepdims=True) / 3).astype(np.uint8), 3, axis=2)
    out[warped] = (90, 160, 255)
    out[holes] = (255, 60, 60)
    return out


def _worst_place(truth: Texture, ours: Texture) -> tuple[slice, slice]:
    """The square of SPOT_PX with the greatest squared error of luma, among squares half a side apart."""
    h, w = truth.y.shape
    squared = (truth.y.astype(np.float64) - ours.y) ** 2
    tops, lefts = (range(0, max(1, size - SPOT_PX + 1), SPOT_PX // 2) for size in (h, w))
    places = [(slice(top, top + SPOT_PX), slice(left, left + SPOT_PX)) for top in tops for left in lefts]
    return max(places, key=lambda place: float(squared[place].sum()))


def _page(title: str, entries: Sequence[_Entry]) -> str:
    samples = [entry.sample for entry in entries]
    worst_first = sorted(entries, key=lambda entry: entry.sample.iv_psnr)
    sequences = dict.fromkeys(entry.sample.case.sequence for entry in worst_first)
    sheets = (_sheet(name, [e for e in worst_first if e.sample.case.sequence == name]) for name in sequences)
    body = f"""{table(*summary_table(samples))}
<p>{MEANING}</p>
{"".join(sheets)}
<h2>All pictures</h2>
{_all(worst_first)}"""
    return page(title, body)


def _sheet(name: str, entries: Sequence[_Entry]) -> str:
    kept = f", the {SHOWN} worst of {len(entries)}" if len(entries) > SHOWN else ""
    return f"<h2>{escape(name)}: worst first{kept}</h2>" + "".join(_article(entry) for entry in entries[:SHOWN])


def _article(entry: _Entry) -> str:
    sample, case = entry.sample, entry.sample.case
    figures = [f"SSIM {sample.ssim:.4f}", f"holes {_percent(sample.holes_backdrop)}"]
    if sample.bias_px is not None:
        figures.append(f"silhouettes {sample.bias_px:+.2f} px")
    pictures = "".join(
        f'<figure><a href="{escape(file)}"><img src="{uri}" alt=""></a><figcaption>{caption}</figcaption></figure>'
        for caption, file, uri in entry.pictures
    )
    spots = "".join(
        f'<figure class="spot"><img src="{uri}" alt=""><figcaption>worst place, {caption}</figcaption></figure>'
        for caption, uri in entry.spots
    )
    return f"""<article><h3>{sample.iv_psnr:.2f} dB <small>{escape(_label(sample))}, {case.quality};
PSNR-Y {sample.psnr_y:.2f} dB, {", ".join(figures)}</small></h3><div class="row">{pictures}{spots}</div></article>
"""


def _label(sample: Sample) -> str:
    case = sample.case
    return f"{case.camera}, frame {sample.frame}, {case.views} views, model {'on' if case.model else 'off'}"


def _all(entries: Sequence[_Entry]) -> str:
    rows = [entry.sample.row() for entry in entries]
    return table(list(rows[0]), [[_plain(value) for value in row.values()] for row in rows])


def _plain(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4f}"
    return "" if value is None else str(value)
