"""The first candidates by their exact median frequency, without rendering all of them.

All are estimated. Then views are rendered and scored exactly, those first that are most likely among the
first ``first``: their scores are predicted from the estimates and from the exact scores so far
(``regression``). It ends when fewer than ``EXPECTED_MISSES`` of the others are expected to belong there. This
relies on the prediction: it was measured, not proved.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

from fvs_engine.candidates import CandidateScore
from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.plan.distances import distances_between, spread, view_points
from fvs_engine.score.estimate.median_frequency_estimate import MedianFrequencyEstimate
from fvs_engine.score.median_frequency import MedianFrequency
from fvs_engine.score.regression import Floats, Prediction, predict
from fvs_engine.score.renderings import MIN_COVERAGE, check_min_coverage
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus
from fvs_schema.stages import Stage

FIRST = 10
EXPECTED_MISSES = 0.03
TO_BEGIN_WITH = 16
"""Candidates measured before the first prediction: half of them the lowest estimates, half far apart."""
AT_ONCE = 8
"""Candidates measured between two predictions: fixed, so that threads do not change the result."""
TOO_FEW = 4
"""Up to this multiple of ``first``, all candidates are measured."""
DOUBTFUL_COVERAGE = 0.5
"""A view with this multiple of the minimum coverage may be measured: its coverage is an estimate, too."""


@dataclass(frozen=True)
class MedianFrequencyFast:
    """``MedianFrequency``, exact for the ``first`` candidates; the others' scores are predictions.

    On a GPU, which renders quickly, and for few candidates all are exact.
    """

    first: int = FIRST
    min_coverage: float = MIN_COVERAGE

    name = "median-frequency-fast"

    def __post_init__(self) -> None:
        check_min_coverage(self.min_coverage)
        if self.first < 1:
            raise InvalidInputError(f"The number of exact candidates must be 1 or more, not {self.first}.")

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
        exact = MedianFrequency(self.min_coverage)
        if rasterizer.device.type != "cpu" or len(candidates) <= TOO_FEW * self.first:
            return exact.score(gaussians, candidates, rasterizer, sh_degree=sh_degree, monitor=monitor)
        estimate = MedianFrequencyEstimate(self.min_coverage)
        estimates = estimate.score(gaussians, candidates, rasterizer, monitor=_Estimating(monitor))
        ranking = _Ranking(candidates, estimates, self.first, self.min_coverage)
        with threadpool_limits(1, "blas"):  # after each prediction its other threads keep cores busy, waiting
            while wanted := ranking.to_measure():
                monitor.report(Stage.SCORE, len(ranking.measured))
                ranking.add(
                    wanted,
                    exact.score(
                        gaussians,
                        [candidates[i] for i in wanted],
                        rasterizer,
                        sh_degree=sh_degree,
                        monitor=_Measuring(monitor),
                    ),
                )
        scores = ranking.scores()
        monitor.pass_on([score for score in scores if score.estimated])
        return scores


class _Ranking:
    """The candidates' scores so far, and the choice of those to measure next."""

    def __init__(
        self,
        candidates: Sequence[PinholeView],
        estimates: Sequence[CandidateScore],
        first: int,
        min_coverage: float,
    ) -> None:
        self.measured: dict[int, CandidateScore] = {}
        self._estimates = estimates
        self._first = first
        self._points = view_points(candidates, spread(candidates))
        self._values = np.array([math.nan if e.score is None else e.score for e in estimates])
        coverages = np.array([e.coverage for e in estimates], dtype=np.float64)
        self._may_rank = np.isfinite(self._values) & (coverages >= DOUBTFUL_COVERAGE * min_coverage)

    def to_measure(self) -> list[int]:
        """The candidates to measure next; none once the first ones are known."""
        left = np.array([i for i in np.flatnonzero(self._may_rank) if i not in self.measured], dtype=np.int64)
        if len(left) + len(self.measured) <= TOO_FEW * self._first:
            return [int(i) for i in left]
        if not self.measured:
            return self._to_begin_with(left)
        prediction = self._prediction()
        if prediction is None:
            return [int(i) for i in left[np.argsort(self._values[left], kind="stable")[:AT_ONCE]]]
        means, deviations = prediction.means[left], prediction.deviations[left]
        chances = ndtr((self._last_score() - means) / deviations)
        if chances.sum() < EXPECTED_MISSES:
            return []
        return [int(i) for i in left[np.lexsort((means, -chances))[:AT_ONCE]]]

    def add(self, indices: Sequence[int], scores: Sequence[CandidateScore]) -> None:
        """Record exact scores."""
        self.measured.update(zip(indices, scores, strict=True))

    def scores(self) -> tuple[CandidateScore, ...]:
        """All scores: exact where measured, predicted elsewhere."""
        prediction = self._prediction()
        means = self._values if prediction is None else prediction.means
        return tuple(
            self.measured.get(i) or (e if e.score is None else replace(e, score=float(means[i])))
            for i, e in enumerate(self._estimates)
        )

    def _to_begin_with(self, left: NDArray[np.int64]) -> list[int]:
        order = left[np.argsort(self._values[left], kind="stable")]
        chosen = [int(i) for i in order[: TO_BEGIN_WITH // 2]]
        separation = distances_between(self._points[left], self._points[chosen]).min(axis=1)
        while len(chosen) < TO_BEGIN_WITH:
            farthest = int(np.argmax(separation))
            chosen.append(int(left[farthest]))
            apart = distances_between(self._points[left], self._points[left[farthest], None]).min(axis=1)
            separation = np.minimum(separation, apart)
        return sorted(set(chosen))

    def _last_score(self) -> float:
        """The score of the last of the first candidates, as far as they are known."""
        ranked = [s.score for s in self.measured.values() if s.status is CandidateStatus.RANKED]
        scores = sorted(score for score in ranked if score is not None)
        return scores[self._first - 1] if len(scores) >= self._first else math.inf

    def _prediction(self) -> Prediction | None:
        """Predicted scores of all candidates (NaN without an estimate); None when too few are measured."""
        known = {i: s.score for i, s in self.measured.items() if s.score is not None}
        if len(known) < TO_BEGIN_WITH // 2:
            return None
        finite = np.flatnonzero(np.isfinite(self._values))
        places = {int(i): place for place, i in enumerate(finite)}
        measured = np.array([places[i] for i in known], dtype=np.int64)
        found = predict(self._values[finite], self._points[finite], measured, np.array(list(known.values())))
        return Prediction(self._spread_out(finite, found.means), self._spread_out(finite, found.deviations))

    def _spread_out(self, finite: NDArray[np.int64], values: Floats) -> Floats:
        all_values = np.full(len(self._values), math.nan)
        all_values[finite] = values
        return all_values


class _Estimating(Monitor):
    """Forwards progress and cancellation, but no scores: better ones follow."""

    def __init__(self, outer: Monitor) -> None:
        super().__init__()
        self._outer = outer

    def receive(self, progress: Progress) -> None:
        self._outer.receive(progress)

    def check(self) -> None:
        self._outer.check()


class _Measuring(_Estimating):
    """Forwards scores, but no progress: the number of measurements is not known in advance."""

    def receive(self, progress: Progress) -> None:
        pass

    def pass_on(self, results: Sequence[object]) -> None:
        self._outer.pass_on(results)
