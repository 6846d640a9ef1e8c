"""COVER: chooses the view whose Gaussians were seen least, or only from other directions."""

from dataclasses import dataclass

import torch
from torch import Tensor

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.score import MIN_COVERAGE, CandidateScore, check_min_coverage, judged
from fvs_engine.score.selectors.interface import SelectionContext
from fvs_engine.splat.floaters import blending_weights
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.spherical_harmonics import dc_from_color
from fvs_engine.splat.views import counted_pixels
from fvs_engine.views import PinholeView
from fvs_schema.stages import Stage

SEEN_PX = 0.5
"""Minimum sum of blending weights, in px, of a Gaussian that counts as seen in a visited view."""


@dataclass(frozen=True)
class Coverage:
    """Scores a candidate by how well its pixels are covered already, in [0, 1]: the least covered first.

    A Gaussian's coverage from a candidate is (1 + max_c d_c·d) / 2, with the directions d to the candidate
    and d_c to the visited cameras c that saw it: 1 where one looked from the same direction, 0 where only the
    opposite side or nothing was seen. A camera "saw" a Gaussian that was neither occluded nor masked
    (``SEEN_PX``). The coverages are rendered like a colour and averaged over the image. Where the model
    leaves a pixel empty, nothing was ever observed: that share counts as covered by ``empty_coverage`` (0:
    not at all). Colours and their errors have no influence.

    Score: share of the image that was seen from a similar direction; 0 to 1. Source: Chen, Dai et al.,
    "Coverage Optimization for Camera View Selection" (COVER), CVPR 2026, which takes every Gaussian in a
    camera's view as seen. Cost: a render per candidate, a gradient per visited view, and Gaussians × visited
    views products per candidate.
    """

    empty_coverage: float = 0.0
    min_coverage: float = MIN_COVERAGE
    name = "coverage"

    def __post_init__(self) -> None:
        check_min_coverage(self.min_coverage)
        if not 0.0 <= self.empty_coverage <= 1.0:
            raise InvalidInputError(f"empty_coverage must be in [0, 1], not {self.empty_coverage}.")

    def score(self, context: SelectionContext, monitor: Monitor | None = None) -> tuple[CandidateScore, ...]:
        """See ``Selector``."""
        monitor = monitor or Monitor()
        total = len(context.visited) + len(context.candidates)
        gaussians, rasterizer = context.gaussians, context.rasterizer
        seen_from = gaussians.means.new_zeros((len(context.visited), 4, len(gaussians)))
        for done, view in enumerate(context.visited):
            monitor.check()
            weights = blending_weights(gaussians, view, rasterizer, counted_pixels(view))
            seen = weights >= SEEN_PX
            seen_from[done, :3] = _directions(gaussians, view) * seen
            seen_from[done, 3] = -1.0 * ~seen  # to be added to d_c · d: −1 where this camera saw nothing
            monitor.report(Stage.COVERAGE, done + 1, total)
        scores = []
        for done, view in enumerate(context.candidates, start=len(context.visited) + 1):
            monitor.check()
            values = directional_coverage(seen_from, _directions(gaussians, view))
            with torch.no_grad():
                shown = _painted(gaussians, dc_from_color(values[:, None].expand(-1, 3)))
                rendering = rasterizer.render(shown, view.camera, view.camera_from_model)
            alpha = float(rendering.alpha.mean())
            value = float(rendering.color[..., 0].mean()) + self.empty_coverage * (1 - alpha)
            scores.append(judged(view.name, value, alpha, self.min_coverage))
            monitor.pass_on(scores[-1:])
            monitor.report(Stage.COVERAGE, done, total)
        return tuple(scores)


def directional_coverage(seen_from: Tensor, directions: Tensor) -> Tensor:
    """(1 + max_c d_c·d) / 2 for every Gaussian: [N] in [0, 1], 0 where no camera saw it.

    ``seen_from`` [V, 4, N]: d_c and 0, or 0, 0, 0 and −1 where camera c did not see the Gaussian;
    ``directions`` [3, N] to where it would be seen from now.
    """
    best = directions.new_full(directions.shape[1:], -1.0)
    x, y, z = directions
    for camera in seen_from:
        cosine = torch.addcmul(camera[3], camera[0], x).addcmul_(camera[1], y).addcmul_(camera[2], z)
        torch.maximum(best, cosine, out=best)
    return (0.5 + 0.5 * best).clamp_(0.0, 1.0)


def _directions(gaussians: Gaussians, view: PinholeView) -> Tensor:
    """Unit vectors [3, N] from every Gaussian to the camera's centre."""
    means = gaussians.means.detach()
    here = torch.as_tensor(view.centre, dtype=means.dtype, device=means.device)
    return torch.nn.functional.normalize(here - means, dim=1).T.contiguous()


def _painted(gaussians: Gaussians, dc: Tensor) -> Gaussians:
    """The same shapes in other colours, which do not depend on the direction of view."""
    tensors = {name: tensor.detach() for name, tensor in gaussians.tensors().items()}
    return Gaussians(**{**tensors, "sh_dc": dc, "sh_rest": tensors["sh_rest"][:, :0]})
