"""Warnings on a ranking: what limits its use, and the remedy."""

from collections.abc import Iterable, Sequence
from enum import StrEnum

from fvs_engine.candidates import CandidateStatus
from fvs_engine.plan.plan_records import PlanWarning
from fvs_engine.plan.registrable import ELSEWHERE, NEARER, few_registrable, none_feasible
from fvs_service.model import Model
from fvs_service.scenes.model import Alignment, AlignmentStatus


class RankingWarningCode(StrEnum):
    """The kind of a warning, for programs."""

    ILL_CONDITIONED = "ill-conditioned"
    """The axes of the world frame may be turned about the line of the cameras."""
    POSITIONS_UNUSED = "positions-unused"
    """The positions of the images contradict the model: the world frame is the model's."""
    FEW_REGISTRABLE = "few-registrable"
    """Hardly any candidate sees enough of what the images show to be registered."""
    NONE_FEASIBLE = "none-feasible"
    """No candidate has a rank: all are in matter, too close to it, or unlikely to be registered."""
    FEWER_CANDIDATES = "fewer-candidates"
    """The generator made fewer candidates than requested: the volume has no room for more."""
    VEHICLE_GROUNDED = "vehicle-grounded"
    """A vehicle of a plan gets no tour, because it cannot fly to any candidate."""
    TOO_CLOSE = "too-close"
    """Some candidates of a plan are inside matter, too close to it or in a no-fly zone, and not planned."""
    UNREACHABLE = "unreachable"
    """No way leads to some candidates of a plan: no-fly zones or the model are in the way."""
    SAME_POSE = "same-pose"
    """Some candidates of a plan have the pose of another, and are not planned."""
    NOTHING_IN_VIEW = "nothing-in-view"
    """None of the planned views shows anything of the model."""


class RankingWarning(Model):
    """What limits the use of a ranking, and the remedy."""

    code: RankingWarningCode
    """Stable, for programs."""
    message: str
    """What limits the use, in a sentence."""
    hint: str
    """What to do about it."""


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
