"""The veto of pose priors over pairs of look-alike places, before images are registered by these."""

from collections.abc import Sequence
from pathlib import Path

from fvs_engine.sfm.colmap.database import restore_pairs
from fvs_engine.sfm.matching.match import match_pairs
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import Stages


def veto(stages: Stages, model_dir: Path, names: Sequence[str], priors: PosePriors) -> list[str]:
    """Take away the verified pairs of ``names``, unregistered images, that ``priors`` contradict.

    That is undone, for all pairs, when the priors agree with the model in ``model_dir`` no longer. Returns
    warnings.
    """
    arguments = {
        "database": str(stages.folder.database),
        "model_dir": str(model_dir),
        "names": list(names),
        "priors": priors.model_dump(mode="json"),
    }
    with stages.timed("veto"):
        answer = stages.native("veto", arguments)  # only numbers: no image can kill it
        if not answer["believed"]:
            match_pairs(stages, restore_pairs(stages.folder.database))
    return [
        f"{name} is not registered: its position prior contradicts all of its {pairs} verified pairs."
        for name, pairs in answer["without"].items()
    ]
