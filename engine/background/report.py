"""The report on a frame's update of the background model."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from ..support.stages import Stages

__all__ = ["UpdateReport"]


@dataclass(slots=True)
class UpdateReport:
    """One frame's update of the model. Numbers of pixels: updated, candidates, accepted; numbers of triangles: added
    (by captures of cameras that have moved), culled, hidden (from the viewing space), s_pbs, s_pbs_valid, p_pbs."""

    frame_index: int
    group: tuple[str, ...]  # reference cameras whose part of the P-PBS had its turn
    updated: int = 0
    candidates: int = 0
    accepted: int = 0
    added: int = 0
    rays: int = 0
    culled: int = 0
    hidden: int = 0
    s_pbs: int = 0
    s_pbs_valid: int = 0
    p_pbs: int = 0
    stages: Stages = dataclasses.field(default_factory=Stages)
