"""Nothing is read or written beyond an array: random pictures, rigs and heads under guarded memory (`guarded`).

A fault kills the process, so cases run in a child process (`guard_cases`), which is told each case first; the test that
requested it reports which case failed and where. FARSIDE_GUARD_CASES multiplies the number of cases.
"""

from __future__ import annotations

import ast
import functools
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from farside.engine.kernels.rendering import antialias
from farside.engine.rendering import warping as canvas_module
from farside.engine.rendering.warping import Canvas
from support import guard_cases
from support import guarded as guarded_module
from support.guarded import FLUSHES, guarded, guarding, kernels_of_engine

KERNELS = Path(guard_cases.engine_module.__file__).parents[1] / "kernels"
TESTS = Path(guard_cases.__file__).parents[1]
TIMES = int(os.environ.get("FARSIDE_GUARD_CASES", "1"))


class DiedError(AssertionError):
    """The child process has died: which case it ran, and its error output."""


class Child:
    """A process that runs cases; it is restarted after it has died."""

    def __init__(self) -> None:
        self.called: dict[str, set[str]] = {}  # kernels, by case
        self._process: subprocess.Popen[str] | None = None
        self._said = tempfile.TemporaryFile("w+")  # noqa: SIM115 (closed by `close`)

    def run(self, case: str, seed: int, flush: str, **options: object) -> dict[str, float]:
        """A case's counts; raises DiedError if it kills the child."""
        asked = {"case": case, "seed": seed, "flush": flush, **options}
        process = self._process or self._start()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(asked) + "\n")
        process.stdin.flush()
        line = process.stdout.readline()
        if not line:
            process.communicate()
            raise DiedError(self._epitaph(asked, process.returncode))
        answer = json.loads(line)
        self.called.setdefault(case, set()).update(answer["called"])
        counts: dict[str, float] = answer["counts"]
        return counts

    def _start(self) -> subprocess.Popen[str]:
        self._said.seek(0)
        self._said.truncate()
        # New memory is filled with nonsense, so that reading it before it is written has visible effects.
        environment = {**os.environ, "MALLOC_PERTURB_": "165", "PYTHONPATH": str(TESTS)}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "support.guard_cases"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=self._said, text=True, env=environment,
        )  # fmt: skip
        return self._process

    def _epitaph(self, asked: dict[str, object], code: int) -> str:
        self._process = None
        self._said.seek(0)
        return f"{asked}: the child ended with {code}:\n{self._said.read()}"

    def close(self) -> None:
        if self._process is not None:
            self._process.communicate()
        self._said.close()


@pytest.fixture(scope="module")
def child() -> Iterator[Child]:
    it = Child()
    yield it
    it.close()


@pytest.mark.parametrize("flush", FLUSHES)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.int64])
def test_a_guarded_array_is_the_same_array(flush, dtype):
    array = np.arange(7 * 300 * 3).reshape(7, 300, 3).astype(dtype)
    other = guarded(array, flush)
    np.testing.assert_array_equal(other, array)
    assert other.dtype == dtype
    assert other.flags.c_contiguous
    assert other.flags.writeable
    assert other.flags.aligned
    end = other.ctypes.data + (other.nbytes if flush == "end" else 0)
    assert end % os.sysconf("SC_PAGE_SIZE") == 0
    assert guarded(np.empty((0, 3), dtype), flush).shape == (0, 3)


def test_many_guarded_arrays_are_given_back():
    def maps() -> int:
        return len(Path("/proc/self/maps").read_text().splitlines())

    before = maps()
    for _ in range(200):
        guarded(np.zeros(5000))
    assert maps() < before + 50


@pytest.mark.parametrize("flush", FLUSHES)
def test_what_the_engine_allocates_and_hands_to_kernels_is_guarded(flush, monkeypatch):
    given: list[np.ndarray] = []
    kernel = antialias.mark_silhouettes

    def noted(array: np.ndarray, flush: str) -> np.ndarray:
        given.append(guarded(array, flush))
        return given[-1]

    monkeypatch.setattr(guarded_module, "guarded", noted)
    called: set[str] = set()
    with guarding(flush, called):
        canvas = Canvas(30, 20)
        canvas.disparity[5:, 7:] = 1.0
        canvas.disparity[9:, 9:] = 2.0
        made, marks = len(given), canvas.silhouettes(0.5)
    assert 0 < marks.sum() < marks.size
    assert made >= 5  # planes
    assert len(given) >= made + 3  # the marks, and what the kernel was given
    assert called == {"rendering.antialias.mark_silhouettes"}
    assert canvas_module.np is np
    assert canvas_module.antialias.mark_silhouettes is kernel


@pytest.mark.parametrize("flush", FLUSHES)
def test_an_element_beyond_kills_and_is_reported(child, flush):
    with pytest.raises(DiedError) as caught:
        child.run("beyond", 7, flush)
    said = str(caught.value)
    assert f"'case': 'beyond', 'seed': 7, 'flush': '{flush}'" in said
    assert "Fatal Python error: Segmentation fault" in said or "Bus error" in said
    assert "guard_cases.py" in said
    assert "in beyond" in said
    assert child.run("pictures", 0, flush)["bytes"] > 0  # a new child runs


def test_a_case_that_hangs_is_reported(child):
    with pytest.raises(DiedError, match="'case': 'hanging'") as caught:
        child.run("hanging", 3, "end", hangs_s=0.5)
    assert "Timeout" in str(caught.value)
    assert "in hanging" in str(caught.value)


def sweep(child: Child, case: str, seeds: int) -> Counter[str]:
    """The sums of a case's counts over seeds, which must be the same with either end of arrays at a guard page."""
    sums: dict[str, Counter[str]] = {}
    for flush in FLUSHES:
        sums[flush] = Counter()
        for seed in range(seeds * TIMES):
            sums[flush].update(child.run(case, seed, flush))
    assert sums["start"] == sums["end"], "what comes out depends on where arrays lie"
    return sums["end"]


def test_views_of_all_kinds_are_drawn_and_shaded_within_their_planes(child):
    assert sweep(child, "shading", 80)["drawn"] > 80 * 2000


def test_views_of_all_sizes_are_triangulated_within_their_planes(child):
    counts = sweep(child, "triangulating", 40)
    assert counts["triangles"] > 40 * 1000
    assert counts["kept"] > 40 * 500


def test_pictures_of_all_sizes_are_converted_and_filled_within_their_planes(child):
    counts = sweep(child, "pictures", 40)
    assert counts["filled"] > 40 * 500
    assert counts["bytes"] > 40 * 500


def test_the_engine_stays_within_all_of_its_arrays(child):
    counts = sweep(child, "pipeline", 24)
    assert counts["drawn"] > 24 * 2000
    assert counts["backdrop"] > 24 * 20
    assert counts["rays"] > 24 * 500
    assert counts["mesh"] > 24 * 50
    assert counts["pages"] >= 24 * 0.9
    assert counts["found"] > 24 * 20


def test_the_background_stays_within_its_arrays_when_it_is_uncovered(child):
    counts = sweep(child, "uncovering", 2)
    assert counts["drawn"] > 2 * 2000
    assert counts["rays"] > 2 * 500


def test_what_a_walking_camera_adds_stays_within_its_arrays(child):
    counts = sweep(child, "walking", 8)
    assert counts["captures"] > 8 * 3
    assert counts["p_pbs"] > 8 * 50
    assert counts["mesh"] > 8 * 50


def test_what_is_put_into_a_room_stays_within_its_arrays(child):
    assert sweep(child, "arriving", 8)["late"] >= 2 * 8


def test_projected_pictures_and_added_meshes_stay_within_their_arrays(child):
    counts = sweep(child, "effects", 24)
    assert counts["added"] > 24 * 100
    assert counts["changed"] > 24 * 200


def test_absurd_cameras_and_heads_do_no_harm(child):
    assert sweep(child, "hostile", 16)["taken"] > 8


def test_structure_of_no_numbers_is_continued_nowhere_in_memory(child):
    assert sweep(child, "no_colours", 8)["filled"] > 8 * 100



def test_points_that_are_nowhere_settle_within_the_codes(child):
    assert sweep(child, "lost_points", 8)["settled"] == 8 * 4



def test_pixels_at_the_eye_of_their_view_have_a_colour(child):
    seeds = 16
    for flush in FLUSHES:
        assert sum(child.run("at_the_eye", seed, flush)["coloured"] for seed in range(seeds)) == seeds


def test_triangles_beyond_all_integers_are_drawn_to_an_end(child):
    assert child.run("far_triangles", 0, "end")["drawn"] > 0
    for seed in range(1, 20):
        assert child.run("far_triangles", seed, "end", hangs_s=60.0)["drawn"] >= 0


# Kernel files that use addresses, and the cases that run them. A new file needs a new case or an entry here.
COVERED = {
    "background/captures": ("pipeline",),
    "background/complementary_rays": ("pipeline",),
    "background/culling": ("pipeline",),
    "background/exposure": ("pipeline",),
    "background/hidden": ("pipeline",),
    "background/middle_layers": ("walking",),
    "background/near": ("pipeline",),
    "background/parts": ("walking",),
    "background/pbi": ("pipeline", "walking"),
    "background/queried": ("pipeline",),
    "background/query_rays": ("pipeline",),
    "background/seeding": ("pipeline",),
    "background/seen_past": ("walking",),
    "background/stale": ("walking",),
    "background/texture_pages": ("pipeline",),
    "background/triangle_filter": ("pipeline",),
    "background/uncovered": ("pipeline",),
    "geometry/changes": ("triangulating", "shading"),
    "geometry/cuts": ("triangulating", "shading"),
    "geometry/splits": ("triangulating", "shading"),
    "geometry/triangulate": ("triangulating", "shading"),
    "rendering/backdrop": ("pipeline",),
    "rendering/blocks": ("shading", "pipeline"),
    "rendering/rasterise": ("shading", "pipeline"),
    "rendering/shade": ("shading", "pipeline"),
    "rendering/sorting": ("shading", "pipeline"),
}
# Files whose functions are called only by kernels of these files.
INSIDE = {
    "background/intersect": ("background/complementary_rays", "background/rays", "background/standing"),
    "background/rays": (
        "background/complementary_rays", "background/culling", "background/hidden", "background/pbi",
        "background/standing",
        "background/triangle_filter",
    ),
    "background/standing": ("background/hidden", "background/pbi"),
    "background/triangles": ("background/near", "background/pbi", "background/queried"),
    "base/lanes": ("geometry/changes", "geometry/cuts", "geometry/splits", "geometry/triangle_words"),
    "base/sight": (
        "background/middle_layers", "background/seeding", "background/seen_past", "background/stale",
        "background/standing", "rendering/backdrop",
    ),
    "base/memory": (
        "background/captures", "background/complementary_rays", "background/parts", "background/stale",
        "background/texture_pages", "background/triangles",
        "background/uncovered", "rendering/backdrop", "rendering/blocks", "rendering/shade", "rendering/sorting",
    ),
    "geometry/rims": ("geometry/triangulate",),
    "geometry/triangle_words": ("geometry/triangulate",),
    "rendering/cells": ("rendering/shade",),
    "rendering/lens": ("rendering/shade",),
    "rendering/look": ("rendering/cells",),
    "rendering/present": ("rendering/backdrop",),
    "rendering/strips": ("rendering/rasterise", "rendering/sorting"),
    "rendering/texels": ("rendering/look",),
    "rendering/winner_colour": ("rendering/shade",),
}
# A measure by rays, which read only memory that other rays read, too; callbacks, which Embree calls instead of the
# engine, in every case that casts rays; and modules for uncompiled runs.
ASIDE = {
    "evaluation/leaks", "background/embree_callbacks", "background/intersect_numpy", "background/point_callbacks",
    "background/point_query_numpy", "base/live_arrays",
}  # fmt: skip
MEMORY = {"intersect", "lanes", "memory"}  # modules that read and write at addresses
# Modules that take addresses from others.
THROUGH = {
    "cells", "lens", "look", "present", "rays", "sight", "strips", "standing", "texels", "triangles", "winner_colour",
}  # fmt: skip


@functools.cache
def imports_of(name: str) -> dict[str, set[str]]:
    """Names, without constants, that a kernel file imports, by the last name of the module."""
    found: dict[str, set[str]] = {}
    for node in ast.walk(ast.parse((KERNELS / f"{name}.py").read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            module = (node.module or "").split(".")[-1]
            for alias in node.names:
                if not alias.name.isupper():
                    found.setdefault(module, set()).add(alias.name)
                    found.setdefault(alias.name, set())  # from ..base import lanes
    return found


@functools.cache
def users_of_addresses() -> frozenset[str]:
    """Kernel files that take an array's address, or import functions from the memory layer or from such files."""
    names = {str(path.relative_to(KERNELS))[:-3] for path in KERNELS.rglob("*.py") if path.stem != "__init__"}
    taken = {name for name in names if re.search(r"\.ctypes\b|\bcarray\b", (KERNELS / f"{name}.py").read_text())}
    users = {name for name in names if set(imports_of(name)) & (MEMORY | THROUGH)}
    return frozenset(taken | users | {name for name in names if name.split("/")[1] in MEMORY})


def test_every_file_of_kernels_that_takes_addresses_has_a_case():
    named = set(COVERED) | set(INSIDE) | ASIDE
    assert users_of_addresses() - named == set(), "kernels with addresses and without a case: see COVERED"
    assert named - users_of_addresses() == set(), "these take no addresses"
    assert {case for cases in COVERED.values() for case in cases} <= set(guard_cases.CASES)
    for name, users in INSIDE.items():
        for user in users:
            assert name.split("/")[1] in imports_of(user), (name, user)


def test_cases_call_every_kernel_of_the_engine(child):
    """Every kernel that the engine's modules can call; runs last and counts the calls of the other tests."""
    needed = {"shading", "triangulating", "pictures", "pipeline", "uncovering", "walking", "arriving", "effects"}
    if not needed <= set(child.called):
        pytest.skip("only where all cases have run")
    for name, cases in COVERED.items():
        for case in cases:
            assert any(kernel.startswith(f"{name.replace('/', '.')}.") for kernel in child.called[case]), (name, case)
    wanted = {kernel for kernel in kernels_of_engine() if not kernel.startswith("farside.")}
    assert wanted - set().union(*child.called.values()) == set()
