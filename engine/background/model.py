"""The progressive 3D background model (section 3.3): the background surfaces in all frames so far.

This module holds the order of the steps; each step has a module of its own. First frame (3.3.2): `s_pbs` (with
`coverage` and `new_triangles`), `culling`. Later frames (3.3.3): `maximum_depth`, `p_pbs` (with `triangle_filter`
and `new_triangles`), `culling`, `late_layers`. Cameras that move (4.2): `newly_visible`, `older_captures`.
For each viewer (3.4.1): `pbi`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from ..geometry.completion import trusted
from ..geometry.prepared_view import ViewTable
from ..kernels.background.maximum_depth import PHASES
from ..kernels.base.tone import IDENTITY
from ..rig.frame import Frame, View
from ..support.array_types import F64
from ..support.stages import timed
from .capture import Capture
from .maximum_depth import MaximumDepthImage
from .parts import ModelParts
from .ray_tracer import RayTracer
from .report import UpdateReport
from .restoring import put_back, settings_of, state_of
from .s_pbs import gather_triangles
from .seed import Seed
from .seeding import look_again, plant
from .stale import Look
from .state import ModelState
from .surface import Surface
from .viewing_space import flag_hidden

__all__ = ["BackgroundModel", "UpdateReport"]

_LIGHT_TURNS = 2  # updates in which the light of each image is followed once


class BackgroundModel(ModelParts):
    """The S-PBS from the first frame and the P-PBS from surfaces that later frames uncover; it renders probable
    background images.

    `update`, `state` and `render_pbi` are called by one thread at a time, `mesh`, `textured_mesh`, `counts` and
    `queries` by any thread. In its turn, a camera that has moved begins a new capture, and adds the surfaces in its
    view that are farther than the PBS (section 4.2); what earlier captures have added stays, with their colours. A view
    that is left out of a frame leaves no trace in the model; a camera that was left out of the first frames begins with
    its first view. tracer: the ray tracer; None: Embree. seed: an earlier model of the same room, whose surfaces the
    S-PBS begins with (`seeding`).
    """

    def update(
        self, frame: Frame, tones: F64 | None = None, elapsed_s: float = 0.0, present: ViewTable | None = None
    ) -> UpdateReport:
        """Takes the next frame: the first builds the S-PBS, each later one gives a group of cameras its turn.

        tones [n, TONE_SIZE]: the packed tones that convert the views' colours to the model's common tone; None: no
        conversion. elapsed_s: seconds since the frame before, by which colours follow the light (`Settings.light_s`);
        0: they do not. present: the frame's views as measured, prepared with this model's scene and settings, if the
        caller has them; None: they are prepared where they are needed. Raises ValueError, and changes nothing, for a
        frame of other cameras and for a first frame without depth.
        """
        self._rig.check(frame)
        if tones is None:
            tones = np.tile(IDENTITY, (len(frame.views), 1))
        if len(self._captures):
            report = self._progress(frame, tones, elapsed_s, present)
        else:
            report = self._initialise(frame, tones)
        for name, count in self.counts().items():
            setattr(report, name, count)
        still = [c for c in self._rig.still() if frame.views[c].there]
        self._sightings.note(frame, self._captures, still, self.tolerances.delta)
        return report

    def state(self) -> ModelState:
        """The whole model as copies; called by the thread that updates. It is all that `from_state` needs."""
        return state_of(self)

    @classmethod
    def from_state(cls, state: ModelState, tracer: RayTracer | None = None) -> BackgroundModel:
        """A model with this state, which continues bit for bit. Raises ValueError for a state of another version."""
        state.check()
        cameras = [camera.camera() for camera in state.cameras]
        model = cls(cameras, settings_of(state), state.scene.scene(), tracer)
        put_back(model, state)
        model._sightings.resume()
        return model

    def _initialise(self, frame: Frame, tones: F64) -> UpdateReport:
        """The first frame (section 3.3.2)."""
        report = UpdateReport(frame.index, tuple(camera.name for camera in self.cameras))
        tolerances = self._tolerances.start(frame.views)
        self._rig.place([view.camera for view in frame.views])
        self._rig.unseen = set(range(len(self._rig))) - set(frame.there)
        with timed(report.stages, "maximum_depth"):
            for c, view in enumerate(frame.views):
                self._begin_capture(c, view if view.there else View.blank(view.camera), tones[c])
        with timed(report.stages, "triangulate"):
            chosen = gather_triangles(
                self._pbs, self._captures, frame.views, self._new_triangles, self.settings.n_init, tolerances.delta,
                self._origin,
            )  # fmt: skip
            if self._seed is not None:
                self._plant(self._seed, frame, chosen)
        with timed(report.stages, "commit"):
            self._pbs.commit()
        with timed(report.stages, "culling"):
            casting = self._rig.still() if self.settings.rays_by_triangle else chosen
            self._culling.cull(casting, tolerances.delta, report, share=True)
        self._flag_hidden(list(self._pbs.static.values()), frame, report)
        with timed(report.stages, "commit"), self._pbs.lock:
            self._pbs.compact_static()
            self._pbs.commit()
        self._culling.note_cast()
        return report

    def _plant(self, seed: Seed, frame: Frame, chosen: list[int]) -> None:
        """The S-PBS gets what the chosen views of the first frame do not show of an earlier model."""
        views, tolerances = self._new_triangles.table(frame.views), self._tolerances.now
        plant(
            seed, self._pbs, self._captures, views, chosen, self._rig.packed, frame.there, tolerances.delta,
            tolerances.depth_m, self._origin,
        )  # fmt: skip
        self._seed = None  # its pictures live on, its triangles are there twice

    def _progress(self, frame: Frame, tones: F64, elapsed_s: float, present: ViewTable | None) -> UpdateReport:
        """A later frame (section 3.3.3)."""
        self._rig.note_moved(frame)
        for c in sorted(self._rig.unseen.intersection(frame.there)):
            self._join(c, frame.views[c], tones[c])
        seen = self._rig.seen_in(frame)
        self._waited = (self._waited + 1) % self.settings.update_interval
        if self._waited:
            return UpdateReport(frame.index, ())
        group = self._rig.next_group(self.settings.n_update, seen)
        report = UpdateReport(frame.index, tuple(self.cameras[c].name for c in group))
        with timed(report.stages, "maximum_depth"):
            self._update_images(frame, tones, seen, group, report)
            self._follow_light(frame, tones, elapsed_s, seen)
        forgotten, table = 0, cache(lambda: self._new_triangles.table(frame.views) if present is None else present)
        for c in group:
            if c in self._rig.moved:
                self._follow(c, frame.views[c], tones[c], report)
            else:
                self._p_pbs.take_turn(self._captures.current[c], self.tolerances, report)
            with timed(report.stages, "culling"):
                view = self._new_triangles.prepared(c, frame.views[c])
                forgotten += self._culling.forget_seen_past(c, view, self.tolerances.delta)
                look = Look(view, tones[c], self._captures.current[c])
                report.culled += self._culling.cull_stale(c, look, table, self.tolerances.delta)
                report.culled += self._late.take_turn(look, self.tolerances, self._culling.looks[c])
        with timed(report.stages, "culling"):
            # Where no geometry has changed since a camera's last rays, they would find the same again.
            due = self._culling.due(group)
            for c in self._culling.first_time(due):
                look_again(self._pbs, self._captures, len(self._rig), self._rig.packed[c])
            if due or forgotten:
                self._culling.cull(due, self.tolerances.delta, report)
        numbers = [self._captures.current[c].number for c in due]
        parts = [self._pbs.progressive[number] for number in numbers if number in self._pbs.progressive]
        self._flag_hidden(parts, frame, report)
        return report

    def _update_images(
        self, frame: Frame, tones: F64, seen: Sequence[int], group: Sequence[int], report: UpdateReport
    ) -> None:
        """Updates the maximum depth images of all cameras that are where their captures began and are not left out
        (`seen`)."""
        still = [c for c in self._rig.still() if c in seen]
        if self._tolerances.follow(frame, still):
            self._captures.compare_by(self.tolerances)
        for c in still:
            image = self._captures.current[c].image
            report.updated += image.update(frame.views[c], tones[c], whole=c in group)
            if self.tolerances.noise:
                image.fuse(frame.views[c], tones[c])

    def _follow_light(self, frame: Frame, tones: F64, elapsed_s: float, seen: Sequence[int]) -> None:
        """Colours of the same images follow the light (`light`), elapsed_s seconds after the frame before. Each image
        has its turn in one of _LIGHT_TURNS updates."""
        time_s, turn = self.settings.light_s, self._tolerances.frames
        if time_s == 0.0 or elapsed_s == 0.0:
            return
        rounds_s = PHASES * _LIGHT_TURNS * self.settings.update_interval * elapsed_s
        share = -math.expm1(-rounds_s / time_s)
        for c in self._rig.still():
            if c in seen and (c + turn) % _LIGHT_TURNS == 0:
                image = self._captures.current[c].image
                image.follow_light(frame.views[c], tones[c], share, first=c)

    def _follow(self, c: int, view: View, tone: F64, report: UpdateReport) -> None:
        """The turn of a reference camera that has moved since its last turn (section 4.2)."""
        before, version = self._captures.current[c], self._pbs.version
        with timed(report.stages, "maximum_depth"):
            if self.settings.completion:
                view = trusted(view, self._new_triangles.options[c].edge)
            capture = self.recapture(c, view, tone)
        self._p_pbs.begin(capture, before, self.tolerances, report)
        with timed(report.stages, "commit"):
            self._older.retire(before)
            if self._pbs.version != version:
                self._pbs.commit()

    def _join(self, c: int, view: View, tone: F64) -> None:
        """A camera that was left out of all frames so far begins; all that it sees is a candidate for the P-PBS."""
        blank = self._captures.current[c]
        image = self.recapture(c, view, tone).image
        image.suggest(np.ones(view.codes.shape, np.uint8))
        self._older.retire(blank)

    def _begin_capture(self, c: int, view: View, tone: F64) -> Capture:
        """Begins a new current capture of a camera with its first view."""
        edge, refine = self._new_triangles.options[c].edge, self.settings.refine
        image = MaximumDepthImage(view, self.tolerances, edge, tone, refine=refine)
        return self._captures.add(c, image, self._rig.packed[c])

    def recapture(self, c: int, view: View, tone: F64) -> Capture:
        """Begins a newer capture of reference camera `c`, which has moved (section 4.2: its maximum depth image is
        reset with the depth of its view). Surfaces from older captures stay, with their colours.

        tone [TONE_SIZE]: a row of those that `update` takes. Called by the thread that updates. Raises ValueError
        before the first frame, and for a view of another camera; the pose is free."""
        if not len(self._captures):
            raise ValueError(f"camera {c}: no capture to follow: expected a first frame before")
        self._rig.check_one(c, view)
        self._rig.place_one(c, view.camera)
        self._tolerances.replace(c, view)
        self._culling.cast_version[c] = -1
        self._p_pbs.rounds[c] = 1
        return self._begin_capture(c, view, tone)

    def _flag_hidden(self, surfaces: Sequence[Surface], frame: Frame, report: UpdateReport) -> None:
        """Flags triangles that other background hides from the whole viewing space. If PBIs show the farthest surface,
        no surface hides another, and nothing is flagged."""
        if self._space is None or self.settings.backdrop != "standing":
            return
        with timed(report.stages, "hidden"):
            present = self._present(self._new_triangles.table(frame.views), 0.0)
            flag_hidden(self._space, self._pbs, surfaces, self._captures, present, self.tolerances.delta, report)
