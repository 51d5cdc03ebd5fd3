"""The progressive 3D background model (section 3.3): what the back end keeps of everything seen up to now."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.mesh import Mesh
from ..geometry.prepared_view import PreparedView, ViewTable
from ..geometry.scene_scale import Scene
from ..geometry.triangulation import triangulate
from ..io.mesh_files import ColouredMesh, srgb_from_ycbcr
from ..kernels.background import triangle_filter
from ..kernels.background.captures import CAPTURE_SIZE, CB, CODES, CR, Y, sample_colours
from ..kernels.background.p_pbs import clear_culled, inherit_marks, paint_triangles
from ..kernels.background.pbi import Tables, render_pbi
from ..kernels.background.picture import Picture
from ..kernels.background.standing import FARTHEST, Present
from ..kernels.background.surfaces import Triangles
from ..kernels.base.tone import IDENTITY
from ..rig.camera import Camera
from ..rig.frame import Frame, Texture, View
from ..settings import Settings
from ..support.packed import CAMERA_SIZE
from ..support.stages import Stages, timed
from .changed_directions import ChangedDirections
from .coverage import Coverage, choose_views
from .culling import clear_marks, cull_unmarked, mark_background, mark_missed
from .maximum_depth import BLOCK, MaximumDepthImage
from .pbi import BackgroundImage
from .pbs import ProbableBackgroundSurface, Surface
from .tolerances import Tolerances, sampled_disparity, scene_tolerances, with_noise
from .viewing_space import ViewingSpace, flag_hidden

__all__ = ["BackgroundModel", "UpdateReport"]

_NOISE_FRAMES = (1, 2, 4, 8, 16, 32)  # after the first: when noise is measured


@dataclass(slots=True)
class UpdateReport:
    """What one frame did to the model. Pixels: updated, candidates, accepted; triangles: culled, hidden (from
    the viewing space), s_pbs, p_pbs."""

    frame_index: int
    group: tuple[str, ...]  # cameras whose part of the P-PBS had its turn
    updated: int = 0
    candidates: int = 0
    accepted: int = 0
    rays: int = 0
    culled: int = 0
    hidden: int = 0
    s_pbs: int = 0
    s_pbs_valid: int = 0
    p_pbs: int = 0
    stages: Stages = dataclasses.field(default_factory=Stages)


class BackgroundModel:
    """S-PBS from the first frame, P-PBS from what later frames uncover; rendered as probable background images.

    `update` and `render_pbi` are called by one thread at a time; `mesh` may be called by any other. A camera that
    has moved since the first frame adds nothing from then on; what it added before stays as far as other cameras
    find it. A frame that does not fit is a ValueError and changes nothing.
    """

    def __init__(self, cameras: Sequence[Camera], settings: Settings, scene: Scene) -> None:
        self.cameras = tuple(cameras)
        self.settings = settings
        self._origin = np.asarray(scene.origin, np.float64)
        ball = settings.viewing_space
        self._space = None if ball is None else ViewingSpace.relative_to(self._origin, ball)
        self._packed = np.zeros((len(self.cameras), CAMERA_SIZE))
        self._options = [scene.triangulation(camera, settings) for camera in self.cameras]
        self._pbs = ProbableBackgroundSurface(len(self.cameras))
        self._images: list[MaximumDepthImage] = []
        self._image_table = np.zeros((len(self.cameras), CAPTURE_SIZE), np.int64)
        self._tolerances = Tolerances(0.0, 0.0)
        self._scratch: dict[tuple[int, ...], npt.NDArray[np.int32]] = {}
        self._cast_version = [-1] * len(self.cameras)  # the PBS' version at each camera's last culling rays
        self._changed = ChangedDirections(self._packed)
        self._moved: set[int] = set()
        self._next = 0
        self._waited = 0  # frames that were not taken since the last that was
        self._first: list[npt.NDArray[np.float64]] = []  # samples of the first frame's disparities
        self._frames = 0
        self._rounds = [1] * len(self.cameras)  # of fusion, when each camera's surfaces were derived last
        self._lock = threading.Lock()  # held while surfaces are replaced or flagged, and while they are listed

    @property
    def delta(self) -> float:
        """The culling tolerance at the scene's median depth, metres, as set or as it followed from the first frames."""
        return float(self._tolerances.delta_at(self._tolerances.depth_m))

    @property
    def tolerances(self) -> Tolerances:
        """What surfaces are compared by, as it is set or follows from the frames up to now."""
        return self._tolerances

    @property
    def mesh_tolerance(self) -> float:
        """How far its triangles may be from the depth that was seen, as disparity, 1/m."""
        return max(max(o.tolerance, c.depth.step) for o, c in zip(self._options, self.cameras, strict=True))

    def images(self, frame: Frame) -> tuple[list[int], npt.NDArray[np.int64]]:
        """Cameras that stand in a frame where their maximum depth images have them, and [k, 4] the addresses of these
        images' codes, y, cb, cr (the colours are in the tone that the model keeps)."""
        if not self._images:
            return [], np.empty((0, 4), np.int64)
        fixed = [c for c in self._fixed() if frame.views[c].camera.pose == self.cameras[c].pose]
        return fixed, self._image_table[fixed][:, [CODES, Y, CB, CR]]

    def counts(self) -> dict[str, int]:
        """Triangles: s_pbs (all of the S-PBS), s_pbs_valid (those not culled), p_pbs (valid ones)."""
        with self._lock:
            static, progressive = list(self._pbs.static.values()), list(self._pbs.progressive.values())
        return {
            "s_pbs": sum(len(surface.invalid) for surface in static),
            "s_pbs_valid": sum(surface.valid_count for surface in static),
            "p_pbs": sum(surface.valid_count for surface in progressive),
        }

    @property
    def memory(self) -> dict[str, int]:
        """Bytes: images (what each camera has seen, by pixel) and surfaces (triangles, their points and marks)."""
        with self._lock:
            surfaces = list(self._pbs.surfaces())
        return {
            "images": sum(image.memory for image in self._images),
            "surfaces": sum(surface.memory for surface in surfaces),
        }

    def update(self, frame: Frame, tones: npt.NDArray[np.float64] | None = None) -> UpdateReport:
        """Takes in the next frame: the first builds the S-PBS, each later one gives a group of cameras its turn.

        tones [n, TONE_SIZE]: what brings the views' colours to the tone that the model keeps; None: nothing does.
        """
        self._check(frame)
        if tones is None:
            tones = np.tile(IDENTITY, (len(frame.views), 1))
        if not self._images:
            report = self._initialise(frame, tones)
        else:
            report = self._progress(frame, tones)
        for name, count in self.counts().items():
            setattr(report, name, count)
        return report

    def _check(self, frame: Frame) -> None:
        names = tuple(view.camera.name for view in frame.views)
        if names != tuple(camera.name for camera in self.cameras):
            raise ValueError(f"frame {frame.index}: views {names}: expected one of each camera, in order")
        for view, camera in zip(frame.views, self.cameras, strict=True):
            if dataclasses.replace(view.camera, pose=camera.pose) != camera:
                raise ValueError(f"frame {frame.index}: view {camera.name}: {view.camera}: expected {camera}")

    # The first frame (section 3.3.2)

    def _initialise(self, frame: Frame, tones: npt.NDArray[np.float64]) -> UpdateReport:
        report = UpdateReport(frame.index, tuple(camera.name for camera in self.cameras))
        self.cameras = tuple(view.camera for view in frame.views)  # where they are now
        self._packed[:] = [camera.packed(self._origin) for camera in self.cameras]
        self._tolerances = scene_tolerances(frame.views, self.settings)
        with timed(report.stages, "maximum_depth"):
            self._images = [
                MaximumDepthImage(view, self._tolerances, options.edge, tone, refine=self.settings.refine)
                for view, options, tone in zip(frame.views, self._options, tones, strict=True)
            ]
            self._first = [sampled_disparity(view.camera, view.codes) for view in frame.views]
            self._image_table[:] = [image.table_row() for image in self._images]
        with timed(report.stages, "triangulate"):
            chosen = self._build_static(frame.views)
        with timed(report.stages, "commit"):
            self._pbs.commit()
        with timed(report.stages, "culling"):
            casting = range(len(self.cameras)) if self.settings.rays_by_triangle else chosen
            self._cull(casting, report, share=True)
        self._flag_hidden(self._pbs.static, frame, report)
        with timed(report.stages, "commit"), self._lock:
            self._pbs.compact_static()
            self._pbs.commit()
        self._cast_version = [self._pbs.version] * len(self.cameras)
        return report

    def _build_static(self, views: Sequence[View]) -> list[int]:
        """Makes the S-PBS' triangles; returns the cameras whose they are."""
        coverage = Coverage(self._tolerances.delta, self._origin)
        chosen = choose_views(views, self.settings.n_init)
        for c in chosen:
            keep = coverage.take(views[c], self._options[c].edge)
            mesh = self._triangulate(c, views[c].codes, keep)
            with self._lock:
                self._pbs.set_static(c, mesh)
        return chosen

    def _triangulate(self, c: int, codes: npt.NDArray[np.uint16], keep: npt.NDArray[np.uint8] | None) -> Mesh:
        """A camera's mesh whose pixels keep their squares at depth edges: a gap of a pixel between someone and the wall
        would be a hole in the background, and let rays through to what is behind."""
        options = dataclasses.replace(self._options[c], extend_edges=self.settings.model_rims)
        mesh = triangulate(self.cameras[c], codes, options, origin=self._origin, keep=keep)
        return mesh if self._space is None else self._space.seen(mesh)

    # Every later frame (section 3.3.3)

    def _progress(self, frame: Frame, tones: npt.NDArray[np.float64]) -> UpdateReport:
        retired = self._retire(frame)
        self._waited = (self._waited + 1) % self.settings.update_interval
        if self._waited and not retired:
            return UpdateReport(frame.index, ())
        group = self._next_group()
        report = UpdateReport(frame.index, tuple(self.cameras[c].name for c in group))
        with timed(report.stages, "maximum_depth"):
            self._frames += 1
            if self._frames in _NOISE_FRAMES and self.settings.refine:
                self._allow_for_noise(frame)
            for c in self._fixed():
                report.updated += self._images[c].update(frame.views[c], tones[c], whole=c in group)
                if self._tolerances.noise:
                    self._images[c].fuse(frame.views[c], tones[c])
        for c in group:
            self._take_turn(c, report)
        with timed(report.stages, "culling"):
            # Where no geometry has changed since a camera's last rays, they would find the same again.
            due = [c for c in group if self._cast_version[c] != self._pbs.version]
            if due or retired:
                self._cull(due, report)
        self._flag_hidden({c: self._pbs.progressive[c] for c in due if c in self._pbs.progressive}, frame, report)
        return report

    def _retire(self, frame: Frame) -> bool:
        """Takes their marks from cameras that have moved; whether there are new ones."""
        moved = {c for c in self._fixed() if frame.views[c].camera.pose != self.cameras[c].pose}
        for c in moved:
            clear_marks(self._pbs, c)
        self._moved |= moved
        return bool(moved)

    def _fixed(self) -> list[int]:
        """The cameras that have not moved."""
        return [c for c in range(len(self.cameras)) if c not in self._moved]

    def _next_group(self) -> list[int]:
        """The cameras whose turn it is, each once a round."""
        count = len(self.cameras)
        ahead = [c for k in range(count) if (c := (self._next + k) % count) not in self._moved]
        group = ahead[: self.settings.n_update]
        if group:
            self._next = (group[-1] + 1) % count
        return group

    def _allow_for_noise(self, frame: Frame) -> None:
        """Frames after the first tell how much depth flickers."""
        fixed = self._fixed()
        known, first = self._tolerances, [self._first[c] for c in fixed]
        self._tolerances = with_noise(known, first, [frame.views[c] for c in fixed], self.settings)
        if self._tolerances.noise > known.noise:
            for image in self._images:
                image.compare_by(self._tolerances)

    def _take_turn(self, c: int, report: UpdateReport) -> None:
        """Filters what was uncovered since the camera's last turn, and derives its part of the P-PBS anew."""
        image, before = self._images[c], self._pbs.progressive.get(c)
        culled = before is not None and before.valid_count < len(before.invalid)
        # Twice the frames: noise has fallen by the square root of two.
        fused = self._tolerances.noise > 0 and image.rounds >= 2 * self._rounds[c]
        if not (image.pending.any() or culled or fused):
            return
        version = self._pbs.version
        with self._painted(image, before) as numbers:
            with timed(report.stages, "filter"):
                if before is not None and culled:
                    clear_culled(before.packed, before.invalid, image.camera.wraps, numbers, image.flags)
                changed = self._filter(c, report)
            if culled or changed.any():
                with timed(report.stages, "triangulate"):
                    self._derive(c, before, numbers, changed)
        if fused:
            with timed(report.stages, "triangulate"), self._lock:
                self._rounds[c] = image.rounds
                self._pbs.move(c, lambda mesh: image.settled(mesh, self._packed[c]))
                self._changed.add_all()
        if self._pbs.version != version:
            with timed(report.stages, "commit"):  # before the next camera's rays
                self._pbs.commit()

    @contextmanager
    def _painted(self, image: MaximumDepthImage, before: Surface | None) -> Iterator[npt.NDArray[np.int32]]:  # [h, w]
        """Which valid triangle of a camera's part of the P-PBS covers each pixel, -1 where none does."""
        shape = image.codes.shape
        if shape not in self._scratch:
            self._scratch[shape] = np.full(shape, -1, np.int32)
        numbers = self._scratch[shape]
        if before is None:
            yield numbers
            return
        triangles = before.packed, before.invalid.copy(), image.camera.wraps
        paint_triangles(*triangles, False, numbers)
        try:
            yield numbers
        finally:
            paint_triangles(*triangles, True, numbers)  # a picture has many more pixels than a P-PBS

    def _filter(self, c: int, report: UpdateReport) -> npt.NDArray[np.bool_]:
        """Accepts candidates into the P-PBS; the blocks in which some were, or kept ones have changed."""
        image = self._images[c]
        blocks = np.argwhere(image.pending | image.lone)
        counts = np.empty((len(blocks), triangle_filter.COUNTS_SIZE), np.int64)
        triangle_filter.filter_pixels(
            self._pbs.tracer, self._packed[c], image.camera.depth.packed(), image.codes, image.flags,
            self._tolerances.delta, self.settings.filter_neighbours, blocks, BLOCK, counts,
        )  # fmt: skip
        image.pending[:] = False
        image.lone[tuple(blocks.T)] = counts[:, triangle_filter.LONE] > 0  # waits until there is more beside it
        totals = counts.sum(axis=0)
        report.candidates += int(totals[triangle_filter.CANDIDATES])
        report.accepted += int(totals[triangle_filter.ACCEPTED])
        report.rays += int(totals[triangle_filter.RAYS])
        where = np.zeros(image.pending.shape, bool)
        where[tuple(blocks.T)] = counts[:, [triangle_filter.ACCEPTED, triangle_filter.CHANGED]].any(axis=1)
        return where

    def _derive(
        self, c: int, before: Surface | None, numbers: npt.NDArray[np.int32], changed: npt.NDArray[np.bool_]
    ) -> None:
        """Triangulates the kept pixels; what was there before keeps its marks, outside the changed blocks."""
        image = self._images[c]
        mesh = self._triangulate(c, image.codes, image.kept)
        with self._lock:
            surface = self._pbs.set_progressive(c, mesh)
        news = np.ones(len(mesh.triangles), bool)
        if before is not None:
            triangles = Triangles(mesh.points, mesh.uv, mesh.triangles)
            inherit_marks(triangles, numbers, before.marks, surface.marks, changed, BLOCK, news)
        self._changed.add(mesh, np.flatnonzero(news))

    def _cull(self, cameras: Sequence[int], report: UpdateReport, *, share: bool = False) -> None:
        """Renews the marks of some cameras, and flags what no camera's marks are left on."""
        delta = self._tolerances.delta
        for c in cameras:
            self._cast_version[c] = self._pbs.version
            self._changed.forget(c, list(self._pbs.surfaces()), delta)
            if stride := self.settings.culling_stride:
                report.rays += mark_background(self._pbs, c, self._packed[c], stride, delta)
        unmarked = None
        if self.settings.rays_by_triangle:
            order = [*cameras, *(c for c in self._fixed() if c not in cameras)]
            rays, unmarked = mark_missed(self._pbs, order, self._packed, delta, share=share)
            report.rays += rays
        with self._lock:
            report.culled += cull_unmarked(self._pbs, unmarked)

    def _flag_hidden(self, surfaces: Mapping[int, Surface], frame: Frame, report: UpdateReport) -> None:
        """Flags what nobody in the viewing space can see for other background; where the farthest surface is shown,
        none hides another."""
        if self._space is None or self.settings.backdrop != "standing":
            return
        with timed(report.stages, "hidden"), self._lock:
            prepared = zip(frame.views, self._options, strict=True)
            present = ViewTable([PreparedView(view, options, self._origin) for view, options in prepared])
            owned = [(self.cameras[c], surface) for c, surface in surfaces.items()]
            hidden, rays = flag_hidden(
                self._space, self._pbs, owned, self._present(present, 0.0), self._tolerances.delta
            )
            report.hidden += hidden
            report.rays += rays

    # What is made of it

    def render_pbi(
        self, camera: Camera, present: ViewTable | None = None, *, near: float = 0.0, sparse: bool = True,
        wanted: npt.NDArray[np.uint8] | None = None,
    ) -> BackgroundImage:  # fmt: skip
        """The background seen from a camera (its depth coding must have invalid codes), section 3.4.1.

        Without `present`, the farthest surfaces; with the views of the newest frame, in the order of the cameras, the
        nearest ones beyond depth `near` (metres) that stand: no view looks or has ever looked through them, or the one
        they stem from shows them now. `sparse`: between every second pixel rays are cast only where these do not see
        one plane; else everywhere. `wanted` (`pbi.uncovered_cells`): only there; all else is left as holes.
        """
        if not camera.depth.has_invalid:
            raise ValueError(f"camera {camera.name}: depth coding {camera.depth}: expected one with invalid codes")
        h, w = camera.height, camera.width
        chroma = ((h + 1) // 2, (w + 1) // 2)
        texture = Texture(*(np.empty(shape, np.uint16) for shape in ((h, w), chroma, chroma)))
        codes = np.empty((h, w), np.uint16)
        rays = render_pbi(
            self._pbs.tracer, camera.packed(self._origin), camera.depth.packed(),
            Tables(self._pbs.surface_table, self._image_table), self._present(present, near), self._tolerances.delta,
            sparse, np.empty((0, 0), np.uint8) if wanted is None else wanted,
            Picture(codes, texture.y, texture.cb, texture.cr),
        )  # fmt: skip
        return BackgroundImage(View(camera, texture, codes), int(rays))

    def _present(self, present: ViewTable | None, near: float) -> Present:
        """Views, and what they remember: a camera that has moved, nothing but what it sees now."""
        if present is None:
            return Present(near, np.empty((0, 0)), np.empty((0, 2), np.int64))
        codes = np.repeat(present.addresses[:, :1], 2, axis=1)
        for c in self._fixed():
            codes[c, FARTHEST] = self._images[c].codes.ctypes.data
        return Present(near, present.rows, codes)

    def mesh(self) -> ColouredMesh:
        """The valid triangles with the colours of the maximum depth images; copies, made at any time."""
        with self._lock:
            parts = [
                (c, surface.mesh, surface.invalid == 0)
                for part in (self._pbs.static, self._pbs.progressive)
                for c, surface in part.items()
            ]
        return ColouredMesh.joined([self._coloured(*part) for part in parts])

    def _coloured(self, c: int, mesh: Mesh, valid: npt.NDArray[np.bool_]) -> ColouredMesh:
        ycbcr = np.empty((len(mesh.uv), 3), np.float32)
        sample_colours(self._image_table[c], mesh.uv, ycbcr)
        return ColouredMesh(mesh.points + self._origin, mesh.triangles[valid], srgb_from_ycbcr(ycbcr))
