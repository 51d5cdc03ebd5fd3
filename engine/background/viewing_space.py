"""The viewing space: a ball in which heads stay. Nobody can see a surface that faces away from the whole ball, or that
is hidden from all of it."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..geometry.mesh import Mesh
from ..kernels.background.hidden import CELL, flag_unseen, spread_seen
from ..kernels.base.tolerance import Delta
from ..rig.camera import Camera, Equirectangular, Pose
from ..rig.depth import DepthCoding
from ..support.array_types import F64
from .capture import Captures, Present
from .pbs import ProbableBackgroundSurface, Surface
from .report import UpdateReport

__all__ = ["ViewingSpace", "flag_hidden"]


_ALL_ROUND = Equirectangular(8192, 4096, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))
_FEW = 8  # every eighth eye is asked first
_INSIDE = 0.5  # distance, as a share of the radius, of the eyes between the middle and the surface of the ball


@dataclasses.dataclass(frozen=True, slots=True)
class ViewingSpace:
    """A ball; its middle is relative to the scene's origin, lengths are in metres."""

    middle: tuple[float, float, float]
    radius: float

    @classmethod
    def relative_to(cls, origin: npt.ArrayLike, ball: tuple[float, float, float, float]) -> ViewingSpace:
        """The ball with x, y, z and radius in the world, relative to `origin`; metres."""
        x, y, z = np.subtract(ball[:3], origin).tolist()
        return cls((x, y, z), ball[3])

    def sees(self, mesh: Mesh) -> npt.NDArray[np.bool_]:  # [m]
        """Which triangles show their front to some point of the ball, regardless of what hides them.

        A point sees the front if it is on that side of the triangle's plane. The ball reaches one radius farther to
        that side than its middle. Triangles without an area are seen by nobody.
        """
        a, b, c = (mesh.points[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
        normal = np.cross(b - a, c - a)  # towards the camera that saw it: it sees triangles wound counterclockwise
        height = np.einsum("ij,ij->i", normal, np.array(self.middle) - a)
        seen: npt.NDArray[np.bool_] = height > -self.radius * np.linalg.norm(normal, axis=1)
        return seen

    def seen(self, mesh: Mesh) -> Mesh:
        """A mesh without the triangles that face away from the whole ball; in one block if there are any."""
        faces = self.sees(mesh)
        return mesh if faces.all() else mesh.only(faces)

    def eyes(self) -> F64:  # [n, CAMERA_SIZE]
        """Packed cameras with a full view: in the middle, halfway out, and at the corners of a polyhedron that contains
        the ball. If a straight edge hides something from all corners, it hides it from the whole ball."""
        near, around = _icosahedron(), _geodesic()
        offsets = np.concatenate([np.zeros((1, 3)), _INSIDE * near, around])
        places = np.unique(np.array(self.middle) + self.radius * offsets, axis=0)
        coding = DepthCoding(1.0, 2.0)  # they record nothing
        return np.stack([Camera("eye", _ALL_ROUND, Pose((x, y, z)), coding).packed() for x, y, z in places.tolist()])


def flag_hidden(
    space: ViewingSpace, pbs: ProbableBackgroundSurface, surfaces: Sequence[Surface], captures: Captures,
    present: Present, delta: Delta, report: UpdateReport,
) -> None:  # fmt: skip
    """Flags triangles of surfaces as invalid if other background hides them from the whole space, and reports them.
    The surfaces stem from `captures` of their cameras, or from atlases.

    A triangle stays if one of the space's eyes sees (see `capture.Present`) one of its sample points, or a surface less
    than delta before that point; so do all triangles within CELL to 2 CELL pixels of it in its picture.

    The test samples, so it can wrongly drop (a) a surface that heads between the eyes see only through a gap, farther
    than those pixels from the gap's sides, and (b) a surface hidden by something that counts as background and later
    leaves, where the views do not show the surface then. Both appear as holes in the background. A dropped surface also
    cannot prove that a new object in front of it is foreground.
    """
    eyes, found = space.eyes(), []
    for surface in surfaces:
        width, height, wraps = captures.extent(surface.capture)
        seen = np.zeros(len(surface.invalid), np.uint8)
        cells = np.zeros((math.ceil(height / CELL), math.ceil(width / CELL)), np.uint8)
        for asked in (eyes[::_FEW], eyes):  # a few eyes see most triangles, and their neighbours need no test then
            report.rays += pbs.tracer.mark_seen(asked, surface, present, delta, wraps, cells, seen)
            spread_seen(surface.mesh.uv, surface.mesh.triangles, seen, wraps, cells)
        found.append((surface, wraps, cells))
    with pbs.lock:
        for surface, wraps, cells in found:  # only now, as hidden triangles must hide others during the test
            mesh = surface.mesh
            report.hidden += int(flag_unseen(mesh.uv, mesh.triangles, wraps, cells, surface.invalid))


def _icosahedron() -> F64:  # [12, 3]
    """The corners of an icosahedron, on the unit sphere."""
    golden = 0.5 * (1.0 + math.sqrt(5.0))
    signs = itertools.product((-1.0, 1.0), (-golden, golden))
    corners = np.array([np.roll((0.0, a, b), k) for a, b in signs for k in range(3)])
    return corners / math.hypot(1.0, golden)


def _geodesic() -> F64:  # [42, 3]
    """Corners of a polyhedron of 80 triangles that contains the unit ball: an icosahedron's, and one over each edge."""
    corners = _icosahedron()
    edge = np.linalg.norm(corners[:, None] - corners, axis=-1)
    a, b = np.nonzero(np.triu(edge < 1.01 * edge[edge > 0.0].min(), 1))
    over = (corners[a] + corners[b]) / np.linalg.norm(corners[a] + corners[b], axis=-1, keepdims=True)
    # The faces nearest to the middle have all their corners over edges; those corners are 36 degrees apart.
    inner = math.sqrt(1.0 - (2.0 * math.sin(math.radians(18.0))) ** 2 / 3.0)
    return np.concatenate([corners, over]) / inner
