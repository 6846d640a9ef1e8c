"""The interface of selectors, and the choice of one view by their scores."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fvs_engine.candidates import RankedCandidate
from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import view_distances
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.fleet import Fleet
from fvs_engine.plan.reach import Reach
from fvs_engine.plan.targets import Targets
from fvs_engine.score import CandidateScore, rank
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus


@dataclass(frozen=True, eq=False)
class SelectionContext:
    """The input of a selector.

    ``gaussians``, rendered by ``rasterizer`` with ``sh_degree`` degrees (None: all), are the model so far.
    ``visited`` are the photographed views in the order of their visit, ``candidates`` those in reach, and
    ``here`` is where the camera is now (None: at the last visited view); all in the model frame. ``order``
    maps the name of every view that may be visited to its index in the order of capture. ``budget``: views at
    the end, the first ones included. ``seed`` and ``step`` (from 0) are the only source of chance.

    For selectors that plan: ``later`` are the unvisited views that may be visited later, the candidates among
    them (empty: the candidates), and ``reach`` what each step can reach, in units of the model frame (None:
    everything). The model must serve all views that may be visited.
    ``observations`` are the sparse points where poses are estimated, so that a view which is visited must be
    registered to be of use (None: poses are known). ``fleet``: the vehicles with their places and what they
    have flown of their distance, in the model frame, the one that chooses first (None: one without a limit).

    Raises ``InvalidInputError`` for a name that occurs twice, that is both visited and a candidate, or that
    ``order`` lacks.
    """

    gaussians: Gaussians
    rasterizer: Rasterizer
    sh_degree: int | None
    visited: tuple[PinholeView, ...]
    candidates: tuple[PinholeView, ...]
    order: Mapping[str, int]
    budget: int
    seed: int
    step: int
    later: tuple[PinholeView, ...] = ()
    reach: Reach | None = None
    observations: Observations | None = None
    here: NDArray[np.float64] | None = None
    fleet: Fleet | None = None

    def __post_init__(self) -> None:
        known: set[str] = set()
        for view in (*self.visited, *self.candidates):
            if view.name in known:
                raise InvalidInputError(
                    f"View {view.name} occurs more than once among visited and candidates."
                )
            if view.name not in self.order:
                raise InvalidInputError(f"View {view.name} is not in the order of capture.")
            known.add(view.name)

    @property
    def remaining(self) -> int:
        """Views that may still be visited; a budget that is used up counts as one."""
        return max(1, self.budget - len(self.visited))

    @property
    def centre(self) -> NDArray[np.float64] | None:
        """Where the camera is [3]; None when that is not known, because nothing was visited."""
        if self.here is None and self.visited:
            return self.visited[-1].centre
        return self.here

    @cached_property
    def planning(self) -> Targets:
        """The context as the input of a plan: the same to the last bit in whatever order candidates come."""
        later = sorted(self.later or self.candidates, key=lambda view: view.name)
        return Targets(self.visited, later, observations=self.observations)


class Selector(Protocol):
    """Scores candidates for the next view. The same context gives the same scores."""

    @property
    def name(self) -> str:
        """The method's name on the command line and in results."""
        ...

    def score(self, context: SelectionContext, monitor: Monitor | None = None) -> tuple[CandidateScore, ...]:
        """One score per candidate, in their order: lower ranks first. Gains are negated.

        ``coverage`` is None for selectors that do not render. Progress is reported in views, and
        the scores of a selector that computes them one by one are passed on to ``monitor``. Raises
        ``InvalidInputError`` for candidates that cannot be compared, ``Cancelled`` on request.
        """
        ...


@dataclass(frozen=True)
class Selection:
    """The chosen view and the ranking behind it.

    ``chosen``: the name of the next view. ``ranked``: all candidates, the best first. ``fallback`` names the
    rule that chose when nothing could be ranked: ``"low-coverage"`` or ``"farthest"``; None otherwise.
    """

    chosen: str
    ranked: tuple[RankedCandidate, ...]
    fallback: str | None


def select(
    context: SelectionContext,
    selector: Selector,
    distances: Mapping[str, float],
    monitor: Monitor | None = None,
) -> Selection:
    """Choose the next view.

    The lowest score wins; ties are broken by ``distances`` (name → travel distance, in the caller's unit),
    then by name. Where no candidate can be ranked, the lowest score among those of low coverage wins (the
    model fills little of any view then); where none has a score at all, the candidate farthest from all
    visited views, in position and direction.

    Raises ``InvalidInputError`` without candidates, and what ``Selector.score`` raises.
    """
    if not context.candidates:
        raise InvalidInputError(
            "There is no candidate to choose from.", hint="Widen the radius, or choose among more neighbours."
        )
    with on_device(context.rasterizer.device):  # half of the processor time or less
        ranked = rank(selector.score(context, monitor), distances)
    chosen, fallback = _first(context, ranked)
    return Selection(chosen, ranked, fallback)


def _first(context: SelectionContext, ranked: tuple[RankedCandidate, ...]) -> tuple[str, str | None]:
    """The name of the chosen candidate, and the fallback rule that chose it, if any."""
    best = ranked[0]
    if best.status is CandidateStatus.RANKED:
        return best.name, None
    if best.status is CandidateStatus.LOW_COVERAGE:
        return best.name, CandidateStatus.LOW_COVERAGE.value
    separation = view_distances(context.candidates, context.visited).min(axis=1, initial=float("inf"))
    farthest = separation.max()
    # As in a ranking, ties go to the smaller name, whatever the order of the candidates.
    names = (c.name for c, value in zip(context.candidates, separation, strict=True) if value == farthest)
    return min(names), "farthest"
