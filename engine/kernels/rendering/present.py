"""Where a present view's surface crosses a ray of the virtual camera: a search in its depth, without its mesh."""

from __future__ import annotations

from ...support.array_types import F64
from ...support.packed import HEIGHT, WIDTH
from ..base.jit import inlined_late
from ..base.memory import load_u16
from ..base.project import project_point, unproject_point
from ..base.view_table import EDGE, INVALID, OFFSET, STEP, TOLERANCE

__all__ = ["present_depth"]

# Each step takes the depth that the view measured at the image of the last guess. This converges in one or two steps if
# the view is near the eye, and does not converge if the ray passes by the surface.
_STEPS = 4
# A guess is a crossing if it differs from the depth that the view measured there by less than this share of the views'
# tolerance: about half a pixel of parallax. With the full tolerance, one in 13 of such pixels would show a surface that
# its ray passes by.
_CROSSES = 0.125


@inlined_late
def present_depth(row: F64, codes: int, camera: F64, x: int, y: int, depth: float) -> float:
    """The depth at which a view's surface crosses a pixel's ray, searched from the guess `depth` on; 0: none is found.

    A crossing counts if the four texels round its image are one surface, and the view measured the same depth there.
    `row` and `codes`: the view, see `kernels.base.view_table`; `camera`: the packed virtual camera; depths are along
    its rays, metres.
    """
    width, height = int(row[WIDTH]), int(row[HEIGHT])
    for _ in range(_STEPS):
        px, py, pz = unproject_point(camera, x + 0.5, y + 0.5, depth)
        u, v, depth_in_view = project_point(row, px, py, pz)
        if not (depth_in_view > 0.0 and u >= 0.5 and v >= 0.5 and u < width - 0.5 and v < height - 0.5):
            return 0.0
        left, top = int(u - 0.5), int(v - 0.5)
        fx, fy, texel = u - 0.5 - left, v - 0.5 - top, top * width + left
        a, b = load_u16(codes, texel), load_u16(codes, texel + 1)
        c, d = load_u16(codes, texel + width), load_u16(codes, texel + width + 1)
        low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
        if low == 0 and row[INVALID] > 0.0:
            return 0.0
        one = high - low <= row[EDGE]
        code = (1 - fy) * ((1 - fx) * a + fx * b) + fy * ((1 - fx) * c + fx * d) if one else float(high)
        sx, sy, sz = unproject_point(row, u, v, 1.0 / (row[OFFSET] + row[STEP] * code))
        _u, _v, depth = project_point(camera, sx, sy, sz)
        if not depth > 0.0:
            return 0.0
        if one and abs((1.0 / depth_in_view - row[OFFSET]) / row[STEP] - code) <= _CROSSES * row[TOLERANCE]:
            return depth
    return 0.0
