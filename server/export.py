"""The background model as a file, and figures for Prometheus."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from farside.engine.io.mesh_files import colours_of
from farside.engine.rig.questions import NoModelError
from fastapi import HTTPException, Response
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from .service import Service

__all__ = ["MEDIA_TYPES", "export_mesh", "export_metrics"]

MEDIA_TYPES = {"glb": "model/gltf-binary", "ply": "application/octet-stream"}


async def export_mesh(service: Service, format_name: str, colours: str | None) -> Response:
    """The model as a file in `format_name` ("glb" or "ply"), with its colours in a texture or at the vertices
    (`io.mesh_files.colours_of`).

    Raises HTTPException: 400 for colours that the format does not have, 409 where there is no model yet, and for a
    model that the format cannot hold.
    """
    try:
        colours = colours_of(format_name, colours)
    except ValueError as error:
        raise HTTPException(400, str(error)) from error
    try:
        data = await service.live.model.mesh(format_name, colours)
    except NoModelError as error:
        raise HTTPException(409, service.no_model(error)) from error
    except ValueError as error:
        raise HTTPException(409, str(error)) from error
    headers = {"Content-Disposition": f'attachment; filename="background.{format_name}"'}
    return Response(data, media_type=MEDIA_TYPES[format_name], headers=headers)


def export_metrics(service: Service) -> bytes:
    """The service's figures in Prometheus' text format."""
    registry = CollectorRegistry()
    registry.register(_Figures(service.status()))
    return generate_latest(registry)


class _Figures(Collector):
    def __init__(self, status: dict[str, Any]) -> None:
        self._status = status

    def collect(self) -> Iterator[Metric]:
        status = self._status
        frames = CounterMetricFamily("farside_frames", "Video frames by outcome", labels=["outcome"])
        for outcome, count in status["frames"].items():
            frames.add_metric([outcome], count)
        yield frames
        left_out = CounterMetricFamily(
            "farside_views_left_out", "Views left out of their frame, by camera and reason", labels=["camera", "reason"]
        )
        for camera, reasons in status["left_out"].items():
            for reason, count in reasons.items():
                left_out.add_metric([camera, reason], count)
        yield left_out
        if (saved := status["engine"].get("saved")) is not None:
            saves = CounterMetricFamily("farside_model_saves", "Savings of the model by outcome", labels=["outcome"])
            saves.add_metric(["saved"], saved["saves"])
            saves.add_metric(["failed"], saved["failures"])
            yield saves
        stages = GaugeMetricFamily("farside_stage_ms", "Milliseconds that a stage takes", labels=["stage", "quantile"])
        for stage, summary in status["stages_ms"].items():
            stages.add_metric([stage, "0.5"], summary["p50"])
            stages.add_metric([stage, "0.95"], summary["p95"])
        yield stages
        yield GaugeMetricFamily("farside_viewers", "Viewers connected", value=len(status["viewers"]))
        yield GaugeMetricFamily("farside_source_connected", "1 if a source is connected", status["source_connected"])
        for name, value in (status["rates"] | status["event_loop"] | status["pictures"]).items():
            if value is None:  # this system does not tell
                continue
            yield GaugeMetricFamily(f"farside_{name}", name.replace("_", " "), value=value)
