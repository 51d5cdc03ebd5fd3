"""Kept canvases: one for each thread, reused, and no more than the limit in bytes allows."""

from __future__ import annotations

from farside.engine.pipeline.engine import Engine
from farside.engine.rendering.canvas_pool import CanvasPool
from farside.engine.rendering.cpu_renderer import CpuRenderer
from farside.engine.rig.camera import Pose
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from support.rooms import camera_row, frame


def use(pool, *sizes):
    """Draw pictures of these sizes one after the other; returns the canvases that were lent."""
    lent = []
    for size in sizes:
        with pool.canvas(*size) as canvas:
            assert canvas.disparity.shape == size[::-1]
            lent.append(canvas)
    return lent


def test_a_canvas_is_used_again_for_its_size_and_by_one_at_a_time():
    pool = CanvasPool(1 << 20)
    first, other, again = use(pool, (40, 30), (30, 40), (40, 30))
    assert again is first is not other
    with pool.canvas(40, 30) as one, pool.canvas(40, 30) as two:
        assert one is not two
    assert {id(canvas) for canvas in use(pool, (40, 30))} <= {id(one), id(two)}


def test_a_canvas_comes_back_where_drawing_fails():
    pool = CanvasPool(1 << 20)
    kept = []
    try:
        with pool.canvas(40, 30) as canvas:
            kept.append(canvas)
            raise RuntimeError("a broken picture")
    except RuntimeError:
        pass
    assert use(pool, (40, 30)) == kept


def test_idle_canvases_are_bounded_by_bytes_and_those_not_used_for_longest_go():
    (one,) = use(CanvasPool(1 << 20), (64, 48))
    pool = CanvasPool(limit_bytes=3 * one.nbytes + 1000)
    sizes = [(64, 48), (48, 64), (62, 48), (60, 48)]
    first, second, third = use(pool, *sizes[:3])
    assert pool.idle_bytes == sum(canvas.nbytes for canvas in (first, second, third))
    assert use(pool, sizes[0]) == [first]  # the second is now the one not used for longest
    (fourth,) = use(pool, sizes[3])
    assert pool.idle_bytes == sum(canvas.nbytes for canvas in (first, third, fourth))
    assert use(pool, sizes[0], sizes[2], sizes[3]) == [first, third, fourth]
    assert use(pool, sizes[1]) != [second]


def test_pictures_of_ever_new_sizes_take_no_more_memory():
    pool = CanvasPool(limit_bytes=300_000)
    for width in range(16, 216):
        use(pool, (width, 24))
        assert pool.idle_bytes <= 300_000


def test_a_canvas_that_is_too_large_to_be_kept_is_lent_all_the_same():
    pool = CanvasPool(limit_bytes=1000)
    assert use(pool, (64, 48)) != use(pool, (64, 48))
    assert pool.idle_bytes == 0


def test_an_engine_keeps_no_more_whoever_it_renders_for():
    renderer = CpuRenderer(canvas_bytes=1_000_000)
    engine = Engine(camera_row(2), Settings.preset("best", background=False), renderer=renderer)
    engine.update(frame(0, camera_row(2), 0.0))
    for width in range(24, 48, 2):
        engine.render(StereoView.symmetric(Pose(), width, 32, 1.2))
        assert 0 < renderer.canvases.idle_bytes <= 1_000_000
    assert 24 * 2 * (24 * 32 + 48 * 64) * 22 > 1_000_000  # bytes that a canvas for every size would take
    engine.close()
