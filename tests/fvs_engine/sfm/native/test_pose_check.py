from dataclasses import replace

import numpy as np
import pycolmap
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_schema.findings import FindingCode


def test_the_pairs_of_an_image_contradict_a_wrong_pose_and_no_right_one(kermit_sfm: SfmResult):
    database = kermit_sfm.model_dir.parent / "database.db"
    known = PoseCheck.read(database, 0.75, PosePriors())
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    assert set(known.keypoints) == set(model.images)
    for image_id, image in model.images.items():
        assert known.contradiction(model, image_id) is None
        right = image.cam_from_world()
        aside = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0.0, 0.05, 0.0])), np.zeros(3))
        image.frame.rig_from_world = aside * right
        contradiction = known.contradiction(model, image_id)
        assert contradiction is not None
        assert contradiction.code is FindingCode.POSE_UNSUPPORTED
        image.frame.rig_from_world = right


def test_an_image_of_few_matches_is_loosely_linked(kermit_sfm: SfmResult, kermit_names: list[str]):
    known = PoseCheck.read(kermit_sfm.model_dir.parent / "database.db", 0.75, PosePriors())
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    assert known.loosely_linked(model) == frozenset()
    far = next(i for i, image in model.images.items() if image.name == kermit_names[-1])
    few = [
        pair
        if far not in (pair.first, pair.second)
        else VerifiedPair(pair.first, pair.second, pair.matches[:20])
        for pair in known.pairs
    ]
    seldom = replace(known, pairs=few)
    assert seldom.loosely_linked(model) == {kermit_names[-1]}


def test_a_pose_far_from_its_position_prior_is_contradicted(kermit_sfm: SfmResult, kermit_names: list[str]):
    """Matches alone do not contradict it, as with a repeated pattern."""
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    database = kermit_sfm.model_dir.parent / "database.db"
    world_from_model = SimilarityTransform(
        3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
    )
    places = {name: world_from_model.apply(pose.translation) for name, pose in camera_poses(model).items()}
    elsewhere = kermit_names[4]
    ids = {image.name: image_id for image_id, image in model.images.items()}

    def at(places: dict[str, np.ndarray]) -> PosePriors:
        return PosePriors(by_name={name: PosePrior.at(place) for name, place in places.items()})

    honest = PoseCheck.read(database, 0.75, at(places))
    assert all(honest.contradiction(model, ids[name]) is None for name in kermit_names)
    others = np.stack([place for name, place in places.items() if name != elsewhere])
    moved = places | {elsewhere: places[elsewhere] + 0.5 * centre_spread(others)}
    wrong = PoseCheck.read(database, 0.75, at(moved))
    found = {name: wrong.contradiction(model, ids[name]) for name in kermit_names}
    assert {name for name, contradiction in found.items() if contradiction} == {elsewhere}
    contradiction = found[elsewhere]
    assert contradiction is not None
    assert contradiction.code is FindingCode.POSE_FAR_FROM_PRIOR
