"""Work that a scene does not need is not done, and the benchmark shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from farside.clients.bench.spared import show_spared
from farside.engine.evaluation.spared import Spared, spared_rows
from farside.engine.kernels.rendering import spherical
from farside.engine.rendering.rasteriser import Rasteriser


class Kernel:
    """A kernel with a version more for each call, as if it were loaded anew: whether it is used shows in any order."""

    def __init__(self, kernel: Callable[..., None]) -> None:
        self._kernel = kernel
        self.signatures: list[int] = []

    def __call__(self, *given: object) -> None:
        self.signatures.append(len(self.signatures))
        self._kernel(*given)


@pytest.fixture(scope="module", params=["museum", "painter"])
def rows(request: pytest.FixtureRequest) -> Iterator[dict[tuple[str, str], Spared]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spherical, "draw_bands", Kernel(spherical.draw_bands))
        yield {(row.scene, row.what): row for row in spared_rows([request.param], 0.06, 8)}


def named(rows: dict[tuple[str, str], Spared], what: str, still: bool = False) -> Spared:
    (row,) = (row for (scene, name), row in rows.items() if name.startswith(what) and scene.endswith("still") == still)
    return row


def test_nothing_is_cast_derived_or_kept_where_nothing_moves(rows: dict[tuple[str, str], Spared]) -> None:
    assert named(rows, "rays for the model", still=True).all > 0
    assert named(rows, "rays for the model", still=True).left == 0
    assert named(rows, "triangles of the P-PBS", still=True).left == 0
    assert named(rows, "growth", still=True).left == 0


def test_pictures_take_few_views_and_little_of_them(rows: dict[tuple[str, str], Spared]) -> None:
    assert named(rows, "views that are triangulated").left == 5
    triangles = named(rows, "triangles of these views")
    assert 0 < triangles.left < triangles.all


def test_memory_is_far_below_all_that_was_seen(rows: dict[tuple[str, str], Spared]) -> None:
    growth = named(rows, "growth")
    assert growth.left < 0.1 * growth.all


def test_a_pixel_costs_what_the_scene_requires(rows: dict[tuple[str, str], Spared]) -> None:
    noisy = ("painter", "memory of a camera's pixel, noisy depth") in rows
    assert noisy == all(scene.startswith("painter") for scene, _what in rows)  # the museum's is exact
    for still in (False, True):  # a frame that stays does not flicker
        row = named(rows, "memory of a camera's pixel", still)
        assert (row.all, row.left) == (11, 7 if noisy and not still else 6)


def test_a_viewing_space_never_needs_more(rows: dict[tuple[str, str], Spared]) -> None:
    for what in ("triangles of the S-PBS", "memory of its surfaces"):
        (row,) = (row for (_scene, name), row in rows.items() if name == what)
        assert 0 < row.left <= row.all


def test_perspective_rigs_load_nothing_for_spheres(rows: dict[tuple[str, str], Spared]) -> None:
    (name,) = {scene for scene, what in rows if what.startswith("views that")}
    loaded = {what: row.left for (_scene, what), row in rows.items() if what.startswith("spherical")}
    assert loaded == ({"spherical drawing kernels that were loaded": 0} if name == "painter" else {})


def test_a_spherical_kernel_that_is_used_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = Kernel(spherical.draw_bands)
    monkeypatch.setattr(spherical, "draw_bands", kernel)
    drawn = Rasteriser.draw

    def draw(*given: object) -> int:
        kernel.signatures.append(0)
        return drawn(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(Rasteriser, "draw", draw)
    (row,) = (row for row in spared_rows(["painter"], 0.06, 5) if row.what.startswith("spherical"))
    assert row.left == len(kernel.signatures) > 0


def test_the_table_has_what_is_saved(capsys: pytest.CaptureFixture[str]) -> None:
    assert Spared("scene", "rays", 200.0, 50.0, "").saved == pytest.approx(0.75)
    show_spared(["painter"], 0.06, 5)
    printed = capsys.readouterr().out
    for what in ("painter, still", "memory", "100 %", "spherical"):
        assert what in printed
