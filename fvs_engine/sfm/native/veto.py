"""The native job that vetoes verified pairs which the pose priors contradict."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pycolmap

from fvs_engine.sfm.colmap.database import (
    image_cameras,
    image_ids,
    read_keypoints,
    read_verified_pairs,
    veto_pairs,
)
from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.evidence import MIN_PAIR_MATCHES
from fvs_engine.sfm.verification.veto import believed_frame, contradicted_pairs

Report = Callable[[int], None]


def veto(
    _report: Report, *, database: str, model_dir: str, names: list[str], priors: dict[str, Any]
) -> dict[str, Any]:
    """Veto pairs of ``names``, images that are not in the model, which ``priors`` (as JSON) contradict.

    Returns whether the priors are ``believed``, and which of ``names`` are now ``without`` verified pairs:
    name → the number of its vetoed pairs.
    """
    model = pycolmap.Reconstruction(model_dir)
    poses = camera_poses(model)
    known = PosePriors.model_validate(priors)
    frame = believed_frame(known, poses)
    if frame is None:
        return {"believed": False, "without": {}}
    path = Path(database)
    ids = image_ids(path)
    numbers = {ids[name] for name in names}
    # Only intrinsics that the model has estimated: with a guessed focal length every direction is wrong.
    estimated = {image.camera_id for image in model.images.values() if image.has_pose}
    cameras = {
        ids[name]: model.camera(camera_id)
        for name, camera_id in image_cameras(path).items()
        if camera_id in estimated
    }
    pairs = [
        pair for pair in read_verified_pairs(path, MIN_PAIR_MATCHES) if numbers & {pair.first, pair.second}
    ]
    vetoed = contradicted_pairs(
        pairs,
        read_keypoints(path, {i for pair in pairs for i in (pair.first, pair.second)}),
        {number: name for name, number in ids.items()},
        cameras,
        poses,
        known,
        frame,
    )
    veto_pairs(path, [(pair.first, pair.second) for pair in vetoed])
    counts = {
        name: (
            sum(ids[name] in (pair.first, pair.second) for pair in vetoed),
            sum(ids[name] in (pair.first, pair.second) for pair in pairs),
        )
        for name in names
    }
    return {"believed": True, "without": {name: n for name, (n, of) in counts.items() if n == of > 0}}
