"""Uniform sampling over the order of capture."""

import heapq
import itertools
import math
from collections.abc import Sequence

from fvs_engine.monitor import Monitor
from fvs_engine.score import CandidateScore
from fvs_engine.score.selectors.interface import SelectionContext
from fvs_schema.candidates import CandidateStatus


class Uniform:
    """Scores a candidate by its distance, in the order of capture, to the nearest planned index.

    The remaining budget is planned at every step, so that the largest gap between neighbours is as small as
    the visited views allow (``planned_indices``). Score: distance to the nearest planned position, in places
    of the order of capture; 0 or more. Source: uniform sampling, the baseline of the field's papers, for
    initial views that need not be even and candidates of which some may be out of reach. Cost: none; nothing
    is rendered.
    """

    name = "uniform"

    def score(
        self,
        context: SelectionContext,
        monitor: Monitor | None = None,  # noqa: ARG002 - over at once
    ) -> tuple[CandidateScore, ...]:
        """See ``Selector``. A budget that is used up counts as one remaining view."""
        visited = [context.order[view.name] for view in context.visited]
        remaining = max(1, context.budget - len(visited))
        planned = planned_indices(visited, max(context.order.values(), default=0) + 1, remaining)
        return tuple(
            CandidateScore(
                candidate.name,
                min(abs(context.order[candidate.name] - index) for index in planned),
                CandidateStatus.RANKED,
                None,
            )
            for candidate in context.candidates
        )


def planned_indices(visited: Sequence[int], total: int, remaining: int) -> tuple[float, ...]:
    """``remaining`` indices in 0 … ``total`` − 1 that minimise the largest gap, in ascending order.

    Between two visited indices the planned ones are evenly spaced. At the two ends, and where nothing was
    visited, the outermost one is half a gap from the border.
    """
    taken = sorted(set(visited))
    if not taken:
        return tuple(total * (i + 0.5) / remaining - 0.5 for i in range(remaining))
    # Intervals as (start, length, gaps without a planned index): n indices cut it into n + gaps pieces.
    inner = [(float(a), float(b - a), 1.0) for a, b in itertools.pairwise(taken)]
    before, after = taken[0] + 0.5, total - 0.5 - taken[-1]
    intervals = [(-0.5, before, 0.5), *inner, (float(taken[-1]), after, 0.5)]
    counts = [0] * len(intervals)
    widest = [(-length / gaps, i) for i, (_, length, gaps) in enumerate(intervals)]
    heapq.heapify(widest)
    for _ in range(remaining):
        _, i = heapq.heappop(widest)
        counts[i] += 1
        _, length, gaps = intervals[i]
        heapq.heappush(widest, (-length / (counts[i] + gaps), i))
    places = []
    for i, ((start, length, gaps), count) in enumerate(zip(intervals, counts, strict=True)):
        spacing = length / (count + gaps) if count else math.inf
        first = 0.5 if i == 0 else 1.0
        places += [start + spacing * (first + k) for k in range(count)]
    return tuple(places)
