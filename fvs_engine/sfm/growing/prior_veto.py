"""The veto of pose priors over pairs of look-alike places, before images are registered by these."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fvs_engine.sfm.colmap.database import restore_pairs
from fvs_engine.sfm.jobs import VetoPairs
from fvs_engine.sfm.matching.match import match_pairs
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import Stages
from fvs_schema.findings import Finding, FindingCode


@dataclass(frozen=True)
class Veto:
    """``priors`` to use, none when the images contradict them; ``ignored``: findings about unused ones.

    ``informative``: whether their positions can judge poses: few, or inaccurate ones for so small a scene,
    cannot. ``without_pairs``: images that no verified pairs join with the model any more → the
    reason.
    """

    priors: PosePriors
    informative: bool
    ignored: tuple[Finding, ...] = ()
    without_pairs: dict[str, Finding] = field(default_factory=dict)


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
            return Veto(PosePriors(), informative=False, ignored=(Finding.of(FindingCode.POSITIONS_IGNORED),))
    return Veto(
        priors,
        answer.informative,
        () if answer.oriented else (Finding.of(FindingCode.ORIENTATIONS_IGNORED),),
        {name: Finding.of(FindingCode.LOOK_ALIKE_PLACE, [name]) for name in answer.without},
    )
