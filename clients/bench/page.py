"""What the HTML pages of reports share: one file without scripts, which opens from disk."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from io import BytesIO

import numpy as np
from farside.engine.support.array_types import U8
from PIL import Image

__all__ = ["data_uri", "page", "table", "thumbnail"]

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 1500px; padding: 0 1rem; color: #1c2530 }
h1, h2 { line-height: 1.2 } h2 { margin-top: 2.5rem } p { max-width: 60rem; color: #46525f }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #e3e7ec; white-space: nowrap }
th { background: #f3f5f8; position: sticky; top: 0 } td:first-child, th:first-child { text-align: left }
tr:hover td { background: #f8fafc } .wide { overflow-x: auto }
article { margin: 1.2rem 0; padding-top: .6rem; border-top: 1px solid #cfd6de } article h3 { margin: 0 0 .3rem }
article small { color: #5b6875; font-weight: normal }
.row { display: flex; gap: .5rem; align-items: flex-start } figure { margin: 0; flex: 1 1 0; min-width: 0 }
figure img { width: 100%; display: block; background: #111 } figcaption { font-size: 12px; color: #5b6875 }
figure.spot { flex: 0 0 192px } figure.spot img { image-rendering: pixelated; width: 192px }
"""


def page(title: str, body: str, style: str = "") -> str:
    """A whole page; `style`: rules of its own."""
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{escape(title)}</title><style>{STYLE}{style}</style></head><body>
<h1>{escape(title)}</h1>
{body}
</body></html>
"""


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of plain text."""
    head = "".join(f"<th>{escape(title)}</th>" for title in titles)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>\n" for row in rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table></div>'


def thumbnail(picture: U8, side_px: int) -> U8:
    """A picture [h, w, 3] scaled down so that no side is longer than `side_px`."""
    image = Image.fromarray(picture)
    image.thumbnail((side_px, side_px))
    return np.asarray(image)


def data_uri(picture: U8, kind: str, quality: int = 80) -> str:
    """A picture [h, w, 3] as a data URI. kind: JPEG, of the given quality, or PNG."""
    data = BytesIO()
    Image.fromarray(np.ascontiguousarray(picture)).save(data, kind, quality=quality)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(data.getvalue()).decode('ascii')}"
