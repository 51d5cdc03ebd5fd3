"""The parts of a background model, and its outputs: probable background images, meshes, figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.prepared_view import ViewTable
from ..geometry.scene_scale import Scene
from ..io.coloured_meshes import ColouredMesh, TexturedMesh
from ..rig.camera import Camera
from ..rig.frame import Frame
from ..settings import Settings
from ..support.array_types import I64, U8
from .capture import Capture, Captures, Present, Remains
from .coloured_mesh import coloured_mesh
from .culling import ForegroundCulling
from .late_layers import LateLayers
from .middle_layers import MiddleLayers
from .new_triangles import NewTriangles
from .older_captures import OlderCaptures
from .p_pbs import ProgressiveUpdate
from .pbi import BackgroundImage, render_pbi
from .pbs import ProbableBackgroundSurface
from .queries import ModelQueries
from .ray_tracer import RayTracer
from .reference_cameras import ReferenceCameras
from .seed import Seed
from .sightings import Sightings
from .textured_mesh import textured_mesh
from .tolerances import FollowedTolerances, Tolerances
from .viewing_space import ViewingSpace

__all__ = ["ModelParts"]


class ModelParts:
    """The parts of a background model; `model.BackgroundModel` calls them in order."""

    def __init__(
        self, cameras: Sequence[Camera], settings: Settings, scene: Scene, tracer: RayTracer | None = None,
        seed: Seed | None = None,
    ) -> None:  # fmt: skip
        self.settings, self._scene = settings, scene
        self._origin = np.asarray(scene.origin, np.float64)
        ball = settings.viewing_space
        self._space = None if ball is None else ViewingSpace.relative_to(self._origin, ball)
        self._rig = ReferenceCameras(cameras, self._origin)
        options = [scene.triangulation(camera, settings) for camera in cameras]
        self._new_triangles = NewTriangles(options, self._origin, self._space, rims=settings.model_rims)
        self._pbs = ProbableBackgroundSurface(len(self._rig), tracer)
        self._captures = Captures()
        self._tolerances = FollowedTolerances(settings)
        budget = settings.middle_layers if settings.backdrop == "standing" else 0
        layers = MiddleLayers(self._pbs, self._captures, self._rig, self._new_triangles, budget)
        self._culling = ForegroundCulling(self._pbs, self._rig, layers, settings)
        changed = self._culling.changed
        self._p_pbs = ProgressiveUpdate(self._pbs, self._new_triangles, changed, settings, len(self._rig))
        self._older = OlderCaptures(self._pbs, self._captures)
        self._late = LateLayers(self._pbs, self._captures, self._rig, self._new_triangles, layers, settings)
        self._sightings = Sightings()
        self._seed = seed  # until the first frame
        self._waited = 0  # frames skipped since the last update

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The reference cameras, in the poses in which their current captures began."""
        return self._rig.cameras

    @property
    def captures(self) -> tuple[Capture | Remains, ...]:
        """All captures, current ones and what is left of older ones: the origins of surfaces."""
        return tuple(self._captures)

    @property
    def queries(self) -> ModelQueries:
        """What can be asked about the model: rays, the closest point, spheres. Any thread may ask at any time."""
        return ModelQueries(self._pbs, self._sightings, self._origin)

    @property
    def delta(self) -> float:
        """The culling tolerance at the scene's median depth, metres, as set or as derived from the first frames."""
        return float(self.tolerances.delta_at(self.tolerances.depth_m))

    @property
    def tolerances(self) -> Tolerances:
        """The tolerances with which surfaces are compared, as set or as derived from the frames so far."""
        return self._tolerances.now

    @property
    def mesh_tolerance(self) -> float:
        """The largest error of its triangles' depth, as disparity, 1/m."""
        return self._new_triangles.tolerance(self.cameras)

    def images(self, frame: Frame) -> tuple[list[int], I64]:
        """The cameras [k] whose pose in a frame is that of their current capture, and the addresses [k, 4] of these
        captures' codes, y, cb and cr planes (colours in the model's common tone)."""
        still = self._rig.still_in(frame) if len(self._captures) else []
        return (still, self._captures.planes(still)) if still else ([], np.empty((0, 4), np.int64))

    def counts(self) -> dict[str, int]:
        """Triangles: s_pbs (all of the S-PBS), s_pbs_valid (those not culled), p_pbs (valid ones)."""
        return self._pbs.counts()

    @property
    def memory(self) -> dict[str, int]:
        """Bytes of images (the maximum depth images, and what `late_layers` notes), surfaces (triangles, their points
        and marks) and ray_tracer (its hierarchies over the surfaces)."""
        return {
            "images": self._captures.memory + self._late.memory, "surfaces": self._pbs.memory,
            "ray_tracer": self._pbs.tracer.memory,
        }  # fmt: skip

    def _present(self, views: ViewTable | None, near: float) -> Present:
        return Present(near, views, {c: self._captures.current[c].image.codes for c in self._rig.still()})

    def render_pbi(
        self, camera: Camera, present: ViewTable | None = None, *, near: float = 0.0, sparse: bool = True,
        wanted: U8 | None = None,
    ) -> BackgroundImage:  # fmt: skip
        """The background seen from a camera (its depth coding must have invalid codes), section 3.4.1; see
        `pbi.render_pbi`.

        Without `present` it shows the farthest surfaces. `present`: the views of the newest frame, in the order of the
        cameras; then it shows, beyond the depth `near` (metres), the nearest surface that stands. A surface stands if
        no view sees or has ever seen past it, or if the view that it stems from shows it now.
        """
        return render_pbi(
            self._pbs, self._captures, camera, self._origin, self._present(present, near), self.tolerances.delta,
            sparse=sparse, wanted=wanted,
        )  # fmt: skip

    def mesh(self) -> ColouredMesh:
        """The valid triangles with colours at their vertices; copies. Any thread may call this at any time."""
        return coloured_mesh(self._pbs, self._captures, self._origin)

    def textured_mesh(self) -> TexturedMesh:
        """The valid triangles with the pictures of their captures; copies. Any thread may call this at any time."""
        return textured_mesh(self._pbs, self._captures, self._origin)
