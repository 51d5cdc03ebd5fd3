"""How far apart two surfaces may be that are taken as one: a length, or an error of disparity where that is more."""

from __future__ import annotations

from .jit import inlined

__all__ = ["Slack", "slack_at"]

Slack = tuple[float, float]  # metres anywhere; 1/m, which makes lengths that grow with the square of the distance


@inlined
def slack_at(slack: Slack, distance: float) -> float:
    """The slack at a distance, metres: an error e of 1 / z is one of e z^2 in z."""
    return max(slack[0], slack[1] * distance * distance)
