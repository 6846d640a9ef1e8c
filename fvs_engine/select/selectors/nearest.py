"""The nearest candidate: as little travel as there can be."""

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.score import CandidateScore, CandidateStatus
from fvs_engine.select.interface import SelectionContext
from fvs_engine.select.view_distance import centre


class Nearest:
    """Scores a candidate by how far the camera, at the last visited view, has to travel to its centre.

    In units of the model frame. Source: the greedy walk (nearest neighbour tour), a bound for travel. Cost:
    none; nothing is rendered. Raises ``InvalidInputError`` without a visited view.
    """

    name = "nearest"

    def score(
        self,
        context: SelectionContext,
        monitor: Monitor | None = None,  # noqa: ARG002 - over at once
    ) -> tuple[CandidateScore, ...]:
        """See ``Selector``."""
        if not context.visited:
            raise InvalidInputError("The nearest view is not known before the first visit.")
        here = centre(context.visited[-1])
        return tuple(
            CandidateScore(
                candidate.id,
                float(np.linalg.norm(centre(candidate) - here)),
                CandidateStatus.RANKED,
                None,
            )
            for candidate in context.candidates
        )
