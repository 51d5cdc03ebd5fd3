"""Probable background images (section 3.4.1): their imaginary camera, and their rendering."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.prepared_view import PreparedView, ViewTable
from ..kernels.background.uncovered import CELL, mark_uncovered
from ..kernels.base.tolerance import Delta
from ..rig.camera import Camera, Equirectangular, Perspective
from ..rig.depth import DepthCoding
from ..rig.frame import Texture, View
from ..rig.viewer import StereoView
from .capture import Captures, Present
from .pbs import ProbableBackgroundSurface

__all__ = ["MARGIN_RAD", "BackgroundImage", "enlarged", "imaginary_camera", "render_pbi", "uncovered_cells"]

MARGIN_RAD = math.radians(3.0)  # a head's turn until the next PBI: 90 degrees per second at 30 Hz
_WIDEST = math.tan(math.radians(80.0))  # a frustum is not widened beyond this
_NARROWEST = 0.1  # least tangent of a side that counts for the distance of the camera behind the head


@dataclass(frozen=True, slots=True)
class BackgroundImage:
    """The background model seen from an imaginary camera: a view like any other, with depth code 0 in holes."""

    view: View
    rays: int  # cast for it


def imaginary_camera(
    view: StereoView, head_speed_m_s: float, f_vin: float, depth: DepthCoding, scale: float = 1.0,
    margin_rad: float = MARGIN_RAD,
) -> Camera:  # fmt: skip
    """The camera just behind a head, whose frustum contains the frusta of both eyes until the next video frame.

    `head_speed_m_s` and `f_vin` (frames per second) give the distance that the head may move until then. `scale`: PBI
    pixels for each pixel of an eye; `margin_rad`: how far it sees beyond the frusta (which may be asymmetric) on each
    side. Raises ValueError for a negative speed, or an f_vin or scale that is not positive.
    """
    if not (head_speed_m_s >= 0 and f_vin > 0 and scale > 0):
        raise ValueError(
            f"head speed, f_vin, scale: {(head_speed_m_s, f_vin, scale)!r}: expected 0 or more, and positive numbers"
        )
    sides = [max(pair) for pair in zip(_tangents(view.left), _tangents(view.right), strict=True)]
    left, right, top, bottom = (_widened(side, margin_rad) for side in sides)
    travel = head_speed_m_s / f_vin
    # From b metres behind the head, a side with tangent t is t * b metres from the axis at the eyes' depth, and the
    # eyes must be inside of it there.
    across = 0.5 * view.ipd + travel
    behind = travel + max(across / max(min(left, right), _NARROWEST), travel / max(min(top, bottom), _NARROWEST))
    fx = scale * max(abs(view.left.fx), abs(view.right.fx))
    fy = scale * max(abs(view.left.fy), abs(view.right.fy))
    projection = _frustum(fx, fy, left, right, top, bottom)
    return Camera("imaginary", projection, view.pose.translated((-behind, 0.0, 0.0)), depth)


def enlarged(camera: Camera, depth: DepthCoding, scale: float = 1.0, margin_rad: float = MARGIN_RAD) -> Camera:
    """A camera at the same place that sees `margin_rad` more on all sides (perspective or equirectangular).

    `depth`: its depth coding; `scale`: its pixels for each of the given camera's.
    """
    projection = camera.projection
    wide: Perspective | Equirectangular
    if isinstance(projection, Perspective):
        left, right, top, bottom = (_widened(side, margin_rad) for side in _tangents(projection))
        wide = _frustum(scale * abs(projection.fx), scale * abs(projection.fy), left, right, top, bottom)
    else:
        wide = _wider_sphere(projection, scale, margin_rad)
    return dataclasses.replace(camera, name="imaginary", projection=wide, depth=depth, texture_bits=10)


def uncovered_cells(
    camera: Camera, views: Sequence[PreparedView], reach_m: float, origin: npt.ArrayLike
) -> npt.NDArray[np.uint8]:  # [ceil(h / CELL), ceil(w / CELL)]
    """Cells of an imaginary camera's picture in which the drawn views may leave holes for eyes up to `reach_m` metres
    away from that camera: 1, the others 0. A PBI is of use only there. `origin`: the scene's, metres in the world."""
    wanted = np.empty([math.ceil(size / CELL) for size in (camera.height, camera.width)], np.uint8)
    table = ViewTable(views, drawn=len(views))
    mark_uncovered(table.rows, table.addresses, camera.packed(origin), reach_m, wanted)
    return wanted


def render_pbi(
    pbs: ProbableBackgroundSurface, captures: Captures, camera: Camera, origin: npt.ArrayLike, present: Present,
    delta: Delta, *, sparse: bool = True, wanted: npt.NDArray[np.uint8] | None = None,
) -> BackgroundImage:  # fmt: skip
    """The PBS as a camera sees it, with the colours of its surfaces' captures; code 0 where it has holes.

    It shows the farthest surface, or the nearest that stands (see `capture.Present`). origin: the scene's, metres in
    the world. `sparse`: rays are cast through every second pixel, and through the pixels between only where those rays
    do not meet one plane; otherwise rays are cast through every pixel. `wanted` (`uncovered_cells`): cells to render,
    the rest stays a hole; None: all. Raises ValueError if the camera's depth coding has no invalid code.
    """
    if not camera.depth.has_invalid:
        raise ValueError(f"camera {camera.name}: depth coding {camera.depth}: expected one with invalid codes")
    h, w = camera.height, camera.width
    chroma = ((h + 1) // 2, (w + 1) // 2)
    texture = Texture(*(np.empty(shape, np.uint16) for shape in ((h, w), chroma, chroma)))
    view = View(camera, texture, np.empty((h, w), np.uint16))
    cells = np.empty((0, 0), np.uint8) if wanted is None else wanted
    rays = pbs.tracer.render_pbi(
        view, camera.packed(origin), captures, present, delta, sparse=sparse, wanted=cells
    )
    return BackgroundImage(view, rays)


def _wider_sphere(projection: Equirectangular, scale: float, margin_rad: float) -> Equirectangular:
    (left, right), (bottom, top) = projection.hor_range, projection.ver_range
    if right - left + 2 * margin_rad < 2 * math.pi:
        left, right = left - margin_rad, right + margin_rad
    else:
        middle = 0.5 * (left + right)
        left, right = middle - math.pi, middle + math.pi
    bottom, top = max(bottom - margin_rad, -math.pi / 2), min(top + margin_rad, math.pi / 2)
    columns = projection.width * (right - left) / (projection.hor_range[1] - projection.hor_range[0])
    rows = projection.height * (top - bottom) / (projection.ver_range[1] - projection.ver_range[0])
    return Equirectangular(_even(scale * columns), _even(scale * rows), (left, right), (bottom, top))


def _tangents(projection: Perspective) -> tuple[float, float, float, float]:
    """Tangents of the half angles to the left, right, top and bottom, positive outwards."""
    y = (projection.cx / projection.fx, (projection.cx - projection.width) / projection.fx)
    z = (projection.cy / projection.fy, (projection.cy - projection.height) / projection.fy)
    return max(y), -min(y), max(z), -min(z)


def _widened(tangent: float, margin_rad: float) -> float:
    angle = min(math.atan(tangent) + margin_rad, math.atan(_WIDEST))
    return max(math.tan(angle), tangent)


def _frustum(fx: float, fy: float, left: float, right: float, top: float, bottom: float) -> Perspective:
    """Projection with at least the given focal lengths in pixels, of a size rounded up to even numbers."""
    width, height = _even(fx * (left + right)), _even(fy * (top + bottom))
    return Perspective.from_tangents(width, height, left, right, top, bottom)


def _even(size: float) -> int:
    return max(4, 2 * math.ceil(size / 2))  # a view has at least 4 x 4 pixels
