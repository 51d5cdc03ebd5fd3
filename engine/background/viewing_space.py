"""The viewing space: a ball that heads stay in. What faces away from all of it nobody can see."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from ..mesh import Mesh

__all__ = ["ViewingSpace"]


@dataclasses.dataclass(frozen=True, slots=True)
class ViewingSpace:
    """A ball; its middle is relative to the scene's origin, lengths are in metres."""

    middle: tuple[float, float, float]
    radius: float

    @classmethod
    def relative_to(cls, origin: npt.ArrayLike, ball: tuple[float, float, float, float]) -> ViewingSpace:
        """That of x, y, z and radius in the world."""
        x, y, z = np.subtract(ball[:3], origin).tolist()
        return cls((x, y, z), ball[3])

    def sees(self, mesh: Mesh) -> npt.NDArray[np.bool_]:  # [m]
        """Which triangles show their front to some point of the ball.

        A point sees the front where it lies on that side of the triangle's plane; of a ball, the point nearest to that
        side is its radius nearer than the middle. Triangles without an area are seen by nobody.
        """
        a, b, c = (mesh.points[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
        normal = np.cross(b - a, c - a)  # towards who saw it, from where triangles are wound counterclockwise
        height = np.einsum("ij,ij->i", normal, np.array(self.middle) - a)
        seen: npt.NDArray[np.bool_] = height > -self.radius * np.linalg.norm(normal, axis=1)
        return seen

    def seen(self, mesh: Mesh) -> Mesh:
        """A mesh without the triangles that nobody sees; in one block where there are any."""
        faces = self.sees(mesh)
        if faces.all():
            return mesh
        return dataclasses.replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[faces]), block_starts=None)
