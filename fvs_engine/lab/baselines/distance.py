"""Selectors by distance: the candidate least like any visited view, and the one nearest to the camera."""

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import view_distances
from fvs_engine.score import CandidateScore
from fvs_engine.score.selectors.interface import SelectionContext
from fvs_schema.candidates import CandidateStatus


class Farthest:
    """Scores a candidate by minus its distance to the most similar visited view (``view_distances``).

    Score: minus the distance to the most similar image, no unit: random views are 2 apart; 0 or less, mostly
    −3 to 0. Source: farthest-point sampling (Gonzalez, 1985) over position and viewing direction, the
    baseline of the field's papers. The distance is normalised by the spread of the views. Cost: candidates ×
    visited distances of six numbers; nothing is rendered (under a millisecond).
    """

    name = "farthest"

    def score(self, context: SelectionContext, monitor: Monitor | None = None) -> tuple[CandidateScore, ...]:  # noqa: ARG002
        """See ``Selector``. Without visited views all candidates are alike."""
        if context.visited:
            nearest = view_distances(context.candidates, context.visited).min(axis=1).tolist()
        else:
            nearest = [0.0] * len(context.candidates)
        return tuple(
            CandidateScore(candidate.name, -distance, CandidateStatus.RANKED, None)
            for candidate, distance in zip(context.candidates, nearest, strict=True)
        )


class Nearest:
    """Scores a candidate by how far the camera has to travel to its centre, in units of the model frame.

    Score: length of the way, in units of the model frame; 0 or more. Source: the nearest neighbour tour, a
    bound for travel. Nothing is rendered. Raises ``InvalidInputError`` where nothing says where the camera
    is.
    """

    name = "nearest"

    def score(
        self,
        context: SelectionContext,
        monitor: Monitor | None = None,  # noqa: ARG002 - over at once
    ) -> tuple[CandidateScore, ...]:
        """See ``Selector``."""
        here = context.centre
        if here is None:
            raise InvalidInputError("The nearest view is not known before the first visit.")
        return tuple(
            CandidateScore(
                candidate.name,
                float(np.linalg.norm(candidate.centre - here)),
                CandidateStatus.RANKED,
                None,
            )
            for candidate in context.candidates
        )
