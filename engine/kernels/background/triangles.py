"""A triangle of a surface, through the table of surfaces (`surfaces`)."""

from __future__ import annotations

from ...support.array_types import I64
from ..base.jit import inlined, serial
from ..base.memory import load_f32, load_u32
from .surfaces import POINTS, TRIANGLES, UV

__all__ = ["corners_of", "place_in_picture", "point_of"]


@inlined
def corners_of(surface: I64, primitive: int) -> tuple[int, int, int]:
    """The numbers of a triangle's points."""
    triangles, first = surface[TRIANGLES], 3 * primitive
    return load_u32(triangles, first), load_u32(triangles, first + 1), load_u32(triangles, first + 2)


@inlined
def point_of(surface: I64, number: int) -> tuple[float, float, float]:
    """A point of a surface."""
    points = surface[POINTS]
    return load_f32(points, 3 * number), load_f32(points, 3 * number + 1), load_f32(points, 3 * number + 2)


@serial
def place_in_picture(surface: I64, primitive: int, hu: float, hv: float) -> tuple[float, float]:
    """Picture coordinates at a triangle's barycentric (hu, hv)."""
    a, b, c = corners_of(surface, primitive)
    uv, wa = surface[UV], 1.0 - hu - hv
    return (
        wa * load_f32(uv, 2 * a) + hu * load_f32(uv, 2 * b) + hv * load_f32(uv, 2 * c),
        wa * load_f32(uv, 2 * a + 1) + hu * load_f32(uv, 2 * b + 1) + hv * load_f32(uv, 2 * c + 1),
    )
