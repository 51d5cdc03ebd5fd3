"""The behaviour of every core, in this process or in one of its own."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from farside.engine.io.glb import to_glb
from farside.engine.io.images import decode_jpeg, encode_jpeg, split_planes
from farside.engine.io.mesh_files import to_ply
from farside.engine.live.core import Core, LocalCore, make_local_core
from farside.engine.live.core_process import ProcessCore
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from oracle.renderer import OracleRenderer
from support.rooms import camera_row, frame

CAMERAS = tuple(camera_row(2, spacing=0.2))
HEAD = StereoView.symmetric(Pose((0.0, 0.9, 0.0)), 48, 40, 1.2, 0.2)
ASIDE = HEAD.moved(Pose((0.0, -0.3, 0.0)))
SETTINGS = Settings.preset("balanced", settles=False, n_update=2, baseline_m=1.0)
FRAMES = [frame(index, CAMERAS, box) for index, box in enumerate((0.0, 1.2, 0.0))]
WEB = (
    "fastapi", "uvicorn", "starlette", "prometheus_client", "msgpack", "websockets", "farside.server",
    "farside.clients",
)  # fmt: skip


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))


def in_a_process() -> ProcessCore:
    return ProcessCore(make_local_core, CAMERAS, SETTINGS)


@pytest.fixture(params=[lambda: make_local_core(CAMERAS, SETTINGS), in_a_process], ids=["local", "process"])
def core(request: pytest.FixtureRequest) -> Iterator[Core]:
    core: Core = request.param()
    yield core
    core.close()


@pytest.fixture(scope="module")
def engine() -> Iterator[Engine]:
    """An engine on which the work of a core is done by hand, for comparison."""
    engine = Engine(CAMERAS, SETTINGS, f_vin=25.0)
    for one in FRAMES:
        engine.update(one, {"a": HEAD, "b": ASIDE}, {"a": 0.5})
    yield engine
    engine.close()


def look() -> dict[str, StereoView]:
    return {"a": HEAD, "b": ASIDE}


def test_frames_in_encoded_pairs_out_and_figures_with_every_update(core: Core, engine: Engine) -> None:
    for one in FRAMES:
        updated = core.update(one, look, {"a": 0.5}, 25.0)
        assert updated.status["frame_index"] == one.index
        parts = {"exposure", "background", "pbi", "triangulate"}
        assert set(updated.stages) == parts | {"total"}
        assert sum(updated.stages[name] for name in parts) <= updated.stages["total"]
    expected = dict(engine.status())
    memory, found = expected.pop("memory_bytes"), updated.status["memory_bytes"]
    assert {name: updated.status[name] for name in expected} == expected
    assert set(found) == set(memory)  # how much a ray tracer takes for the same surfaces depends on its threads
    for name in ("images", "surfaces"):
        assert found[name] == memory[name]
    for name, view in look().items():
        pair, expected = core.picture(view, name, "jpeg"), engine.render(view, name)
        for data, eye in ((pair.left, expected.left), (pair.right, expected.right)):
            assert data == encode_jpeg(eye.texture, SETTINGS.jpeg_quality)
        assert (pair.report.frame_index, pair.report.width, pair.report.height) == (2, 48, 40)
        assert pair.report.holes == expected.holes
        assert set(pair.report.stages) == set(expected.stages)
        assert 0 < pair.report.encode_ms < 2 * pair.report.total_ms  # an eye a thread
    raw = core.picture(HEAD, "a", "raw")
    luma = np.frombuffer(split_planes(raw.right, 40, 48)[0], "<u2").reshape(40, 48)
    np.testing.assert_array_equal(luma, engine.render(HEAD, "a").right.texture.y)
    mesh = engine.mesh()
    assert (core.mesh("ply"), core.mesh("glb", "vertex")) == (to_ply(mesh), to_glb(mesh))
    assert core.mesh("glb") == core.mesh("glb", "texture") == to_glb(engine.textured_mesh())


def test_what_does_not_fit_is_refused_and_nothing_has_changed(core: Core) -> None:
    with pytest.raises(ValueError, match="frame: none was received yet"):
        core.picture(HEAD, "a", "jpeg")
    with pytest.raises(ValueError, match="mesh: there is none before the first frame"):
        core.mesh("ply")
    core.update(FRAMES[0], look, {}, 25.0)
    before = core.picture(HEAD, "a", "raw").left
    with pytest.raises(ValueError, match=r"frame 7: views \('v0',\): expected"):
        core.update(Frame(7, FRAMES[1].views[:1]), look, {}, 25.0)
    with pytest.raises(ValueError, match="encoding: 'webp': expected one of jpeg, raw"):
        core.picture(HEAD, "a", "webp")
    with pytest.raises(ValueError, match="format: 'stl': expected one of glb, ply"):
        core.mesh("stl")
    with pytest.raises(ValueError, match="colours: 'texture': expected vertex for ply"):
        core.mesh("ply", "texture")
    assert core.picture(HEAD, "a", "raw").left == before


def test_the_next_picture_is_rendered_and_encoded_as_the_settings_say(core: Core) -> None:
    core.update(FRAMES[0], look, {}, 25.0)
    fine = core.picture(HEAD, "a", "jpeg")
    core.retune(dataclasses.replace(SETTINGS, output_scale=0.5, jpeg_quality=30))
    while (small := core.picture(HEAD, "a", "jpeg")).report.width != 24:  # settings go their own way
        assert small == dataclasses.replace(fine, report=small.report)
    engine = Engine(CAMERAS, dataclasses.replace(SETTINGS, output_scale=0.5, jpeg_quality=30))
    assert (small.report.width, small.report.height) == (24, 20)
    assert decode_jpeg(small.left, 20, 24).y.shape == (20, 24)
    assert len(small.left) < len(fine.left)
    engine.close()


def test_a_core_draws_with_any_renderer() -> None:
    slow = OracleRenderer()
    core = LocalCore(Engine(CAMERAS, dataclasses.replace(SETTINGS, exposure_s=0.0), renderer=slow))
    core.update(FRAMES[0], look, {}, 25.0)
    pair = core.picture(HEAD, "a", "raw")
    core.close()
    asked = [name for name, *_ in slow.asked]
    assert asked == ["prepare", "warm", "warm", "render", "close"]
    assert len(pair.left) == len(pair.right) == 2 * 40 * 48 * 3 // 2
    assert pair.report.holes > 0


def _loaded(core: Core) -> list[str]:
    return sorted(sys.modules)


def test_the_engines_process_has_no_web_stack_in_it_whatever_it_was_asked() -> None:
    core = in_a_process()
    core.give_way(3)
    core.update(FRAMES[0], look, {}, 25.0)
    core.picture(HEAD, "a", "jpeg")
    core.mesh("glb")
    loaded = core.run(_loaded)
    core.close()
    assert "farside.engine.pipeline.engine" in loaded
    found = [name for name in loaded if any(name == web or name.startswith(f"{web}.") for web in WEB)]
    assert found == []


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("farside.engine.live.core", ("numba", "trimesh", "simplejpeg", *WEB)),
        ("farside.engine.live.core_process", ("numba", "trimesh", "simplejpeg", *WEB)),
        ("farside.clients.cli", ("numpy", "numba", "farside.engine", *WEB[:-1])),
        ("farside.server.protocol", ("numba", "fastapi", "uvicorn")),
    ],
)
def test_modules_load_no_more_than_they_need(module: str, absent: tuple[str, ...]) -> None:
    ask = f"import sys, {module}; print(*sys.modules)"
    environment = os.environ | {"PYTHONPATH": ""}
    loaded = subprocess.run(
        [sys.executable, "-c", ask], capture_output=True, text=True, check=True, env=environment
    ).stdout.split()
    assert module in loaded
    assert [name for name in absent if name in loaded] == []


@pytest.mark.parametrize("make", [make_local_core, lambda *given: ProcessCore(make_local_core, *given)])
def test_the_model_may_begin_later(make) -> None:
    core = make(CAMERAS, SETTINGS, False)
    plain = Engine(CAMERAS, dataclasses.replace(SETTINGS, background=False, exposure_s=0.0), f_vin=25.0)
    late = Engine(CAMERAS, SETTINGS, f_vin=25.0)
    try:
        for engine in (core, plain):
            engine.update(FRAMES[0], look, {}, *([25.0] if engine is core else []))
        assert core.picture(HEAD, "a", "raw").left == plain.render_encoded(HEAD, "a", "raw").left
        with pytest.raises(ValueError, match="mesh: there is none before the first frame"):
            core.mesh("ply")
        core.begin_model()
        for one in FRAMES[1:]:
            core.update(one, look, {}, 25.0)
            late.update(one, look, {})
        assert core.picture(HEAD, "a", "raw").left == late.render_encoded(HEAD, "a", "raw").left
        assert core.mesh("ply") == to_ply(late.mesh())
    finally:
        for each in (core, plain, late):
            each.close()
