"""Ranks and renders views with a state of the model."""

import io
import time

import numpy as np
from PIL import Image

from fvs_engine.monitor import Monitor
from fvs_engine.plan.reach import Reach
from fvs_engine.score.log_magnitude import log_magnitude
from fvs_engine.select.interface import SelectionContext, select
from fvs_engine.select.selectors import create_selector
from fvs_engine.select.selectors.kriging import Kriging
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.render import render_color, to_pixels
from fvs_service.rankings.port import RankedViews, RankViews, RenderView, ViewImage
from fvs_service.worker.runner.model_states import ModelState


def rank_views(
    request: RankViews, state: ModelState, rasterizer: Rasterizer, monitor: Monitor
) -> RankedViews:
    """Rank the request's views; raises ``InvalidInputError`` for an unknown method, ``Cancelled``."""
    visited = (*state.visited, *request.taken)
    names = (*(view.name for view in visited), *sorted(view.name for view in request.views))
    selector = create_selector(request.method)
    context = SelectionContext(
        gaussians=state.gaussians,
        rasterizer=rasterizer,
        sh_degree=state.sh_degree,
        visited=visited,
        candidates=request.views,
        order={name: number for number, name in enumerate(names)},
        budget=len(visited) + request.budget,
        seed=request.seed,
        step=0,
        later=(*request.views, *request.later),
        reach=None if request.reach is None else Reach(radius=request.reach),
        observations=state.observations if isinstance(selector, Kriging) else None,
        here=None if request.here is None else np.array(request.here),
    )
    started = time.perf_counter()
    selection = select(context, selector, request.distances, monitor)
    return RankedViews(
        snapshot_id=state.snapshot_id,
        iterations=state.iterations,
        gaussians=len(state.gaussians),
        candidates=selection.ranked,
        fallback=selection.fallback,
        registrable=_registrable(context) if isinstance(selector, Kriging) else None,
        seconds=time.perf_counter() - started,
    )


def _registrable(context: SelectionContext) -> int | None:
    """How many candidates are likely to be registered."""
    targets = context.planning
    if targets.likely is None:
        return None
    return int(targets.likely[[targets.index[view.name] for view in context.candidates]].sum())


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
