"""The README: short, and every example of it runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.checkout import ROOT
from support.shared import SHARED, needs_shared

README = (ROOT / "README.md").read_text("utf-8")
RECORDING, ARRAYS = re.findall(r"^```python\n(.*?)^```$", README, re.M | re.S)


def test_it_is_short() -> None:
    assert README.count("\n") <= 130


def test_what_it_links_to_is_there() -> None:
    links = re.findall(r"\]\(([^)#:]+)\)", README)
    assert len(links) > 5
    assert [link for link in links if not (ROOT / link).exists()] == []


@needs_shared
def test_the_example_with_a_recording_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(SHARED / "sequences")
    names: dict[str, object] = {}
    exec(RECORDING, names)
    picture = names["picture"]
    assert picture.texture.y.shape == (360, 480)  # type: ignore[attr-defined]
    assert picture.texture.y.std() > 50  # type: ignore[attr-defined]


def test_the_example_with_arrays_shows_a_wall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(ARRAYS, names)
    for eye in (names["pair"].left, names["pair"].right):  # type: ignore[attr-defined]
        seen = eye.disparity[20:-20, 20:-20]
        np.testing.assert_allclose(seen, 1 / 2.5, rtol=1e-3)  # 2500 mm ahead, from between the cameras
        assert np.ptp(eye.texture.y[20:-20, 20:-20].astype(int)) <= 1  # one grey
