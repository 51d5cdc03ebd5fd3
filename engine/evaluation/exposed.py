"""Newly exposed triangles against those that survive foreground culling (paper Fig. 11a and 12b)."""

from __future__ import annotations

from ..background.report import UpdateReport

__all__ = ["ExposedTriangles"]


class ExposedTriangles:
    """Counts, from frame to frame, the triangles that the P-PBS would have if nothing were ever culled from it.

    That is the paper's "size of newly exposed triangles simply accumulated without the foreground culling": the
    triangles of the P-PBS and all that were culled from it so far. Triangles that were culled from the S-PBS are left
    out: they were exposed by the first frame.
    """

    def __init__(self) -> None:
        self._culled = 0
        self._static: int | None = None

    def take(self, report: UpdateReport) -> int:
        """The number of triangles after the update that `report` tells of; each update is taken once, in order."""
        if self._static is not None:
            self._culled += report.culled - (self._static - report.s_pbs_valid)
        self._static = report.s_pbs_valid
        return report.p_pbs + self._culled
