"""The variants that `trade` compares: each knob of `balanced`, the presets, the governor's ladder, and a grid."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..live.governor import LADDER
from ..settings import QUALITIES, Settings

__all__ = ["Variant", "variants"]

KNOBS: dict[str, tuple[object, ...]] = {
    "tolerance_px": (0.0, 0.1, 0.5, 1.0),
    "n_render": (2, 3, 4, 8),
    "blend": (1, 2, 5),
    "cubic": (False,),
    "prefilter": (False,),
    "antialias": ("none", "samples"),
    "overdraw": (False,),
    "rims": (False,),
    "fill": ("none", "smooth"),
    "output_scale": (0.5, 0.7, 0.85),
    "exposure_s": (0.0,),
    "jpeg_quality": (50, 70, 80, 95),
}
MODEL_KNOBS: dict[str, tuple[object, ...]] = {
    "background": (False,),
    "n_init": (2, 12),
    "n_update": (3, 6),
    "update_interval": (2, 4),
    "culling_stride": (1, 4),
    "pbi_scale": (0.25, 1.0),
    "pbi_margin_rad": (0.0, 0.1),
}
COLOURS: dict[str, dict[str, object]] = {
    "plain": {"blend": 1, "cubic": False, "overdraw": False, "rims": False, "antialias": "none"},
    "balanced": {},
    "fine": {"blend": 5, "antialias": "samples"},
}
GRID = (tuple(COLOURS), (2, 3, 5), (0.5, 0.7, 1.0))  # colours, views, output scale
FEW = 1  # views per picture while the model's knobs are varied


@dataclass(frozen=True, slots=True)
class Variant:
    """Settings, and the base settings whose time and quality they are measured against.

    kind: preset, picture, model, grid or ladder. knob, value: what was changed.
    """

    kind: str
    knob: str
    value: str
    settings: Settings
    base: Settings

    @property
    def is_base(self) -> bool:
        """Whether other variants are measured against this one."""
        return self.settings == self.base


def variants() -> list[Variant]:
    """All variants, each once; `balanced` is the first."""
    balanced = Settings.preset("balanced")
    few = dataclasses.replace(balanced, n_render=FEW)
    found = [Variant("preset", "preset", name, Settings.preset(name), balanced) for name in ("balanced", *QUALITIES)]
    found += _one_at_a_time("picture", KNOBS, balanced)
    found.append(Variant("model", "n_render", str(FEW), few, few))
    found += _one_at_a_time("model", MODEL_KNOBS, few)
    for name, _cost, preset, changes in LADDER:
        found.append(Variant("ladder", "rung", name, Settings.preset(preset, **changes), balanced))
    for colours, views, scale in itertools.product(*GRID):
        settings = dataclasses.replace(balanced, n_render=views, output_scale=scale, **COLOURS[colours])  # type: ignore[arg-type]
        found.append(Variant("grid", "views, scale, colours", f"{views}, {scale:g}, {colours}", settings, balanced))
    once = {(variant.settings, variant.base): variant for variant in reversed(found)}
    return [variant for variant in found if once[variant.settings, variant.base] is variant]


def _one_at_a_time(kind: str, knobs: Mapping[str, Sequence[object]], base: Settings) -> list[Variant]:
    return [
        Variant(kind, knob, f"{value:g}" if isinstance(value, float) else str(value), _changed(base, knob, value), base)
        for knob, values in knobs.items()
        for value in values
    ]


def _changed(base: Settings, knob: str, value: object) -> Settings:
    return dataclasses.replace(base, **{knob: value})  # type: ignore[arg-type]
