"""Selectors that ask how much a view would say about the parameters: the frame that they share."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from fvs_engine.monitor import Monitor
from fvs_engine.score import Candidate, CandidateScore, ViewInformation, judged, view_information
from fvs_engine.select.interface import SelectionContext

PRIOR = 1e-6
"""λ, the information about every parameter before any view: FisherRF's published value.

One number does for parameters in different units: a gain depends on ratios of information, in which units
cancel, and λ counts only where the visited views say next to nothing.
"""


@dataclass(frozen=True)
class InformationGain:
    """Scores a candidate by minus ``gain(H, H_visited + λ)``, with the information H of one view.

    H is ``fvs_engine.score.information``: the diagonal of JᵀJ over all parameters but rotations, summed
    over pixels and channels. ``gain`` maps two tensors [N, P] to the sum [] over all entries.

    Cost: one gradient per candidate and per visited view on the CPU, ``information.PROBES`` of them
    elsewhere. The visited views' information is that at the *current* parameters, so it is computed
    anew at every selection; nothing is kept, and a run that was killed goes on as if it had not been.
    """

    name: str
    gain: Callable[[Tensor, Tensor], Tensor]
    min_coverage: float
    prior: float = PRIOR

    def score(self, context: SelectionContext, monitor: Monitor | None = None) -> tuple[CandidateScore, ...]:
        """See ``Selector``."""
        monitor = monitor or Monitor()
        total = len(context.visited) + len(context.candidates)
        known: Tensor | float = self.prior
        for done, view in enumerate(context.visited, start=1):
            known = _information(context, view, monitor).diagonal + known
            monitor.report("information", done, total)
        scores = []
        for done, view in enumerate(context.candidates, start=len(context.visited) + 1):
            found = _information(context, view, monitor)
            gain = self.gain(found.diagonal, torch.as_tensor(known, device=found.diagonal.device))
            scores.append(judged(view.id, -float(gain), found.coverage, self.min_coverage))
            monitor.report("information", done, total)
        return tuple(scores)


def _information(context: SelectionContext, view: Candidate, monitor: Monitor) -> ViewInformation:
    monitor.check()
    return view_information(
        context.gaussians,
        view,
        context.rasterizer,
        sh_degree=context.sh_degree,
        seed=zlib.crc32(f"{context.seed}/{context.step}/{view.id}".encode()),
    )
