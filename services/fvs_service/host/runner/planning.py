"""Generates candidates and plans flights with a state of the model."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.monitor import Monitor
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.distances import view_points
from fvs_engine.plan.flight import free_legs
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.generate import Aim, candidates_in
from fvs_engine.plan.kriging import variances
from fvs_engine.plan.plan import make_plan
from fvs_engine.plan.plan_warnings import candidates_too_close
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget
from fvs_engine.score.appearance import with_appearance
from fvs_engine.views import PinholeView
from fvs_service.host.runner.model_states import ModelState
from fvs_service.rankings.port import (
    Clearance,
    GeneratedViews,
    GenerateViews,
    PlannedFlight,
    PlanViews,
    UpdateQuality,
    ViewsInVolume,
)


def generate_views(request: GenerateViews, state: ModelState, monitor: Monitor) -> GeneratedViews:
    """Generate candidates in a volume.

    Raises ``InvalidInputError`` when none is clear of matter, and ``Cancelled``.
    """
    space = FreeSpace(state.matter, request.clearance.safety, request.clearance.no_fly, monitor=monitor)
    return GeneratedViews(views=_generated(request.views, space))


def plan_views(request: PlanViews, state: ModelState, monitor: Monitor) -> PlannedFlight:
    """Plan a flight; raises ``InvalidInputError`` for what cannot be flown, and ``Cancelled``."""
    clearance = request.clearance or Clearance()
    space = FreeSpace(state.matter, clearance.safety, clearance.no_fly, monitor=monitor)
    generated = () if request.generate is None else _generated(request.generate, space)
    given = generated or request.views
    candidates = state.feasibility.assess(given, space, monitor).possible(given)
    targets = Targets(
        state.visited,
        candidates,
        request.targets,
        state.observations,
        taken=request.taken,
        monitor=monitor,
    )
    starts = [np.array(start) for start in request.starts] or [state.visited[-1].centre]
    by_image = dict(zip((view.image for view in state.cameras.views), state.visited, strict=True))
    seen = _seen(request.updates, by_image, targets.spread)
    budget = Budget(request.budget, request.distance, request.home, scale=request.scale)
    legs = None if request.clearance is None else free_legs(targets.centres, np.stack(starts), space)
    plan = make_plan(targets, budget, starts, seen, legs, monitor)
    shown = with_appearance(plan, targets.later, state.gaussians, monitor)
    warnings = (*candidates_too_close(len(given) - len(candidates), len(given)), *shown.warnings)
    return PlannedFlight(plan=shown.model_copy(update={"warnings": warnings}), generated=generated)


def _generated(wanted: ViewsInVolume, space: FreeSpace) -> tuple[PinholeView, ...]:
    aim = Aim(wanted.aim, wanted.level)
    return candidates_in(wanted.volume, wanted.count, wanted.camera, up=wanted.up, aim=aim, space=space)


def _seen(updates: Sequence[UpdateQuality], by_image: dict[str, PinholeView], spread: float) -> list[Seen]:
    """The mean PSNR of each update's new images before they were trained on, and their mean variance then.

    By their present poses: those of the time are gone, and the model frame stays the same.
    """
    known: list[PinholeView] = []
    found = []
    for update in updates:
        new = [by_image[image] for image in update.images if image in by_image]
        if update.psnr_db is not None and new and known:
            at = variances(view_points(new, spread), view_points(known, spread))
            found.append(Seen(float(at.mean()), update.psnr_db))
        known += new
    return found
