"""Ranks candidates and renders views with the model of a snapshot."""

import io
import time
from collections.abc import Mapping

import numpy as np
from PIL import Image

from fvs_engine.lab.baselines import create_selector
from fvs_engine.monitor import Monitor
from fvs_engine.plan.reach import Reach
from fvs_engine.scene.scene_model import SceneModel, Situation
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.render import to_pixels
from fvs_schema.renders import RenderFormat, ViewImage
from fvs_service.rankings.port import RankedViews, RankViews, RenderView

_PNG: Mapping[str, int] = {"compress_level": 1}
"""A fifth of the time of the default level, for a tenth to a quarter more bytes: renders have noise."""
_JPEG: Mapping[str, int] = {"quality": 85}


def rank_views(
    request: RankViews, model: SceneModel, rasterizer: Rasterizer, monitor: Monitor
) -> RankedViews:
    """Rank the request's views; raises ``InvalidInputError`` for an unknown method, ``Cancelled``."""
    started = time.perf_counter()
    clearance = request.clearance
    ranking = model.rank(
        request.views,
        create_selector(request.method),
        rasterizer,
        space=model.space(clearance.safety, clearance.no_fly, monitor),
        situation=Situation(
            here=None if request.here is None else np.array(request.here),
            reach=None if request.reach is None else Reach(radius=request.reach),
            budget=request.budget,
            taken=request.taken,
            later=request.later,
            distances=request.distances,
            seed=request.seed,
        ),
        rank_all=request.rank_all,
        monitor=monitor,
    )
    return RankedViews(
        snapshot_id=request.snapshot_id,
        iterations=model.iterations,
        gaussians=len(model.gaussians),
        candidates=ranking.candidates,
        fallback=ranking.fallback,
        registrable=ranking.registrable,
        seconds=time.perf_counter() - started,
    )


def render_view(request: RenderView, model: SceneModel, rasterizer: Rasterizer) -> bytes:
    """The file of the view or of its spectrum, as the request says."""
    image = model.render if request.image is ViewImage.RENDER else model.spectrum
    out = io.BytesIO()
    options = _PNG if request.format is RenderFormat.PNG else _JPEG
    Image.fromarray(to_pixels(image(request.view, rasterizer))).save(out, request.format.value, **options)
    return out.getvalue()
