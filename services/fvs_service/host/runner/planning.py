"""Generates candidates, plans flights and forecasts views with the model of a snapshot."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.distances import spread, view_points
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.generate import Aim, candidates_in
from fvs_engine.plan.kriging import noise_of, variances
from fvs_engine.plan.outlook import Expectations
from fvs_engine.plan.plan_records import Plan
from fvs_engine.plan.surface import surface_of
from fvs_engine.plan.tours import Budget
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.views import PinholeView
from fvs_service.rankings.port import (
    Clearance,
    ForecastViews,
    GeneratedViews,
    GenerateViews,
    PlanViews,
    UpdateQuality,
    ViewForecasts,
)


def generate_views(request: GenerateViews, model: SceneModel, monitor: Monitor) -> GeneratedViews:
    """Generate candidates in a volume.

    Raises ``InvalidInputError`` when none is clear of matter, and ``Cancelled``.
    """
    wanted = request.views
    return GeneratedViews(
        views=candidates_in(
            wanted.volume,
            wanted.count,
            wanted.camera,
            up=wanted.up,
            aim=Aim(wanted.aim, wanted.level),
            space=_space(request.clearance, model, monitor),
        )
    )


def plan_views(request: PlanViews, model: SceneModel, monitor: Monitor) -> Plan:
    """Plan a flight; raises ``InvalidInputError`` for what cannot be flown, and ``Cancelled``."""
    clearance = request.clearance
    return model.plan(
        request.views,
        Budget(request.budget, request.distance, request.home, scale=request.scale),
        [np.array(start) for start in request.starts] or [model.views[-1].centre],
        lambda spread: _seen(request.updates, {view.name: view for view in model.views}, spread),
        targets=request.targets,
        taken=request.taken,
        space=None if clearance is None else _space(clearance, model, monitor),
        monitor=monitor,
    )


def forecast_views(request: ForecastViews, model: SceneModel, monitor: Monitor) -> ViewForecasts:
    """Forecast views or the surface.

    Equal poses have equal variances in all requests: the scale of distances is that of the model's views
    alone. Raises ``InvalidInputError`` for a surface without points, and ``Cancelled``.
    """
    scale = spread(model.views) or spread(request.views)
    places: tuple[tuple[float, float, float], ...] = ()
    if request.surface is None:
        points = view_points(request.views, scale)
    else:
        surface = surface_of(_observations(model), request.surface)
        points, places = surface.view_points(scale), tuple(map(tuple, surface.places.tolist()))
    monitor.check()
    visited = (*model.views, *request.after)
    found = variances(points, view_points(visited, scale), noise_of(visited))
    seen = _seen(request.updates, {view.name: view for view in model.views}, scale)
    expectations = Expectations(seen)
    return ViewForecasts(
        calibrated=expectations.calibrated, views=expectations.of_views(found), places=places
    )


def _observations(model: SceneModel) -> Observations:
    found = model.observations
    if found is None or not len(found.points):
        raise InvalidInputError(
            "The model has no sparse points, so its surface is unknown.",
            hint="Ask for candidates or a generator instead.",
        )
    return found


def _space(clearance: Clearance, model: SceneModel, monitor: Monitor) -> FreeSpace:
    return model.space(clearance.safety, clearance.no_fly, monitor)


def _seen(updates: Sequence[UpdateQuality], by_image: dict[str, PinholeView], spread: float) -> list[Seen]:
    """The mean PSNR of each update's new images before they were trained on, and their mean variance then.

    By their present poses: those of the time are gone, and the model frame stays the same.
    """
    known: list[PinholeView] = []
    found = []
    for update in updates:
        new = [by_image[image] for image in update.images if image in by_image]
        if update.psnr_db is not None and new and known:
            at = variances(view_points(new, spread), view_points(known, spread), noise_of(known))
            found.append(Seen(float(at.mean()), update.psnr_db))
        known += new
    return found
