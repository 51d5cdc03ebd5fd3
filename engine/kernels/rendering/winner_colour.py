"""The colour of a pixel on which no view agrees: the colour of the view that drew it."""

from __future__ import annotations

from ...support.array_types import F64, I64
from ...support.packed import HEIGHT, WIDTH, WRAPS
from ..base.jit import inlined, serial
from ..base.memory import load_u16
from ..base.project import project_point, unproject_point
from ..base.tone import toned
from ..base.view_table import CB, CODES, CR, EDGE, INVALID, OFFSET, STEP, SUBSAMPLED, TOLERANCE, TONE, Views, Y

__all__ = ["shade_by_winner"]

_FARTHEST_PX = 1e15  # a point farther from a view's picture has no meaningful place in it


@inlined
def _chroma_at(row: F64, addresses: I64, x: int, y: int) -> tuple[float, float]:
    """The chroma sample of a view's pixel."""
    shift = int(row[SUBSAMPLED])
    sample = (y >> shift) * ((int(row[WIDTH]) + shift) >> shift) + (x >> shift)
    return float(load_u16(addresses[CB], sample)), float(load_u16(addresses[CR], sample))


@inlined
def _colour_of_winner(
    row: F64, addresses: I64, u: float, v: float, code: float
) -> tuple[float, float, float]:
    """Colour of a view at (u, v): of those of the four texels round it with about that depth code, or else of the texel
    nearest in depth, which drew the pixel."""
    width, height = int(row[WIDTH]), int(row[HEIGHT])
    if not (abs(u) < _FARTHEST_PX and abs(v) < _FARTHEST_PX):  # NaN, or too large for an integer
        u, v = 0.0, 0.0
    y = min(max(v - 0.5, 0.0), height - 1.0)
    iy = min(int(y), max(height - 2, 0))
    if row[WRAPS] > 0.0:
        x = u - 0.5 if u >= 0.5 else u - 0.5 + width
        x0 = min(int(x), width - 1)
        x1 = x0 + 1 if x0 + 1 < width else 0
    else:
        x = min(max(u - 0.5, 0.0), width - 1.0)
        x0 = min(int(x), max(width - 2, 0))
        x1 = min(x0 + 1, width - 1)
    fx, fy = x - x0, y - iy
    below = width if iy + 1 < height else 0
    a, b = iy * width + x0, iy * width + x1
    c, d = a + below, b + below
    codes = addresses[CODES]
    ca, cb, cc, cd = load_u16(codes, a), load_u16(codes, b), load_u16(codes, c), load_u16(codes, d)
    wa, wb, wc, wd = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    low, high = min(min(ca, cb), min(cc, cd)), max(max(ca, cb), max(cc, cd))
    invalid = row[INVALID] > 0.0
    if high - low > row[EDGE] or (low == 0 and invalid):
        # There is an edge between the texels: take only those of the wanted surface.
        limit = 0.5 * row[EDGE] + row[TOLERANCE]
        ka = wa if abs(ca - code) <= limit and not (invalid and ca == 0) else 0.0
        kb = wb if abs(cb - code) <= limit and not (invalid and cb == 0) else 0.0
        kc = wc if abs(cc - code) <= limit and not (invalid and cc == 0) else 0.0
        kd = wd if abs(cd - code) <= limit and not (invalid and cd == 0) else 0.0
        if ka + kb + kc + kd < 1e-3:
            best = min(min(abs(ca - code), abs(cb - code)), min(abs(cc - code), abs(cd - code)))
            ka = 1.0 if abs(ca - code) == best else 0.0
            kb = 1.0 if abs(cb - code) == best else 0.0
            kc = 1.0 if abs(cc - code) == best else 0.0
            kd = 1.0 if abs(cd - code) == best else 0.0
        inverse = 1.0 / (ka + kb + kc + kd)
        wa, wb, wc, wd = ka * inverse, kb * inverse, kc * inverse, kd * inverse
        # Chroma is taken at the middle of the chosen texels.
        u = x0 + 0.5 + wb + wd
        v = iy + 0.5 + wc + wd
    y_ = addresses[Y]
    luma = wa * load_u16(y_, a) + wb * load_u16(y_, b) + wc * load_u16(y_, c) + wd * load_u16(y_, d)
    b, r = _chroma_at(row, addresses, min(max(int(u), 0), width - 1), min(max(int(v), 0), height - 1))
    return luma, b, r


@serial
def shade_by_winner(
    views: Views, k: int, camera: F64, y: int, x: int, disparity: float
) -> tuple[float, float, float]:
    """Colour of a pixel from view k, which drew it, regardless of the depth that the view measured there."""
    row = views.table[k]
    px, py, pz = unproject_point(camera, x + 0.5, y + 0.5, 1.0 / disparity)
    u, v, depth = project_point(row, px, py, pz)
    code = (1.0 / depth - row[OFFSET]) / row[STEP]
    luma, b, r = _colour_of_winner(row, views.addresses[k], u, v, code)
    return toned(row[TONE:], luma, b, r)
