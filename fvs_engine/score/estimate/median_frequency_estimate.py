"""The median frequency of every candidate, estimated."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from fvs_engine.candidates import CandidateScore
from fvs_engine.compilation.ahead import ensure_compiled
from fvs_engine.monitor import Monitor
from fvs_engine.score.estimate.cells import cover
from fvs_engine.score.estimate.splat_table import SplatTable
from fvs_engine.score.parallel import map_in_order
from fvs_engine.score.renderings import MIN_COVERAGE, check_min_coverage, judged, require_one_size
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.stages import Stage

_CPU = torch.device("cpu")


def compile_kernels(monitor: Monitor) -> None:
    """Compile the kernels of the estimate unless they are cached; ``monitor`` reports the compilation."""
    ensure_compiled("fvs_engine.score.estimate.warm_up", cover, monitor)


@dataclass(frozen=True)
class MedianFrequencyEstimate:
    """Estimates the median frequency (``MedianFrequency``) of a candidate without a rendering; on the CPU.

    Estimates differ from the scores by about the same for all candidates of a model, and colours are
    those of degree 0. A view that the model fills by less than ``min_coverage`` is reported as
    ``low-coverage``.
    """

    min_coverage: float = MIN_COVERAGE

    name = "median-frequency-estimate"

    def __post_init__(self) -> None:
        check_min_coverage(self.min_coverage)

    def score(
        self,
        gaussians: Gaussians,
        candidates: Sequence[PinholeView],
        rasterizer: Rasterizer,  # noqa: ARG002 - nothing is rendered
        *,
        sh_degree: int | None = None,  # noqa: ARG002
        monitor: Monitor | None = None,
    ) -> tuple[CandidateScore, ...]:
        """See ``Scorer``; neither ``rasterizer`` nor ``sh_degree`` is used."""
        monitor = monitor or Monitor()
        require_one_size(candidates)
        compile_kernels(monitor)
        table = SplatTable.of(gaussians)

        def score_of(candidate: PinholeView) -> CandidateScore:
            monitor.check()
            value, coverage = table.estimate(candidate)
            return judged(candidate.name, value, coverage, self.min_coverage, estimated=True)

        scores: list[CandidateScore] = []
        for found in map_in_order(score_of, candidates, _CPU):
            scores.append(found)
            monitor.pass_on([found])
            monitor.report(Stage.ESTIMATE, len(scores), len(candidates))
        return tuple(scores)
