"""Feasibility of candidates: whether a photograph can be taken there, and registered.

The paper's score looks for blur. A camera inside matter, or much nearer to it than any photograph was, sees
blur whatever is there; and a photograph that shares nothing with the others improves no model.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch

from fvs_engine.candidates import RankedCandidate
from fvs_engine.compilation.ahead import ensure_compiled
from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.clearance import FreeSpace, Matter
from fvs_engine.plan.familiarity import Familiarity, Observations
from fvs_engine.plan.plan_warnings import none_feasible
from fvs_engine.score.estimate.nearness import Look, Nearness, nearest_photographs
from fvs_engine.score.parallel import map_in_order
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.views import PinholeView
from fvs_engine.wording import hint, sentence
from fvs_schema.candidates import CandidateStatus
from fvs_schema.stages import Stage

MOST_NEAR = 0.5
"""Share of a view that may show the model from nearer than half the distance of the nearest photograph.

On eight scenes at most 0.48 at the poses of photographs (``benchmarks/first_views.py``;
docs/design/rankings.md)."""
LEAST_CHANCE = 0.1
"""Probability of being registered below which a candidate is not ranked."""

_IMPOSSIBLE = (CandidateStatus.IN_MATTER, CandidateStatus.TOO_CLOSE, CandidateStatus.NO_FLY)
_CPU = torch.device("cpu")


def matter_of(gaussians: Gaussians) -> Matter:
    """What Gaussians, on any device, show to be solid."""
    return Matter.of_model(
        gaussians.means.detach().cpu().numpy(),
        gaussians.log_scales.detach().exp().cpu().numpy(),
        gaussians.opacity_logits.detach().sigmoid().cpu().numpy(),
    )


@dataclass(frozen=True, eq=False)
class Assessment:
    """What is against each candidate, and its probability of being registered, by name.

    ``against`` lacks candidates that are feasible. ``chances`` is empty where poses are known.
    ``registrable``: how many are likely to be registered (None: poses are known).
    """

    against: Mapping[str, CandidateStatus]
    chances: Mapping[str, float]
    registrable: int | None

    def feasible(self, candidates: Sequence[PinholeView]) -> tuple[PinholeView, ...]:
        """Those of ``candidates`` that nothing is against."""
        return tuple(view for view in candidates if view.name not in self.against)

    def possible(self, candidates: Sequence[PinholeView]) -> tuple[PinholeView, ...]:
        """Those of ``candidates`` where a camera can be, also if its photograph can hardly be registered now.

        Raises ``InvalidInputError`` where there is none.
        """
        kept = tuple(view for view in candidates if self.against.get(view.name) not in _IMPOSSIBLE)
        if candidates and not kept:
            (found,) = none_feasible(self.against.values())
            raise InvalidInputError(sentence(found), hint=hint(found))
        return kept

    def complete(
        self, ranked: Sequence[RankedCandidate], distances: Mapping[str, float] | None = None
    ) -> tuple[RankedCandidate, ...]:
        """The ranked candidates, then the others, the nearest first; all with status and chance."""
        known = distances or {}
        ranked = [
            replace(one, status=self.against.get(one.name, one.status)) if one.rank is not None else one
            for one in ranked
        ]
        left = self.against.keys() - {candidate.name for candidate in ranked}
        rest = (
            RankedCandidate(None, name, None, self.against[name], None, known.get(name))
            for name in sorted(left, key=lambda name: (known.get(name, 0.0), name))
        )
        return tuple(replace(one, chance=self.chances.get(one.name)) for one in (*ranked, *rest))


class FeasibilityCheck:
    """Assesses candidates by a model, its ``photographs`` and what they saw.

    ``observations`` are the sparse points where poses are estimated (None: poses are known).
    """

    def __init__(
        self,
        gaussians: Gaussians,
        photographs: Sequence[PinholeView],
        observations: Observations | None,
    ) -> None:
        self._gaussians = gaussians
        self._photographs = photographs
        self._observations = observations

    @cached_property
    def _nearness(self) -> Nearness:
        return Nearness.of(self._gaussians, self._photographs)

    def assess(
        self, candidates: Sequence[PinholeView], space: FreeSpace, monitor: Monitor | None = None
    ) -> Assessment:
        """Assess ``candidates``; stage ``feasibility``.

        ``space``: its zones are kept out of, and its safety distance, where it is not 0, is kept in any case.
        By default a candidate is too close where more than ``MOST_NEAR`` of the view shows the model from
        nearer than half the distance of the nearest photograph. Raises ``Cancelled``.
        """
        monitor = monitor or Monitor()
        ensure_compiled("fvs_engine.score.estimate.warm_up", nearest_photographs, monitor)
        nearness = self._nearness

        def look(view: PinholeView) -> Look:
            monitor.check()
            return nearness.look(view)

        looks: list[Look] = []
        for found in map_in_order(look, candidates, _CPU):
            looks.append(found)
            monitor.report(Stage.FEASIBILITY, len(looks), len(candidates))
        near = np.array([found.near > MOST_NEAR for found in looks], dtype=bool)
        centres = np.array([view.centre for view in candidates]).reshape(-1, 3)
        if space.safety > 0.0:
            near |= ~space.clear(centres)
        inside = np.zeros_like(near)
        inside[near] = ~space.matter.clear(centres[near], 0.0)
        forbidden = ~space.allowed(centres)
        familiarity = None
        if self._observations is not None and len(self._observations.points):
            visible = [found.visible for found in looks]
            familiarity = Familiarity(self._observations, candidates, monitor, visible)
        chances = None if familiarity is None else familiarity.probability()
        against: dict[str, CandidateStatus] = {}
        for index, view in enumerate(candidates):
            if forbidden[index]:
                against[view.name] = CandidateStatus.NO_FLY
            elif inside[index]:
                against[view.name] = CandidateStatus.IN_MATTER
            elif near[index]:
                against[view.name] = CandidateStatus.TOO_CLOSE
            elif looks[index].covered == 0.0:
                against[view.name] = CandidateStatus.OUT_OF_MODEL
            elif chances is not None and chances[index] < LEAST_CHANCE:
                against[view.name] = CandidateStatus.UNREGISTRABLE
        names = [view.name for view in candidates]
        return Assessment(
            against,
            {} if chances is None else dict(zip(names, chances.tolist(), strict=True)),
            None if familiarity is None else int(familiarity.likely.sum()),
        )
