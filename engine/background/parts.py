"""What a background model consists of, and what is read of it: probable background images, meshes, figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.prepared_view import ViewTable
from ..geometry.scene_scale import Scene
from ..io.mesh_files import ColouredMesh
from ..rig.camera import Camera
from ..rig.frame import Frame
from ..settings import Settings
from ..support.array_types import I64, U8
from .capture import Capture, Captures, Present
from .coloured_mesh import coloured_mesh
from .culling import ForegroundCulling
from .p_pbs import ProgressiveUpdate
from .pbi import BackgroundImage, render_pbi
from .pbs import ProbableBackgroundSurface
from .ray_tracer import RayTracer
from .reconstruction import Reconstruction
from .reference_cameras import ReferenceCameras
from .tolerances import FollowedTolerances, Tolerances
from .viewing_space import ViewingSpace

__all__ = ["ModelParts"]


class ModelParts:
    """The parts of a background model; `model.BackgroundModel` says in which order they do their work."""

    def __init__(
        self, cameras: Sequence[Camera], settings: Settings, scene: Scene, tracer: RayTracer | None = None
    ) -> None:
        self.settings, self._scene = settings, scene
        self._origin = np.asarray(scene.origin, np.float64)
        ball = settings.viewing_space
        self._space = None if ball is None else ViewingSpace.relative_to(self._origin, ball)
        self._rig = ReferenceCameras(cameras, self._origin)
        options = [scene.triangulation(camera, settings) for camera in cameras]
        self._reconstruction = Reconstruction(options, self._origin, self._space, rims=settings.model_rims)
        self._pbs = ProbableBackgroundSurface(len(self._rig), tracer)
        self._captures = Captures()
        self._tolerances = FollowedTolerances(settings)
        self._culling = ForegroundCulling(self._pbs, self._rig, settings)
        changed = self._culling.changed
        self._p_pbs = ProgressiveUpdate(self._pbs, self._reconstruction, changed, settings, len(self._rig))
        self._waited = 0  # frames that were not taken since the last that was

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The reference cameras, where they stood when their current captures began."""
        return self._rig.cameras

    @property
    def captures(self) -> tuple[Capture, ...]:
        """All that was seen from each pose: what surfaces stem from, the current ones and older ones."""
        return tuple(self._captures)

    @property
    def delta(self) -> float:
        """The culling tolerance at the scene's median depth, metres, as set or as it followed from the first frames."""
        return float(self.tolerances.delta_at(self.tolerances.depth_m))

    @property
    def tolerances(self) -> Tolerances:
        """What surfaces are compared by, as it is set or follows from the frames up to now."""
        return self._tolerances.now

    @property
    def mesh_tolerance(self) -> float:
        """How far its triangles may be from the depth that was seen, as disparity, 1/m."""
        return self._reconstruction.tolerance(self.cameras)

    def images(self, frame: Frame) -> tuple[list[int], I64]:
        """Cameras that stand in a frame where their current captures have them, and [k, 4] the addresses of these
        captures' codes, y, cb, cr (the colours are in the tone that the model keeps)."""
        fixed = self._rig.fixed_in(frame) if len(self._captures) else []
        return (fixed, self._captures.planes(fixed)) if fixed else ([], np.empty((0, 4), np.int64))

    def counts(self) -> dict[str, int]:
        """Triangles: s_pbs (all of the S-PBS), s_pbs_valid (those not culled), p_pbs (valid ones)."""
        return self._pbs.counts()

    @property
    def memory(self) -> dict[str, int]:
        """Bytes: images (what each camera has seen, by pixel), surfaces (triangles, their points and marks) and
        ray_tracer (its hierarchies over the surfaces)."""
        return {
            "images": self._captures.memory, "surfaces": self._pbs.memory, "ray_tracer": self._pbs.tracer.memory,
        }  # fmt: skip

    def _present(self, views: ViewTable | None, near: float) -> Present:
        return Present(near, views, {c: self._captures.current[c].image.codes for c in self._rig.fixed()})

    def render_pbi(
        self, camera: Camera, present: ViewTable | None = None, *, near: float = 0.0, sparse: bool = True,
        wanted: U8 | None = None,
    ) -> BackgroundImage:  # fmt: skip
        """The background seen from a camera (its depth coding must have invalid codes), section 3.4.1; see
        `pbi.render_pbi`.

        Without `present`, the farthest surfaces; with the views of the newest frame, in the order of the cameras, the
        nearest ones beyond depth `near` (metres) that stand: no view looks or has ever looked through them, or the one
        they stem from shows them now.
        """
        return render_pbi(
            self._pbs, self._captures, camera, self._origin, self._present(present, near), self.tolerances.delta,
            sparse=sparse, wanted=wanted,
        )  # fmt: skip

    def mesh(self) -> ColouredMesh:
        """The valid triangles with the colours of their captures; copies, made at any time."""
        return coloured_mesh(self._pbs, self._captures, self._origin)
