"""The list of needed kernels is complete and has nothing that is not needed."""

from __future__ import annotations

import dataclasses
import importlib
import io
import json
import subprocess
import sys
from pathlib import Path

import pytest
from farside.engine.background import seed_files
from farside.engine.background.seed_files import read_seed
from farside.engine.compiling import listing
from farside.engine.compiling.listing import join
from farside.engine.compiling.needed import USES, Kernel, needed_for, read, write
from farside.engine.compiling.pool import Compiling
from farside.engine.compiling.recorder import Compiled
from farside.engine.compiling.signatures import to_text
from farside.engine.io.effect_files import read_mesh
from farside.engine.kernels.background import late_layers, light, middle_layers, stale
from farside.engine.kernels.background.seeding import judge_seed
from farside.engine.kernels.rendering import added_mesh, projector
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.rig.effects import AddedMesh, Projector
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from PIL import Image
from support import effects as room
from support import moments
from support.rooms import camera_row

AGAIN = "make the list anew: farside bench compile --renew"


@pytest.fixture(scope="module")
def twins(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("twins")
    record("synth", folder / "twins", folder / "first.json")
    return folder


def record(use: str, twins: Path, out: Path) -> None:
    command = [sys.executable, "-m", "farside.engine.compiling.recorder", use, str(twins), str(out)]
    subprocess.run(command, check=True)


@pytest.mark.parametrize("use", USES)
def test_nothing_else_is_compiled(use: str, twins: Path) -> None:
    compiling = Compiling([use])
    compiling.run()
    assert compiling.progress.failed == 0
    out = twins / f"{use}.json"
    record(use, twins / ("made again" if use == "synth" else "twins"), out)
    compiled = json.loads(out.read_text())
    assert [(each["module"], each["name"], each["types"]) for each in compiled["kernels"]] == [], AGAIN
    assert set(compiled["modules"]) <= {read()[number].module for number in needed_for([use])}, AGAIN


def test_effects_in_an_engine_need_no_other_kernels() -> None:
    cameras = camera_row(3, (64, 48))
    engine = Engine(cameras, Settings.preset("balanced"))
    engine.put_effect("white", Projector(room.looking_at_the_wall(), 1.0), room.white())
    engine.put_effect("live", Projector(room.looking_at_the_wall(), 1.0, camera="v1"))
    engine.put_effect("cube", AddedMesh(Pose((3.0, 0.0, 0.0)), 0.2), read_mesh(room.cube_glb()))
    engine.update(room.frame(0, cameras))
    engine.render(StereoView.symmetric(Pose(), 48, 40, 1.2))
    for kernel in (projector.project, projector.halve, projector.take_planes, added_mesh.draw):
        name = kernel.py_func.__name__
        listed = {each.types for each in read() if each.name == name and "effects" in each.uses}
        assert {to_text(types) for types in kernel.signatures} == listed != set(), AGAIN


def test_a_model_that_begins_with_an_earlier_one_needs_no_other_kernels(tmp_path: Path) -> None:
    cameras = camera_row(3, (64, 48))
    first = Engine(cameras, Settings.preset("balanced"))
    first.update(room.frame(0, cameras))
    (tmp_path / "room.glb").write_bytes(first.export("glb"))
    seed = read_seed(tmp_path / "room.glb")
    Engine(cameras, Settings.preset("balanced"), seed=seed).update(room.frame(0, cameras))
    listed = {each.types for each in read() if each.name == "judge_seed" and "seed" in each.uses}
    assert {to_text(types) for types in judge_seed.signatures} == listed != set(), AGAIN
    with io.BytesIO() as file:
        Image.new("RGB", (4, 4)).save(file, "PNG")
        assert seed_files._decoded(file.getvalue(), 4).flags.writeable  # its colours are converted by a listed kernel


def test_a_model_past_the_papers_limits_needs_no_other_kernels() -> None:
    engine = Engine(moments.CAMERAS, Settings.preset("balanced", light_s=0.5, middle_layers=1))
    for index in range(30):
        engine.update(moments.moment(index, *[] if index < 10 else [moments.TABLE]))
    kernels = [light.follow_light, stale.find_gone, stale.find_seen_past, middle_layers.find_never_seen_past]
    for kernel in (*kernels, late_layers.note_standing, late_layers.select_standing, late_layers.clear_covered):
        name = kernel.py_func.__name__
        listed = {each.types for each in read() if each.name == name and "beyond" in each.uses}
        assert {to_text(types) for types in kernel.signatures} <= listed != set(), AGAIN


def test_each_listed_kernel_is_there_and_comes_after_those_that_it_calls() -> None:
    for number, kernel in enumerate(read()):
        module = importlib.import_module(f"farside.engine.kernels.{kernel.module}")
        assert not kernel.name or hasattr(module, kernel.name), AGAIN
        assert all(callee < number for callee in kernel.after)
        assert set(kernel.uses) <= set(USES)


def test_a_list_is_written_and_read_back(tmp_path: Path) -> None:
    path = tmp_path / "list.json"
    write(read(), path)
    assert read(path) == read()


def test_uses_come_in_order_and_each_kernel_once() -> None:
    picture, both = needed_for(["picture"]), needed_for(["picture", "balanced"])
    assert both[: len(picture)] == picture
    assert len(set(both)) == len(both)
    assert set(both) == set(picture) | set(needed_for(["balanced"]))


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> dict[tuple[str, str], set[tuple[str, str]]]:
    """Which kernels call which, instead of what is in the modules."""
    found: dict[tuple[str, str], set[tuple[str, str]]] = {}
    monkeypatch.setattr(listing, "_called", lambda module, name: found.get((module, name), set()))
    return found


def test_recordings_are_joined_with_callees_first(calls: dict[tuple[str, str], set[tuple[str, str]]]) -> None:
    calls |= {("a", "outer"): {("b", "inner")}, ("b", "inner"): {("b", "leaf")}}
    names = ("b", "leaf"), ("b", "inner"), ("a", "outer")
    leaf, inner, outer = (Compiled(*name, "int64", 1.0) for name in names)
    other = dataclasses.replace(leaf, types="float64")
    # The second recording has `outer` before a type of `leaf` that the first one does not need.
    joined = join({"synth": ([leaf, inner], []), "fast": ([leaf, inner, outer, other], ["c"])})
    numbers = {(kernel.name, kernel.types): number for number, kernel in enumerate(joined)}
    assert joined[numbers["leaf", "int64"]] == Kernel("b", "leaf", "int64", (), ("synth", "fast"))
    assert set(joined[numbers["inner", "int64"]].after) == {numbers["leaf", "int64"], numbers["leaf", "float64"]}
    assert joined[numbers["outer", "int64"]].uses == ("fast",)
    assert Kernel("c", "", "", (), ("fast",)) in joined
    assert all(callee < number for number, kernel in enumerate(joined) for callee in kernel.after)
