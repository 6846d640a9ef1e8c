"""Answering questions from a state: rankings and pictures."""

import io
import time
from dataclasses import asdict

import numpy as np
import torch
from PIL import Image

from fvs_engine.pipeline.contact_sheet import log_magnitude
from fvs_engine.select.interface import SelectionContext, select
from fvs_engine.select.selectors import create_selector
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_service.rankings.port import Picture, RankedView, RankedViews
from fvs_service.worker.protocol import DrawQuestion, RankQuestion
from fvs_service.worker.runner.states import State


def rank_views(question: RankQuestion, state: State, rasterizer: Rasterizer) -> RankedViews:
    """Rank the question's views; raises ``InvalidInputError`` for an unknown method."""
    views = [message.view() for message in question.views]
    visited = state.visited
    candidates = tuple(PinholeView(view.id, view.camera, view.camera_from_model) for view in views)
    names = (*(view.name for view in visited), *sorted(view.id for view in views))
    context = SelectionContext(
        gaussians=state.gaussians,
        rasterizer=rasterizer,
        sh_degree=state.sh_degree,
        visited=visited,
        candidates=candidates,
        order={name: place for place, name in enumerate(names)},
        budget=len(visited) + question.budget,
        seed=question.seed,
        step=0,
    )
    distances = {view.id: view.distance_m for view in views if view.distance_m is not None}
    began = time.perf_counter()
    chosen = select(context, create_selector(question.method), distances)
    seconds = time.perf_counter() - began
    return RankedViews(
        snapshot_id=state.snapshot_id,
        iterations=state.iterations,
        gaussians=len(state.gaussians),
        views=tuple(
            RankedView(place.name, place.rank, place.score, place.status.value, place.coverage)
            for place in chosen.ranked
        ),
        fallback=chosen.fallback,
        seconds=seconds,
    )


def draw_view(question: DrawQuestion, state: State, rasterizer: Rasterizer) -> bytes:
    """A PNG of the view, or of ln |F| of it (0 cycles/px in the middle, darker is less)."""
    view = question.view.view()
    with torch.no_grad():
        rendering = rasterizer.render(
            state.gaussians, view.camera, view.camera_from_model, sh_degree=state.sh_degree
        )
    color = rendering.color.clamp(0.0, 1.0).cpu().numpy()
    if question.picture is Picture.RENDER:
        return _png(np.round(color * 255.0).astype(np.uint8))
    spectrum = log_magnitude(color)
    finite = spectrum[np.isfinite(spectrum)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    shares = (np.nan_to_num(spectrum, neginf=low) - low) / max(high - low, 1e-6)
    return _png(np.round(np.clip(shares, 0.0, 1.0) * 255.0).astype(np.uint8))


def document_of(ranked: RankedViews) -> dict[str, object]:
    """A ranking as JSON has it."""
    return asdict(ranked)


def _png(pixels: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()
