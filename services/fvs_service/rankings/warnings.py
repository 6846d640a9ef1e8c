"""Warnings on a ranking: what limits its use, and the remedy."""

from collections.abc import Iterable, Sequence

from fvs_engine.plan.plan_records import PlanWarning
from fvs_engine.plan.registrable import ELSEWHERE, NEARER, few_registrable, none_feasible
from fvs_schema.candidates import CandidateStatus
from fvs_schema.rankings import RankingWarning, RankingWarningCode
from fvs_schema.scenes import Alignment, AlignmentStatus

_ILL_CONDITIONED = RankingWarning(
    code=RankingWarningCode.ILL_CONDITIONED,
    message="The photographs lie on a line, or hardly farther apart than their positions are accurate, which "
    "leaves the rotation of the world frame open: poses in it, also geodetic ones, may be off by tens of "
    "degrees.",
    hint="Fly a second line beside the first, or send yaw, pitch and roll of the camera with every image; or "
    "give poses in the model frame.",
)


_POSITIONS_UNUSED = RankingWarning(
    code=RankingWarningCode.POSITIONS_UNUSED,
    message="The positions of the photographs contradict the model, or are too few: the world frame is the "
    "model's, and lengths have no unit.",
    hint="Check the units, axes and altitude datum of the positions, and whether they belong to these "
    "photographs; or give poses in the model frame.",
)


def warnings_of(
    alignment: Alignment,
    *,
    in_model: bool,
    candidates: int,
    registrable: int | None,
    statuses: Iterable[CandidateStatus] = (),
    wanted: int | None = None,
    made: int = 0,
    of_plan: Sequence[PlanWarning] = (),
) -> tuple[RankingWarning, ...]:
    """The warnings on a ranking or a plan with this alignment.

    ``in_model``: all its poses are in the model frame. ``registrable`` of its ``candidates`` are likely to be
    registered (None: that is not known). ``statuses``: those of a ranking's candidates. A generator has
    ``made`` candidates of those ``wanted`` (None: there is no number).
    ``of_plan``: the engine's warnings on a plan.
    """
    found = []
    if alignment.status is AlignmentStatus.ILL_CONDITIONED and not in_model:
        found.append(_ILL_CONDITIONED)
    if alignment.status is AlignmentStatus.MODEL and alignment.positions > 0 and not in_model:
        found.append(_POSITIONS_UNUSED)
    if wanted is not None and made < wanted:
        found.append(
            RankingWarning(
                code=RankingWarningCode.FEWER_CANDIDATES,
                message=f"The volume has room for {made} of the {wanted} candidates.",
                hint="Give a larger volume, a smaller count, or a shorter safety_m.",
            )
        )
    few = few_registrable(registrable, candidates)
    if few is not None:
        code = RankingWarningCode.FEW_REGISTRABLE
        found.append(RankingWarning(code=code, message=few, hint=NEARER))
    none = none_feasible(statuses)
    if none is not None:
        code = RankingWarningCode.NONE_FEASIBLE
        found.append(RankingWarning(code=code, message=none, hint=ELSEWHERE))
    found += [
        RankingWarning(code=RankingWarningCode(warning.code), message=warning.message, hint=warning.hint)
        for warning in of_plan
    ]
    return tuple(found)
