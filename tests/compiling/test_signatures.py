"""Types of kernels' arguments become text and come back."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.compiling.needed import read
from farside.engine.compiling.signatures import from_text, to_text
from farside.engine.kernels.background.nontrivial import Rules
from numba import typeof, types


def test_kinds_of_arguments_come_back() -> None:
    rules = Rules(0.0, 1.0, 1, 0.1, 0.1, 3, 0, 0, 0, np.empty(4, np.uint16))
    values = (
        1, 1.5, True, np.float32(1), np.uint8(2), np.zeros((2, 3)), np.zeros((2, 3, 4), np.uint16)[:, ::2],
        np.asfortranarray(np.zeros((2, 2), np.int32)), (1, 2), (1, 2.0), (np.zeros(2), (1, 1.0)), rules,
    )  # fmt: skip
    kinds = (*map(typeof, values), types.literal(-3), types.literal(False), types.Omitted(4))
    assert from_text(to_text(kinds)) == kinds


def test_all_that_are_listed_come_back() -> None:
    for kernel in read():
        assert to_text(from_text(kernel.types)) == kernel.types


@pytest.mark.parametrize("text", ["int65", "float64[2]", "Type", "float64[2C]x", "no.such:Thing(int64)"])
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises((ValueError, ImportError)):
        from_text(text)


def test_a_type_without_a_form_is_refused() -> None:
    with pytest.raises(ValueError, match="type: unicode_type: expected"):
        to_text([types.unicode_type])
