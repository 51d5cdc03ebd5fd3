"""What kernels that search near points share with their callbacks: a search's context, and the nearest place on a
triangle."""

from __future__ import annotations

from ..base.jit import inlined

__all__ = [
    "CONTEXT_SIZE", "COUNT", "INVALID", "LIST", "MOST_COUNTED", "ROOM", "SURFACES", "TRIANGLE", "closest_on",
]  # fmt: skip


# The context of a search is int64 [CONTEXT_SIZE]: addresses of the tables of surfaces (`surfaces`) and of flags
# (`queried.Queried`); the nearest triangle so far (geometry in the low half, primitive in the high one, -1: none), or
# how many triangles the sphere touches; and the place of a list of pairs int32 of them, and how many pairs it holds.
SURFACES, INVALID, TRIANGLE, COUNT, LIST, ROOM = range(6)
CONTEXT_SIZE = 6
MOST_COUNTED = 4096  # triangles of a sphere: one that holds the whole room takes no longer than this many


@inlined
def _share(part: float, whole: float) -> float:
    """part / whole, 0 where the whole is nothing."""
    return part / whole if whole > 0.0 else 0.0


@inlined
def closest_on(
    px: float, py: float, pz: float, a: tuple[float, float, float], b: tuple[float, float, float],
    c: tuple[float, float, float],
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """The place on a triangle that is nearest to a point, and its weights of the corners b and c (Ericson, Real-Time
    Collision Detection, 5.1.5)."""
    abx, aby, abz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    acx, acy, acz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    apx, apy, apz = px - a[0], py - a[1], pz - a[2]
    bpx, bpy, bpz = px - b[0], py - b[1], pz - b[2]
    cpx, cpy, cpz = px - c[0], py - c[1], pz - c[2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = _share(d1, d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, _share(d2, d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = _share(d4 - d3, (d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = _share(vb, va + vb + vc), _share(vc, va + vb + vc)
    return a[0] + v * abx + w * acx, a[1] + v * aby + w * acy, a[2] + v * abz + w * acz, v, w
