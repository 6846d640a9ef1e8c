"""Base of scorers that measure renders of the candidates."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from fvs_engine.candidates import CandidateScore
from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.score.parallel import map_in_order
from fvs_engine.splat.device_memory import view_bytes
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import BatchRasterizer, Rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus
from fvs_schema.stages import Stage

MIN_COVERAGE = 0.1
"""Coverage below which a view's score is not comparable with others."""


@dataclass(frozen=True)
class RenderingScorer(ABC):
    """Scores a candidate by a measure of its render on black.

    A view that the model fills by less than ``min_coverage`` is reported as ``low-coverage``, not ranked.
    """

    min_coverage: float = MIN_COVERAGE

    def __post_init__(self) -> None:
        check_min_coverage(self.min_coverage)

    @property
    @abstractmethod
    def name(self) -> str:
        """See ``Scorer``."""

    @abstractmethod
    def measure(self, images: Tensor) -> Tensor:
        """The score [B] of images [B, H, W, 3]; not finite where an image cannot be measured."""

    def prepare(self, device: torch.device, monitor: Monitor) -> None:  # noqa: B027 - most need nothing
        """Prepare for scoring on ``device``."""

    def score(
        self,
        gaussians: Gaussians,
        candidates: Sequence[PinholeView],
        rasterizer: Rasterizer,
        *,
        sh_degree: int | None = None,
        monitor: Monitor | None = None,
    ) -> tuple[CandidateScore, ...]:
        """See ``Scorer``."""
        monitor = monitor or Monitor()
        device = rasterizer.device
        self.prepare(device, monitor)

        def scores_of(batch: Sequence[PinholeView]) -> list[CandidateScore]:
            monitor.check()
            with torch.no_grad():
                images, alphas = _render_batch(rasterizer, gaussians, batch, sh_degree)
            values = self.measure(images).tolist()
            coverages = alphas.mean(dim=(1, 2)).tolist()
            return [
                judged(candidate.name, value, coverage, self.min_coverage)
                for candidate, value, coverage in zip(batch, values, coverages, strict=True)
            ]

        scores: list[CandidateScore] = []
        for found in map_in_order(scores_of, _batches(candidates, gaussians, rasterizer), device):
            scores += found
            monitor.pass_on(found)
            monitor.report(Stage.SCORE, len(scores), len(candidates))
        return tuple(scores)


def require_images(images: Tensor) -> None:
    """Raise ``InvalidInputError`` unless ``images`` is a batch [B, H, W, 3] of floating-point colours."""
    if images.ndim != 4 or images.shape[-1] != 3 or images.numel() == 0:
        raise InvalidInputError(f"Images must have shape [B, H, W, 3], not {list(images.shape)}.")
    if images.dtype not in {torch.float32, torch.float64}:
        raise InvalidInputError("Images must be float32 or float64, with colours in [0, 1].")


def judged(
    name: str, value: float, coverage: float, min_coverage: float, *, estimated: bool = False
) -> CandidateScore:
    """The score with its status: out of the model where nothing is in view or ``value`` is not finite.

    ``coverage`` is clamped to [0, 1]; NaN counts as 0.
    """
    coverage = 0.0 if math.isnan(coverage) else min(max(coverage, 0.0), 1.0)
    if coverage == 0.0 or not math.isfinite(value):
        return CandidateScore(name, None, CandidateStatus.OUT_OF_MODEL, coverage, estimated)
    status = CandidateStatus.RANKED if coverage >= min_coverage else CandidateStatus.LOW_COVERAGE
    return CandidateScore(name, value, status, coverage, estimated)


def check_min_coverage(min_coverage: float) -> None:
    """Raise ``InvalidInputError`` unless ``min_coverage`` is in [0, 1]."""
    if not 0.0 <= min_coverage <= 1.0:
        raise InvalidInputError(f"min_coverage must be in [0, 1], not {min_coverage}.")


def require_one_size(candidates: Sequence[PinholeView]) -> None:
    """Raise ``InvalidInputError`` for images of different sizes."""
    sizes = {(candidate.camera.width, candidate.camera.height) for candidate in candidates}
    if len(sizes) > 1:
        raise InvalidInputError(
            "Scores of images of different sizes cannot be compared: "
            + ", ".join(f"{width} × {height}" for width, height in sorted(sizes))
            + ".",
            hint="Give all candidates one image size (width and height of their camera), or rank them apart.",
        )


def _batches(
    candidates: Sequence[PinholeView], gaussians: Gaussians, rasterizer: Rasterizer
) -> list[Sequence[PinholeView]]:
    """Candidates in groups that the device can take at once; raises for images of different sizes."""
    require_one_size(candidates)
    size = 1  # each thread of a CPU takes one image at a time
    if candidates and rasterizer.batch_bytes:
        camera = candidates[0].camera
        size = max(1, rasterizer.batch_bytes // view_bytes(gaussians, camera.width, camera.height))
    return [candidates[start : start + size] for start in range(0, len(candidates), size)]


def _render_batch(
    rasterizer: Rasterizer, gaussians: Gaussians, views: Sequence[PinholeView], sh_degree: int | None
) -> tuple[Tensor, Tensor]:
    """Colours [B, H, W, 3] and alphas [B, H, W] of views of one size."""
    if isinstance(rasterizer, BatchRasterizer):
        return rasterizer.render_batch(gaussians, views, sh_degree=sh_degree)
    rendered = [
        rasterizer.render(gaussians, view.camera, view.camera_from_model, sh_degree=sh_degree)
        for view in views
    ]
    if len(rendered) == 1:  # needs no copy
        return rendered[0].color[None], rendered[0].alpha[None]
    return torch.stack([one.color for one in rendered]), torch.stack([one.alpha for one in rendered])
