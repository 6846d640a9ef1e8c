"""Registration by guided matches, of images that ordinary matches leave without a pose."""

import dataclasses
import shutil
from collections.abc import Sequence

from fvs_engine.sfm.colmap.database import image_cameras, verified_matches
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.growing.overlap import predicted_neighbours
from fvs_engine.sfm.growing.registration import Unregistered, register
from fvs_engine.sfm.growing.registration_inputs import RegistrationInputs, matches_of
from fvs_engine.sfm.growing.state import GrowthFolder, ModelChange
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.stages import Stages, rename_over

_ROUNDS = 3


def guide(
    stages: Stages, folder: GrowthFolder, change: ModelChange, usable: Sequence[str], priors: PosePriors
) -> ModelChange:
    """Register ``usable`` images with priors that ``change`` left without a pose, by guided matches.

    The model before is the committed one, or ``folder.next_model`` if it was changed; a new one is written to
    the latter. Of the images whose inputs have changed the one added last is matched first, then
    those that were not tried for longest; newly registered images help to register others.
    """
    database, with_features = stages.folder.database, set(usable)
    for _ in range(_ROUNDS):
        with_prior = (name for name in change.state.unregistered if name in priors.by_name)
        left = [name for name in with_prior if name in with_features]
        model_dir = folder.next_model if change.changed else folder.model(change.state.generation)
        neighbours = predicted_neighbours(left[::-1], priors, read_colmap(model_dir)) if left else {}
        matches = matches_of(list(neighbours), verified_matches(database, 1)) if neighbours else {}
        around = {
            name: {other: matches.get(name, {}).get(other, 0) for other in others}
            for name, others in neighbours.items()
        }
        inputs = RegistrationInputs(model_dir, around, image_cameras(database), priors)
        due = [name for name in neighbours if inputs.changed(name, change.state.tried_guided)]
        if not due:
            break
        images = Unregistered(due, priors, guided=neighbours)
        guided = register(stages, change.state, images, model_dir, folder.guided_model)
        unregistered = set(guided.state.unregistered)
        tried = {name: inputs.of(name) for name in guided.tried if name in unregistered}
        others = guided.state.tried_guided.items()
        tried_guided = {name: digest for name, digest in others if name not in tried} | tried
        warnings = (*change.warnings, *guided.warnings)
        if not guided.changed:
            shutil.rmtree(folder.guided_model, ignore_errors=True)
            change = change.with_state(rejected=guided.state.rejected, tried_guided=tried_guided)
            return dataclasses.replace(change, warnings=warnings)
        guided = guided.with_state(tried_guided=tried_guided)
        rename_over(folder.guided_model, folder.next_model)
        support = change.match_support if guided.match_support is None else guided.match_support
        change = dataclasses.replace(guided, match_support=support, warnings=warnings)
    return change
