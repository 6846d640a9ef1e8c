"""The interface of scorers."""

from collections.abc import Sequence
from typing import Protocol

from fvs_engine.candidates import CandidateScore
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView


class Scorer(Protocol):
    """Scores candidates against a model. Stateless: the same input gives the same scores."""

    @property
    def name(self) -> str:
        """The method's name in results."""
        ...

    def score(
        self,
        gaussians: Gaussians,
        candidates: Sequence[PinholeView],
        rasterizer: Rasterizer,
        *,
        sh_degree: int | None = None,
        monitor: Monitor | None = None,
    ) -> tuple[CandidateScore, ...]:
        """One score per candidate, in their order; the candidates' images must have one size.

        ``sh_degree``: render with only this many degrees. Progress is reported in candidates,
        and scores are passed on to ``monitor`` as they are computed. Raises
        ``InvalidInputError`` for sizes that differ and ``Cancelled``.
        """
        ...
