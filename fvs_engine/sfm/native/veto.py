"""The native job that vetoes verified pairs which the pose priors contradict."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fvs_engine.sfm.colmap.database import (
    VerifiedPair,
    image_cameras,
    image_ids,
    read_keypoints,
    read_verified_pairs,
    veto_pairs,
)
from fvs_engine.sfm.colmap.model import camera_centres, camera_poses
from fvs_engine.sfm.jobs import PairVeto, Report, VetoPairs
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.contradicted_pairs import KnownCameras, contradicted_pairs
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES, check_pairs
from fvs_engine.sfm.verification.positions import contradict, informative
from fvs_engine.sfm.verification.prior_frame import believed_frame, orientations_contradict
from fvs_engine.sfm.verification.prior_support import prior_support
from fvs_engine.sfm.verification.thresholds import PRIORS


def veto(request: VetoPairs, _report: Report) -> PairVeto:
    """See ``VetoPairs``."""
    model = pycolmap.Reconstruction(request.model_dir)
    poses = camera_poses(model)
    path, names, known = request.database, request.names, request.priors
    frame = believed_frame(known, poses)
    oriented = not orientations_contradict(known, poses)
    judges = informative(known, {name: pose.translation for name, pose in poses.items()})
    every = read_verified_pairs(path, MIN_PAIR_MATCHES)
    if frame is None:
        support = _support(model, every, path, known)
        return PairVeto(believed=False, oriented=oriented, informative=judges, contradicted_support=support)
    ids = image_ids(path)
    numbers = {ids[name] for name in names}
    # Only intrinsics that the model has estimated: with a guessed focal length every direction is wrong.
    estimated = {image.camera_id for image in model.images.values() if image.has_pose}
    cameras = {
        ids[name]: model.camera(camera_id)
        for name, camera_id in image_cameras(path).items()
        if camera_id in estimated
    }
    pairs = [pair for pair in every if numbers & {pair.first, pair.second}]
    vetoed = contradicted_pairs(
        pairs,
        read_keypoints(path, {i for pair in pairs for i in (pair.first, pair.second)}),
        KnownCameras({number: name for name, number in ids.items()}, cameras, poses),
        known,
        frame,
    )
    veto_pairs(path, [(pair.first, pair.second) for pair in vetoed])
    gone = {id(pair) for pair in vetoed}
    left = [(pair.first, pair.second) for pair in every if id(pair) not in gone]
    lost = {i for pair in vetoed for i in (pair.first, pair.second)}
    lost -= _joined({ids[name] for name in poses if name in ids}, left)
    without = tuple(name for name in names if ids[name] in lost)
    return PairVeto(believed=True, oriented=oriented, informative=judges, without=without)


def _joined(start: set[int], pairs: Sequence[tuple[int, int]]) -> set[int]:
    """The images of ``start``, and those that ``pairs`` connect with them, directly or through others."""
    images = sorted(start.union(*pairs))
    index = {image: k for k, image in enumerate(images)}
    ends = np.array([[index[first], index[second]] for first, second in pairs], dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), tuple(ends.T)), shape=(len(images), len(images)))
    component = connected_components(graph, directed=False)[1]
    connected = {component[index[image]] for image in start}
    return {image for image in images if component[index[image]] in connected}


def _support(
    model: pycolmap.Reconstruction, pairs: Sequence[VerifiedPair], database: Path, priors: PosePriors
) -> float | None:
    """The support of priors that a model contradicts, by a sample of its pairs; None when it is unknown."""
    posed = {image_id: image for image_id, image in model.images.items() if image.has_pose}
    names = {image_id: image.name for image_id, image in posed.items()}
    if not contradict(priors, camera_centres(model)):
        return None
    inside = [pair for pair in pairs if pair.first in posed and pair.second in posed]
    inside = inside[:: max(1, -(-len(inside) // PRIORS.max_checked_pairs))]
    keypoints = read_keypoints(database, {i for pair in inside for i in (pair.first, pair.second)})
    rotations = {i: image.cam_from_world().rotation.matrix().T for i, image in posed.items()}
    return prior_support(check_pairs(model, inside, keypoints), names, rotations, priors)
