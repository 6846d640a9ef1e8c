"""The interface of scorers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from fvs_engine.candidates import CandidateStatus
from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView


@dataclass(frozen=True)
class CandidateScore:
    """The score of one candidate: the lowest ``score`` ranks first.

    ``score`` is finite, and None exactly when the candidate is out of the model. ``coverage`` in [0, 1] is
    the mean alpha of the view: the share of it that the model fills; None where nothing was rendered.
    Raises ``InvalidInputError`` otherwise.
    """

    name: str
    score: float | None
    status: CandidateStatus
    coverage: float | None

    def __post_init__(self) -> None:
        if (self.score is None) != (self.status is CandidateStatus.OUT_OF_MODEL):
            raise InvalidInputError(f"Candidate {self.name}: no score if and only if it is out of the model.")
        if self.score is not None and not math.isfinite(self.score):
            raise InvalidInputError(f"Candidate {self.name}: a score must be finite, not {self.score}.")
        if self.coverage is not None and not 0.0 <= self.coverage <= 1.0:
            raise InvalidInputError(
                f"Candidate {self.name}: coverage must be in [0, 1], not {self.coverage}."
            )


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

        ``sh_degree``: render with only this many degrees. Progress is reported in candidates. Raises
        ``InvalidInputError`` for sizes that differ and ``Cancelled``.
        """
        ...
