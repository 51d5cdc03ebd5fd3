"""The library's public names refer to the right objects, and importing them loads nothing before they are used."""

from __future__ import annotations

import importlib
import subprocess
import sys

import farside.engine
import pytest

HOMES = {
    "Camera": "farside.engine.rig.camera",
    "Engine": "farside.engine.pipeline.engine",
    "Frame": "farside.engine.rig.frame",
    "Settings": "farside.engine.settings",
    "StereoView": "farside.engine.rig.viewer",
    "View": "farside.engine.rig.frame",
    "open_recording": "farside.engine.io.recording",
}


def loaded_by(statement: str) -> set[str]:
    """Modules that a statement loads in a fresh interpreter."""
    code = f"{statement}\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_public_names_are_the_objects_of_their_modules() -> None:
    assert set(farside.engine.__all__) == set(HOMES)
    for name, home in HOMES.items():
        assert getattr(farside.engine, name) is getattr(importlib.import_module(home), name)
        assert name in dir(farside.engine)
    with pytest.raises(AttributeError, match=r"module 'farside\.engine' has no attribute 'Motor'"):
        farside.engine.Motor  # noqa: B018


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import farside.engine", {"numpy", "numba", "farside.engine.settings"}),
        ("from farside.engine import Settings", {"numpy", "numba"}),
        ("from farside.engine import Camera, Frame, StereoView, View", {"numba"}),
        ("import farside.engine; dir(farside.engine)", {"numpy", "numba"}),
    ],
)
def test_a_name_loads_no_more_than_it_needs(statement: str, absent: set[str]) -> None:
    found = loaded_by(statement)
    assert "farside.engine" in found
    assert found & absent == set()


def test_the_engine_is_there_when_it_is_asked_for() -> None:
    assert {"numba", "farside.engine.pipeline.engine"} <= loaded_by("from farside.engine import Engine")
