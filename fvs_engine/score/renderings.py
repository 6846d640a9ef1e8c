"""Scores of what the model shows at candidates: render, measure the images, judge what was measured."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import torch
from torch import Tensor

from fvs_engine.candidates import CandidateStatus
from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.score.interface import Candidate, CandidateScore
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer

MIN_COVERAGE = 0.1
"""Share of a view that the model must fill for its score to be compared with others'."""

_BATCH_PIXELS = 1 << 23
"""Pixels whose spectra a GPU computes at once; a CPU is busy with one image at a time."""


def score_renderings(
    measure: Callable[[Tensor], Tensor],
    gaussians: Gaussians,
    candidates: Sequence[Candidate],
    rasterizer: Rasterizer,
    *,
    min_coverage: float,
    sh_degree: int | None = None,
    monitor: Monitor | None = None,
) -> tuple[CandidateScore, ...]:
    """One score per candidate: ``measure`` of its render on black.

    ``measure`` maps images [B, H, W, 3] to values [B]; what it cannot measure is not finite. Raises
    ``InvalidInputError`` for images of different sizes, ``Cancelled`` when the monitor says so.
    """
    monitor = monitor or Monitor()
    scores: list[CandidateScore] = []
    for batch in _batches(candidates, rasterizer.device):
        colors, alphas = [], []
        for candidate in batch:
            monitor.check()
            with torch.no_grad():
                rendering = rasterizer.render(
                    gaussians, candidate.camera, candidate.camera_from_model, sh_degree=sh_degree
                )
            colors.append(rendering.color)
            alphas.append(rendering.alpha.mean())
        values = measure(torch.stack(colors)).tolist()
        for candidate, value, alpha in zip(batch, values, torch.stack(alphas).tolist(), strict=True):
            scores.append(judged(candidate.id, value, alpha, min_coverage))
        monitor.report("score", len(scores), len(candidates))
    return tuple(scores)


def judged(candidate_id: str, value: float, coverage: float, min_coverage: float) -> CandidateScore:
    """The score with its status: out of the model where nothing is in view or ``value`` is not finite.

    A ``coverage`` outside of [0, 1] is brought into it; one that is no number counts as 0.
    """
    coverage = 0.0 if math.isnan(coverage) else min(max(coverage, 0.0), 1.0)
    if coverage == 0.0 or not math.isfinite(value):
        return CandidateScore(candidate_id, None, CandidateStatus.OUT_OF_MODEL, coverage)
    status = CandidateStatus.RANKED if coverage >= min_coverage else CandidateStatus.LOW_COVERAGE
    return CandidateScore(candidate_id, value, status, coverage)


def check_min_coverage(min_coverage: float) -> None:
    """Raise ``InvalidInputError`` for what is no share."""
    if not 0.0 <= min_coverage <= 1.0:
        raise InvalidInputError(f"min_coverage must be in [0, 1], not {min_coverage}.")


def _batches(candidates: Sequence[Candidate], device: torch.device) -> Iterator[tuple[Candidate, ...]]:
    """Candidates in groups that the device can take at once; refuses images of different sizes."""
    sizes = {(candidate.camera.width, candidate.camera.height) for candidate in candidates}
    if len(sizes) > 1:
        raise InvalidInputError(
            "Scores of images of different sizes cannot be compared: "
            + ", ".join(f"{width} × {height}" for width, height in sorted(sizes))
            + ".",
            hint="Give all candidates one image size (width and height of their camera), or rank them apart.",
        )
    size = 1
    if device.type != "cpu" and sizes:
        width, height = sizes.pop()
        size = max(1, _BATCH_PIXELS // (width * height))
    remaining = iter(candidates)
    while batch := tuple(islice(remaining, size)):
        yield batch
