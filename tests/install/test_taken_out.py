"""Each step of the paper taken out in turn: the test that ARCHITECTURE.md names for it, or a related one, fails.

The changes are made to a copy of the project. Run only with `-m long`, because kernels compile again in the copy.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.checkout import copy_checkout

# File, original text, replacement, and the test that must fail.
STEPS = [
    (
        "engine/rig/selection.py",
        "        k = int(np.argmax(total))\n",
        "        k = len(chosen)\n",
        "rig/test_selection.py::test_the_camera_at_the_targets_pose_comes_first",
    ),
    (
        "engine/pipeline/back_end.py",
        "            pbis, rays = self._make_pbis(look(), speeds, content, settings)\n",
        "            pbis, rays = {}, 0\n",
        "pipeline/test_engine.py::test_what_was_uncovered_earlier_fills_holes",
    ),
    (
        "engine/rendering/picture.py",
        "            self.report.warped = self._draw_views(canvas, self._target)\n",
        "            self.report.warped = 0\n",
        "pipeline/test_engine.py::test_a_virtual_camera_at_a_reference_camera_gives_its_picture",
    ),
    (
        "engine/pipeline/front_buffer.py",
        "            self._front = dataclasses.replace(back, settings=self._settings)\n",
        "            self._front = self._front or dataclasses.replace(back, settings=self._settings)\n",
        "pipeline/test_front_buffer.py::test_the_front_buffer_stays_as_it_is_while_the_next_frame_is_taken",
    ),
    (
        "engine/live/back_buffer.py",
        "        if len(self._views) < len(self._names):\n",
        "        if len(self._views) < len(self._names) + 1:\n",
        "live/test_live.py::test_a_frame_is_complete_when_every_camera_was_seen_in_any_order",
    ),
    (
        "engine/background/pbs.py",
        "        return later + capture % count + (count if static else 0)\n",
        "        return later + capture % count\n",
        "background/test_captures.py::test_each_surface_of_a_capture_is_a_geometry_of_its_own",
    ),
    (
        "engine/background/s_pbs.py",
        "views[c].codes, keep))",
        "views[c].codes, keep | 1))",
        "background/test_coverage.py::test_the_s_pbs_takes_from_later_views_only_what_earlier_ones_do_not_show",
    ),
    (
        "engine/background/new_triangles.py",
        "extend_edges=self._rims)",
        "extend_edges=True)",
        "pipeline/test_paper.py::test_it_models_with_two_triangles_a_pixel_and_culls_those_across_depth_edges",
    ),
    (
        "engine/background/coverage.py",
        "        chosen.append(int(np.argmin(share)))\n",
        "        chosen.append(len(chosen))\n",
        "background/test_coverage.py::test_the_view_that_overlaps_least_comes_next",
    ),
    (
        "engine/background/coverage.py",
        "            farther_only.keep_farther(depth, coding, *old, self._delta, keep)\n",
        "            pass\n",
        "background/test_coverage.py::test_only_farther_pixels_of_later_views_are_kept",
    ),
    (
        "engine/background/culling.py",
        "        report.culled += cull_unmarked(self._pbs, unmarked)\n",
        "        pass\n",
        "background/test_model.py::test_someone_who_left_leaves_no_ghost_after_one_round",
    ),
    (
        "engine/background/maximum_depth.py",
        "        self._number += 1\n",
        "        return 0\n        self._number += 1\n",
        "background/test_maximum_depth.py::test_updates_are_those_of_the_slow_twin",
    ),
    (
        "engine/background/triangle_filter.py",
        "    counts = tracer.filter_pixels(capture, delta, neighbours, blocks, BLOCK)\n",
        "    counts = np.zeros((len(blocks), 5), np.int64)\n",
        "background/test_p_pbs.py::test_a_lone_wrong_depth_is_not_background_and_a_region_is",
    ),
    (
        "engine/background/p_pbs.py",
        "        image, before = capture.image, self",
        "        return\n        image, before = capture.image, self",
        "background/test_p_pbs.py::test_depth_that_was_missing_is_added_when_it_is_seen",
    ),
    (
        "engine/background/reference_cameras.py",
        "            self.next = (group[-1] + 1) % count\n",
        "            self.next = 0\n",
        "background/test_model.py::test_groups_take_turns",
    ),
    (
        "engine/background/pbi.py",
        "view.pose.translated((-behind, 0.0, 0.0))",
        "view.pose",
        "background/test_pbi.py::test_the_imaginary_camera_holds_both_eyes_wherever_the_head_gets_to",
    ),
    (
        "engine/background/pbi.py",
        "    rays = pbs.tracer.render_pbi(\n        view, camera.packed(origin), captures, present, delta,",
        "    rays = pbs.tracer.render_pbi(\n"
        "        view, camera.packed(origin), captures, dataclasses.replace(present, near=0.0), delta,",
        "background/test_pbi.py::test_what_lies_between_the_imaginary_camera_and_the_eyes_is_not_shown",
    ),
    (
        "engine/rendering/warping.py",
        "others, push, delta,",
        "others, (0.0, 0.0), delta,",
        "rendering/test_backdrop.py::test_holes_are_filled_and_the_backdrop_is_pushed_back",
    ),
    (
        "engine/rendering/warping.py",
        "        return self._rasteriser.draw(mesh, target, number, near, margin, self.buffer, tiles, open_tiles)\n",
        "        return self._rasteriser.draw(mesh, target, number, near, 0.0, self.buffer, tiles, open_tiles)\n",
        "rendering/test_warping.py::test_a_later_mesh_wins_where_it_is_nearer_by_the_margin",
    ),
    (
        "engine/rendering/filling.py",
        "    structure.spread_depths(disparity, listed, rise, depths)\n",
        "    return places\n",
        "rendering/test_filling.py::test_a_hole_between_near_and_far_takes_the_far_colour",
    ),
    (
        "engine/settings.py",
        "delta_m=0.2, delta_disparity=0.0",
        "delta_m=0.3, delta_disparity=0.0",
        "pipeline/test_paper.py::test_its_constants_are_those_of_section_4_1",
    ),
    (
        "engine/background/model.py",
        "        return self._begin_capture(c, view, tone)\n\n    def _flag",
        "        return self._captures.current[c]\n\n    def _flag",
        "background/test_captures.py::test_a_camera_has_a_newer_capture_and_the_older_one_stays",
    ),
    (
        "engine/background/newly_visible.py",
        "    return keep\n\n\ndef _depth_view",
        "    return np.ones_like(keep)\n\n\ndef _depth_view",
        "background/test_moving.py::test_what_the_capture_before_shows_is_no_candidate",
    ),
    (
        "engine/background/p_pbs.py",
        "self._neighbours, report)\n            kept = image.kept\n",
        "self._neighbours, report)\n            kept = 0 * image.kept\n",
        "background/test_moving.py::test_a_moving_camera_sees_behind_what_hides_the_wall_from_the_others",
    ),
    (
        "engine/background/culling.py",
        "        if not self._cameras.moving:\n            return 0\n",
        "        return 0\n",
        "background/test_moving.py::test_what_was_seen_past_leaves_the_model",
    ),
    (
        "engine/pipeline/moving_views.py",
        "        return everything if moving or not still else still\n",
        "        return everything\n",
        "pipeline/test_moving_views.py::test_a_moving_camera_serves_updates_only",
    ),
    (
        "engine/kernels/background/complementary_rays.py",
        "    half = 0.5 * delta_at(delta, far - t)\n",
        "    half = 0.0\n",
        "background/test_culling.py::test_complementary_rays_mark_what_lies_just_before_the_closest_hit",
    ),
    (
        "engine/kernels/background/triangle_filter.py",
        "    return _ACCEPTED if depth * length > distance + delta_at(delta, distance) else 0\n",
        "    return _ACCEPTED\n",
        "background/test_triangle_filter.py::test_candidates_are_accepted_as_by_the_slow_twin_with_fewer_rays",
    ),
]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_checkout(tmp_path_factory.mktemp("project") / "copy")


def outcome(copy: Path, test: str) -> int:
    """Exit status of pytest for one test of the copy: 0: it passes, 1: it fails."""
    places = os.pathsep.join([str(copy / ".mypy"), str(copy / "tests")])  # the copy's engine, not the installed one
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", f"tests/{test}"]
    return subprocess.run(command, cwd=copy, env=os.environ | {"PYTHONPATH": places}, check=False).returncode


@pytest.mark.long
@pytest.mark.parametrize(("file", "step", "without", "test"), STEPS, ids=[row[3].partition("::")[2] for row in STEPS])
def test_a_step_that_is_taken_out_is_missed(copy: Path, file: str, step: str, without: str, test: str) -> None:
    text = (copy / file).read_text("utf-8")
    assert text.count(step) == 1
    assert outcome(copy, test) == 0
    (copy / file).write_text(text.replace(step, without), "utf-8")
    try:
        assert outcome(copy, test) == 1
    finally:
        (copy / file).write_text(text, "utf-8")
