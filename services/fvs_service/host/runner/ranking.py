"""Ranks and renders views with a state of the model."""

import io
import time

import numpy as np
from PIL import Image

from fvs_engine.lab.baselines import create_selector
from fvs_engine.monitor import Monitor
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.reach import Reach
from fvs_engine.score.log_magnitude import log_magnitude
from fvs_engine.score.selectors.interface import SelectionContext, select
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.render import render_color, to_pixels
from fvs_engine.views import PinholeView
from fvs_service.host.runner.model_states import ModelState
from fvs_service.rankings.port import RankedViews, RankViews, RenderView, ViewImage


def rank_views(
    request: RankViews, state: ModelState, rasterizer: Rasterizer, monitor: Monitor
) -> RankedViews:
    """Rank the request's views; raises ``InvalidInputError`` for an unknown method, ``Cancelled``."""
    started = time.perf_counter()
    selector = create_selector(request.method)
    space = FreeSpace(state.matter, request.clearance.safety, request.clearance.no_fly, monitor=monitor)
    assessment = state.feasibility.assess(request.views, space, monitor)
    candidates = request.views if request.rank_all else assessment.feasible(request.views)
    selection = None
    if candidates:
        selection = select(
            _context(request, candidates, state, rasterizer), selector, request.distances, monitor
        )
    return RankedViews(
        snapshot_id=state.snapshot_id,
        iterations=state.iterations,
        gaussians=len(state.gaussians),
        candidates=assessment.complete(selection.ranked if selection else (), request.distances),
        fallback=selection.fallback if selection else None,
        registrable=assessment.registrable,
        seconds=time.perf_counter() - started,
    )


def _context(
    request: RankViews, candidates: tuple[PinholeView, ...], state: ModelState, rasterizer: Rasterizer
) -> SelectionContext:
    """The input of the method that ranks ``candidates``, those of the request that may be ranked."""
    visited = (*state.visited, *request.taken)
    names = (*(view.name for view in visited), *sorted(view.name for view in candidates))
    return SelectionContext(
        gaussians=state.gaussians,
        rasterizer=rasterizer,
        sh_degree=state.sh_degree,
        visited=visited,
        candidates=candidates,
        order={name: number for number, name in enumerate(names)},
        budget=len(visited) + request.budget,
        seed=request.seed,
        step=0,
        later=(*candidates, *request.later),
        reach=None if request.reach is None else Reach(radius=request.reach),
        observations=state.observations,
        here=None if request.here is None else np.array(request.here),
    )


def render_view(request: RenderView, state: ModelState, rasterizer: Rasterizer) -> bytes:
    """A PNG of the view, or of the spectrum ln |F| of it (0 cycles/px in the middle, darker is less)."""
    color = render_color(state.gaussians, request.view, rasterizer, sh_degree=state.sh_degree)
    if request.image is ViewImage.RENDER:
        return _png(to_pixels(color))
    spectrum = log_magnitude(color)
    finite = spectrum[np.isfinite(spectrum)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    shares = (np.nan_to_num(spectrum, neginf=low) - low) / max(high - low, 1e-6)
    return _png(to_pixels(np.clip(shares, 0.0, 1.0)))


def _png(pixels: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()
