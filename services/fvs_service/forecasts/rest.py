"""Forecasts over REST."""

from typing import Annotated

from fastapi import Depends, Request

from fvs_schema.forecasts import Forecast, ForecastRequest
from fvs_service.forecasts.service import ReadRequest
from fvs_service.gateway.rest.bodies import unread_json_body
from fvs_service.gateway.rest.dependencies import App, Caller, Counters, SceneId, to_read
from fvs_service.gateway.rest.patience import TimeoutS, while_connected
from fvs_service.gateway.rest.routing import json_router

router = json_router("/v1", "forecasts")


@router.post("/scenes/{scene_id}/forecasts")
async def forecast_views(
    http: Request,
    app: App,
    metrics: Counters,
    caller: Caller,
    scene_id: SceneId,
    read: Annotated[ReadRequest, Depends(unread_json_body(ForecastRequest, to_read))],
    timeout_s: TimeoutS,
) -> Forecast:
    """Forecast the kriging variance of poses, or of places of the surface; possible while a job runs.

    With it comes the PSNR to expect, once three updates have measured their new images.
    With `after`, as if those views had been photographed. Nothing is rendered or stored.
    """
    with metrics.rankings_open.track_inprogress():
        return await while_connected(http, app.forecasts.create(caller, scene_id, read, timeout_s))
