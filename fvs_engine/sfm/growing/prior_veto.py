"""The veto of pose priors over pairs of look-alike places, before images are registered by these."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fvs_engine.sfm.colmap.database import restore_pairs
from fvs_engine.sfm.jobs import VetoPairs
from fvs_engine.sfm.matching.match import match_pairs
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import Stages
from fvs_engine.sfm.verification.gate import PRIORS_IGNORED

_ORIENTATIONS_IGNORED = (
    "The orientation priors contradict the position priors and are not used. Check from where the angles "
    "count, and which way round."
)

_CONTRADICTED = (
    "its position prior contradicts all verified pairs that join it with the model, so that it shows a "
    "look-alike place, or the position is wrong"
)


@dataclass(frozen=True)
class Veto:
    """``priors`` to use, none when the images contradict them; ``ignored``: warnings of unused ones.

    ``informative``: whether their positions can judge poses: few, or inaccurate ones for so small a scene,
    cannot. ``without_pairs``: images that no verified pairs join with the model any more → the
    reason.
    """

    priors: PosePriors
    informative: bool
    ignored: tuple[str, ...] = ()
    without_pairs: dict[str, str] = field(default_factory=dict)


def veto(stages: Stages, model_dir: Path, names: Sequence[str], priors: PosePriors) -> Veto:
    """Take away the verified pairs of ``names``, unregistered images, that ``priors`` contradict.

    That is undone, for all pairs, when the priors no longer agree with the model in ``model_dir``.
    """
    if not priors.by_name:
        match_pairs(stages, restore_pairs(stages.folder.database))
        return Veto(priors, informative=False)
    request = VetoPairs(
        database=stages.folder.database, model_dir=model_dir, names=tuple(names), priors=priors
    )
    with stages.timed("veto"):
        answer = stages.native(request)  # numbers: no image can crash it
    if not answer.believed:
        match_pairs(stages, restore_pairs(stages.folder.database))
        support = answer.contradicted_support
        if support is not None and support < stages.settings.gate.min_prior_support:
            return Veto(PosePriors(), informative=False, ignored=(PRIORS_IGNORED,))
    return Veto(
        priors,
        answer.informative,
        () if answer.oriented else (_ORIENTATIONS_IGNORED,),
        dict.fromkeys(answer.without, _CONTRADICTED),
    )
