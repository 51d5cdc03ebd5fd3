"""delta, the culling tolerance (sections 3.3.2 and 3.3.3, Fig. 6): surfaces nearer to one another count as one.

The paper has a single length. Depth that is coded or estimated as disparity becomes less accurate with distance, so
here delta is a length, or an error of disparity where that is more.
"""

from __future__ import annotations

from .jit import inlined

__all__ = ["Delta", "delta_at"]

Delta = tuple[float, float]  # metres anywhere; 1/m, which makes lengths that grow with the square of the distance


@inlined
def delta_at(delta: Delta, distance: float) -> float:
    """delta at a distance, metres: an error e of 1 / z is an error e z^2 of z."""
    return max(delta[0], delta[1] * distance * distance)
