"""Coverage and median frequency of a plan's candidates, as terms of the plan."""

from collections.abc import Sequence

import torch

from fvs_engine.monitor import Monitor
from fvs_engine.plan.plan_records import Plan, Term
from fvs_engine.plan.plan_warnings import nothing_in_view
from fvs_engine.score.estimate.median_frequency_estimate import compile_kernels
from fvs_engine.score.estimate.splat_table import SplatTable
from fvs_engine.score.parallel import map_in_order
from fvs_engine.score.renderings import judged
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.views import PinholeView

MOST_SHOWN = 100
"""Number of first terms that are completed: each costs an estimate, some milliseconds."""


def with_appearance(
    plan: Plan, candidates: Sequence[PinholeView], gaussians: Gaussians, monitor: Monitor | None = None
) -> Plan:
    """The plan, with ``coverage`` and ``median_frequency`` in its first ``MOST_SHOWN`` terms.

    It has a warning where none of the planned ones shows anything.

    ``candidates`` are the views that the plan was planned with, in the frame of ``gaussians``. Both
    numbers are estimates (``MedianFrequencyEstimate``). Raises ``Cancelled``.
    """
    monitor = monitor or Monitor()
    compile_kernels(monitor)
    views, table = {view.name: view for view in candidates}, SplatTable.of(gaussians)

    def completed(term: Term) -> Term:
        monitor.check()
        value, coverage = table.estimate(views[term.name])
        found = judged(term.name, value, coverage, 0.0, estimated=True)
        return term.model_copy(update={"coverage": found.coverage, "median_frequency": found.score})

    first = map_in_order(completed, plan.terms[:MOST_SHOWN], torch.device("cpu"))
    terms = (*first, *plan.terms[MOST_SHOWN:])
    warnings = (*plan.warnings, *nothing_in_view(terms))
    return plan.model_copy(update={"terms": terms, "warnings": warnings})
