"""Options of the background model that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

__all__ = ["CullStale", "LateRounds", "Light", "MiddleLayers", "ViewingSpace"]

Light = Annotated[
    float | None,
    typer.Option(
        metavar="S", help="Time constant with which the model's colours follow light that changes, s (default 0: not)."
    ),
]
CullStale = Annotated[
    bool | None,
    typer.Option(help="What a view sees past leaves the model at once, also before the sky and beyond sensors' reach."),
]
MiddleLayers = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Up to N triangles of surfaces that no camera has seen past stay in the model, as furniture in the middle "
        "of a room (default 0); brings --cull-stale with it.",
    ),
]
LateRounds = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="With --middle-layers, what is put into the room joins the model after N rounds of the cameras' turns "
        "(default 1; 0: it does not).",
    ),
]
ViewingSpace = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option(
        metavar="X Y Z R", help="Ball in which heads stay, metres: background that cannot be seen from it is not kept."
    ),
]
