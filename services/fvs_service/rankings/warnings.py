"""Warnings on a ranking or a plan: what limits its use, and the remedy."""

from collections.abc import Iterable

from fvs_engine.plan.plan_warnings import few_registrable, none_feasible
from fvs_engine.wording import notice
from fvs_schema.candidates import CandidateStatus
from fvs_schema.findings import Finding, FindingCode, Notice
from fvs_schema.scenes import Alignment, AlignmentStatus


def warnings_of(
    alignment: Alignment,
    *,
    in_model: bool,
    candidates: int,
    registrable: int | None,
    statuses: Iterable[CandidateStatus] = (),
    wanted: int | None = None,
    made: int = 0,
    more: Iterable[Finding] = (),
) -> tuple[Notice, ...]:
    """The warnings on a ranking or a plan with this alignment.

    ``in_model``: all its poses are in the model frame. ``registrable`` of its ``candidates`` are likely to be
    registered (None: that is not known). ``statuses``: those of a ranking's candidates. A generator has
    ``made`` candidates of those ``wanted`` (None: there is no number).
    ``more``: findings of the engine.
    """
    found = []
    if alignment.status is AlignmentStatus.ILL_CONDITIONED and not in_model:
        found.append(Finding.of(FindingCode.ILL_CONDITIONED))
    if alignment.status is AlignmentStatus.MODEL and alignment.positions > 0 and not in_model:
        found.append(Finding.of(FindingCode.POSITIONS_UNUSED))
    if wanted is not None and made < wanted:
        found.append(Finding.of(FindingCode.FEWER_CANDIDATES, made=made, wanted=wanted))
    found += [*few_registrable(registrable, candidates), *none_feasible(statuses), *more]
    return tuple(map(notice, found))
