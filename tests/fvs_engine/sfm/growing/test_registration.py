import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform, SimilarityTransform
from fvs_engine.geometry.alignment.cameras import align_poses, centre_spread
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import leave_out, load_models
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.colmap.model import camera_poses, read_colmap
from fvs_engine.sfm.growing.registration import reason_to_remap, remap, start_again
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import GateSettings, SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages
from fvs_engine.sfm.verification.witness import WitnessMatches

MODEL_FROM_COLMAP = SimilarityTransform(
    3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
)


def at(places: dict[str, np.ndarray]) -> PosePriors:
    return PosePriors(by_name={name: PosePrior.at(place) for name, place in places.items()})


def current_state(image_dir: Path, names: list[str], registered: list[str]) -> GrowthState:
    return GrowthState(
        settings="",
        images={name: (image_dir / name).stat().st_size for name in names},
        registered=tuple(registered),
        generation=1,
        mapped_images=len(registered),
        mapped_support=0.99,
    )


def test_the_model_of_a_remap_is_aligned_with_the_current_one(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    folder = shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    leave_out(model, kermit_names[5:])
    transform = MODEL_FROM_COLMAP
    model.transform(
        pycolmap.Sim3d(transform.scale, pycolmap.Rotation3d(transform.rotation), transform.translation)
    )
    current = tmp_path / "current"
    current.mkdir()
    model.write_binary(current)
    before = read_colmap(current).centres()
    stages = Stages(SfmFolder(folder), SfmSettings(), Monitor())
    state = current_state(kermit_dir, kermit_names, kermit_names[:5])

    outcome = remap(stages, kermit_dir, state, PosePriors(), current, tmp_path / "next")

    assert outcome.changed
    assert outcome.state.registered == tuple(kermit_names)
    assert outcome.state.mapped_images == outcome.state.adjusted_images == 11
    after = read_colmap(tmp_path / "next").centres()
    apart = [np.linalg.norm(after[name] - before[name]) for name in before]
    assert max(apart) < 0.01 * centre_spread(np.stack(list(before.values())))
    assert outcome.mapper in ("incremental", "global")


def test_a_current_model_that_explains_as_much_is_kept(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    folder = shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    stages = Stages(SfmFolder(folder), SfmSettings(), Monitor())
    state = current_state(kermit_dir, kermit_names, kermit_names)
    outcome = remap(stages, kermit_dir, state, PosePriors(), kermit_sfm.model_dir, tmp_path / "next")
    assert not outcome.changed
    assert outcome.warnings == ()
    assert not (tmp_path / "next").exists()


def test_reasons_to_remap():
    settings = SfmSettings()
    state = GrowthState(
        settings="",
        images={f"{i}.jpg": 1 for i in range(30)},
        registered=tuple(f"{i}.jpg" for i in range(26)),
        mapped_images=20,
        mapped_support=0.95,
    )
    assert reason_to_remap(state, 0.94, 2, settings) is None
    assert reason_to_remap(state, None, 2, settings) is None
    assert "95.0% to 90.0%" in str(reason_to_remap(state, 0.90, 0, settings))
    assert "4 images" in str(reason_to_remap(state, None, 4, settings))
    # Tried when there were hardly fewer images: not again so soon.
    tried = state.model_copy(update={"mapped_images": 28})
    assert reason_to_remap(tried, 0.80, 10, settings) is None


def test_the_pairs_of_an_image_contradict_a_wrong_pose_and_no_right_one(kermit_sfm: SfmResult):
    database = kermit_sfm.model_dir.parent / "database.db"
    known = PoseCheck.read(str(database), 0.75, PosePriors())
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    assert set(known.keypoints) == set(model.images)
    for image_id, image in model.images.items():
        assert known.contradiction(model, image_id) is None
        right = image.cam_from_world()
        aside = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array([0.0, 0.05, 0.0])), np.zeros(3))
        image.frame.rig_from_world = aside * right
        assert "verified matches" in str(known.contradiction(model, image_id))
        image.frame.rig_from_world = right


def with_matches(pairs: Sequence[VerifiedPair], change: Callable[[Any], Any]) -> list[VerifiedPair]:
    return [VerifiedPair(p.first, p.second, change(p.matches)) for p in pairs]


def test_the_witness_contradicts_a_pose_that_all_other_matches_fit(kermit_sfm: SfmResult):
    known = PoseCheck.read(str(kermit_sfm.model_dir.parent / "database.db"), 0.75, PosePriors())
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    agrees = WitnessMatches(known.pairs, known.keypoints)
    assert all(
        replace(known, witness=agrees).contradiction(model, image_id) is None for image_id in model.images
    )
    mixed = with_matches(known.pairs, lambda matches: np.c_[matches[:, 0], np.roll(matches[:, 1], 7)])
    contradicts = replace(known, witness=WitnessMatches(mixed, known.keypoints))
    said = {str(contradicts.contradiction(model, image_id)) for image_id in model.images}
    assert all("matches of other features fit" in contradiction for contradiction in said)


def test_an_image_of_few_matches_is_loosely_linked_unless_the_witness_connects_it(
    kermit_sfm: SfmResult, kermit_names: list[str]
):
    known = PoseCheck.read(str(kermit_sfm.model_dir.parent / "database.db"), 0.75, PosePriors())
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
    assert (
        replace(seldom, witness=WitnessMatches(known.pairs, known.keypoints)).loosely_linked(model) == set()
    )
    silent = [pair for pair in known.pairs if far not in (pair.first, pair.second)]
    still = replace(seldom, witness=WitnessMatches(silent, known.keypoints))
    assert still.loosely_linked(model) == {kermit_names[-1]}


def test_a_pose_far_from_its_position_prior_is_contradicted(kermit_sfm: SfmResult, kermit_names: list[str]):
    """Matches alone do not contradict it, as with a repeated pattern."""
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    database = str(kermit_sfm.model_dir.parent / "database.db")
    places = {name: MODEL_FROM_COLMAP.apply(centre) for name, centre in centres_of(model).items()}
    elsewhere = kermit_names[4]
    ids = {image.name: image_id for image_id, image in model.images.items()}
    honest = PoseCheck.read(database, 0.75, at(places))
    assert all(honest.contradiction(model, ids[name]) is None for name in kermit_names)
    others = np.stack([place for name, place in places.items() if name != elsewhere])
    moved = places | {elsewhere: places[elsewhere] + 0.5 * centre_spread(others)}
    wrong = PoseCheck.read(database, 0.75, at(moved))
    found = {name: wrong.contradiction(model, ids[name]) for name in kermit_names}
    assert {name for name, contradiction in found.items() if contradiction} == {elsewhere}
    assert "off its position prior" in str(found[elsewhere])


def test_more_images_are_no_argument_for_a_model_that_contradicts_the_current_one(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    """The current model lacks one image; the mapped one has it, and others elsewhere."""
    folder = SfmFolder(shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm"))
    current = tmp_path / "current"
    current.mkdir()
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    leave_out(model, kermit_names[-1:])
    model.write_binary(current)
    state = current_state(kermit_dir, kermit_names, kermit_names[:-1])
    everyone = GateSettings(
        min_match_support=0,
        min_doubtful_match_support=0,
        min_rotation_support=0,
        min_translation_support=0,
        max_disagreement=0.001,
    )
    stages = Stages(folder, SfmSettings(gate=everyone), Monitor())
    folded = load_models(folder.mapping("incremental"))[0]
    fold(folded, kermit_names[:5])
    folded.write_binary(folder.mapping("incremental") / "0")
    outcome = remap(stages, kermit_dir, state, PosePriors(), current, tmp_path / "next")
    assert not outcome.changed


def test_a_doubtful_model_of_all_images_does_not_replace_an_accepted_one_that_it_contradicts(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    """GPS confirms the new model, so that the gate does not reject it for its few fitting matches."""
    folder = SfmFolder(shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm"))
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    priors = at(centres_of(model))
    leave_out(model, kermit_names[5:])
    current = tmp_path / "current"
    current.mkdir()
    model.write_binary(current)
    folded = load_models(folder.mapping("incremental"))[0]
    fold(folded, kermit_names[:3], by=0.05)
    folded.write_binary(folder.mapping("incremental") / "0")
    folder.mapping("global").mkdir()  # the other mapper makes no model
    gate = GateSettings(
        min_match_support=0.985,
        min_doubtful_match_support=0,
        min_rotation_support=0,
        min_translation_support=0,
        max_disagreement=0.001,
    )
    state = current_state(kermit_dir, kermit_names, kermit_names[:5])
    stages = Stages(folder, SfmSettings(gate=gate), Monitor())
    outcome = start_again(stages, kermit_dir, state, priors, current, tmp_path / "next")
    assert not outcome.changed


def fold(model: pycolmap.Reconstruction, names: list[str], by: float = 0.01) -> None:
    """Move some cameras aside by a share of the spread: with the default hardly any match minds."""
    by_name = {image.name: image for image in model.images.values() if image.has_pose}
    aside = by * centre_spread(np.stack(list(centres_of(model).values())))
    for name in names:
        image = by_name[name]
        away = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0.0, 0.0, aside]))
        image.frame.rig_from_world = away * image.cam_from_world()


def centres_of(model: pycolmap.Reconstruction) -> dict[str, np.ndarray]:
    return {image.name: image.projection_center() for image in model.images.values() if image.has_pose}


def test_cameras_on_a_line_are_aligned_without_turning_about_it():
    line = {
        f"{i}.jpg": RigidTransform(Rotation.from_euler("y", 3 * i, degrees=True).as_matrix(), [0.5 * i, 0, 0])
        for i in range(6)
    }
    turned = {
        name: RigidTransform(
            MODEL_FROM_COLMAP.rotation @ pose.rotation, MODEL_FROM_COLMAP.apply(pose.translation)
        )
        for name, pose in line.items()
    }
    found = align_poses(line, turned).transform
    np.testing.assert_allclose(found.rotation, MODEL_FROM_COLMAP.rotation, atol=1e-9)
    assert found.scale == pytest.approx(MODEL_FROM_COLMAP.scale)
    np.testing.assert_allclose(found.translation, MODEL_FROM_COLMAP.translation, atol=1e-8)


def test_one_camera_that_moved_does_not_move_the_others(kermit_sfm: SfmResult):
    poses = camera_poses(pycolmap.Reconstruction(kermit_sfm.model_dir))
    moved = dict(poses)
    name = min(moved)
    moved[name] = RigidTransform(moved[name].rotation, moved[name].translation + 1.0)
    found = align_poses(moved, poses).transform
    assert found.scale == pytest.approx(1.0)
    np.testing.assert_allclose(found.translation, 0.0, atol=1e-8)
