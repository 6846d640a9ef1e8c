"""Calibration: rank correlation of selectors' scores with the true errors of renders."""

import math
from collections.abc import Mapping, Sequence

from scipy.stats import spearmanr

from fvs_engine.lab.baselines import create_selector
from fvs_engine.lab.evaluate.held_out import aligned_views, psnr_at
from fvs_engine.lab.evaluate.results import Calibration, RankCorrelation
from fvs_engine.monitor import Monitor
from fvs_engine.score import CandidateScore
from fvs_engine.select.candidate_views import align
from fvs_engine.select.loop import SelectionLoop
from fvs_engine.splat.on_device import on_device
from fvs_schema.candidates import CandidateStatus
from fvs_schema.stages import Stage

_FEWEST = 3
"""Minimum number of candidates for a rank correlation: that of two is always +1 or −1."""


def calibrate(loop: SelectionLoop, methods: Sequence[str], monitor: Monitor) -> Calibration:
    """Score every unvisited view by every method, and compare the scores with the true errors there.

    Both are those of the quick model, by which views are chosen.

    This reads photographs that were not visited; the loop does not change. With estimated poses the
    candidates' poses come from the alignment, as they do for the selectors. Stage ``calibrate``, in methods.
    """
    names, scene = loop.unvisited, loop.scene
    in_reach = frozenset(loop.in_reach)
    psnr_db, found = {}, []
    with on_device(scene.rasterizer.device):
        for view in aligned_views(loop, names):
            monitor.check()
            psnr_db[view.name] = psnr_at(loop.model, view, scene.rasterizer)
        context = loop.context(names, align(scene))
        for done, method in enumerate(methods, start=1):
            scores = create_selector(method).score(context, monitor)
            found.append(rank_correlation(method, scores, psnr_db, in_reach))
            monitor.report(Stage.CALIBRATE, done, len(methods))
    return Calibration(visited=len(loop.visited), selectors=tuple(found))


def rank_correlation(
    method: str, scores: Sequence[CandidateScore], psnr_db: Mapping[str, float], in_reach: frozenset[str]
) -> RankCorrelation:
    """Rank correlation between the scores of ``method`` and the true errors of the candidates' renders.

    The lowest score comes first, and the error is −PSNR: the correlation of the two orders is that of scores
    with PSNR. Only candidates with a rank count: views that hardly show the model come last, whatever their
    score. ``in_reach`` is left out where it holds all candidates.
    """
    scored = {
        score.name: score.score
        for score in scores
        if score.score is not None and score.status is CandidateStatus.RANKED
    }
    near = {name: value for name, value in scored.items() if name in in_reach}
    return RankCorrelation(
        method=method,
        all_candidates=_spearman(scored, psnr_db),
        in_reach=None if len(in_reach) == len(scores) else _spearman(near, psnr_db),
        candidates=len(scores),
        scored=len(scored),
    )


def _spearman(scores: Mapping[str, float], psnr_db: Mapping[str, float]) -> float | None:
    """Spearman's ρ; None where it is not defined."""
    values, truths = list(scores.values()), [psnr_db[name] for name in scores]
    if len(values) < _FEWEST or min(values) == max(values) or min(truths) == max(truths):
        return None
    correlation = float(spearmanr(values, truths).statistic)
    return correlation if math.isfinite(correlation) else None
