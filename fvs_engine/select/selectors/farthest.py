"""Farthest-view sampling: the candidate that is least like any visited view."""

from fvs_engine.monitor import Monitor
from fvs_engine.score import CandidateScore, CandidateStatus
from fvs_engine.select.interface import SelectionContext
from fvs_engine.select.view_distance import view_distances


class Farthest:
    """Scores a candidate by minus its distance to the most similar visited view (``view_distances``).

    Source: farthest-point sampling (Gonzalez, 1985) over position and viewing direction, the baseline of
    the field's papers. The distance is normalised by the spread of the views. Cost: candidates × visited
    distances of six numbers; nothing is rendered (under a millisecond).
    """

    name = "farthest"

    def score(self, context: SelectionContext, monitor: Monitor | None = None) -> tuple[CandidateScore, ...]:  # noqa: ARG002
        """See ``Selector``. Without visited views all candidates are alike."""
        if context.visited:
            nearest = view_distances(context.candidates, context.visited).min(axis=1).tolist()
        else:
            nearest = [0.0] * len(context.candidates)
        return tuple(
            CandidateScore(candidate.id, -distance, CandidateStatus.RANKED, None)
            for candidate, distance in zip(context.candidates, nearest, strict=True)
        )
