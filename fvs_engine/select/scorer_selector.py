"""Selectors that ask a scorer: they look at renders of the candidates, and at nothing else."""

from dataclasses import dataclass

from fvs_engine.monitor import Monitor
from fvs_engine.score import CandidateScore, Scorer
from fvs_engine.select.interface import SelectionContext


@dataclass(frozen=True)
class ScorerSelector:
    """A scorer as a selector of the same name."""

    scorer: Scorer

    @property
    def name(self) -> str:
        """See ``Selector``."""
        return self.scorer.name

    def score(self, context: SelectionContext, monitor: Monitor | None = None) -> tuple[CandidateScore, ...]:
        """See ``Selector``; candidates must have images of one size."""
        return self.scorer.score(
            context.gaussians,
            context.candidates,
            context.rasterizer,
            sh_degree=context.sh_degree,
            monitor=monitor,
        )
