"""Images are registered by matches that their expected poses guide."""

import contextlib
import shutil
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import leave_out
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import image_cameras, image_ids, pair_number, verified_matches
from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.growing.guided import guide, still_true
from fvs_engine.sfm.growing.model_change import ModelChange
from fvs_engine.sfm.growing.registration import register
from fvs_engine.sfm.growing.state import GrowthFolder, GrowthState
from fvs_engine.sfm.native import guided as guided_module
from fvs_engine.sfm.native.guided import register_guided
from fvs_engine.sfm.native.guided_matching import GuidedPose, guided_pose
from fvs_engine.sfm.native.known_points import Features, KnownPoints
from fvs_engine.sfm.native.prior_pose import ExpectedPose, refine
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import Stages
from fvs_engine.sfm.verification.veto import believed_frame

CAMERA = pycolmap.Camera(
    model="SIMPLE_PINHOLE", width=800, height=600, params=np.array([700.0, 400.0, 300.0])
)
POINTS = 400
TRUE = RigidTransform(Rotation.from_rotvec([0.05, -0.1, 0.02]).as_matrix(), np.array([0.2, -0.1, 0.3]))
POSITION_SIGMA, ORIENTATION_SIGMA = 0.05, np.radians(4.0)


def moved(pose: RigidTransform, shift: np.ndarray, turn: np.ndarray) -> RigidTransform:
    rotation = Rotation.from_rotvec(turn).as_matrix() @ pose.rotation
    return RigidTransform(rotation, -rotation @ (pose.inverse().translation + shift))


def expected(shift: tuple[float, ...] = (0.05, -0.04, 0.03), turn: tuple[float, ...] = (0.08, -0.05, 0.06)):
    return ExpectedPose(moved(TRUE, np.array(shift), np.array(turn)), POSITION_SIGMA, ORIENTATION_SIGMA)


def centre_error(pose: RigidTransform) -> float:
    return float(np.linalg.norm(pose.inverse().translation - TRUE.inverse().translation))


@pytest.fixture(scope="module")
def known() -> KnownPoints:
    """Points in front of the camera, each seen once, from the origin."""
    random = np.random.default_rng(0)
    xyz = random.uniform([-4.0, -3.0, 5.0], [4.0, 3.0, 12.0], (POINTS, 3))
    descriptors = random.exponential(size=(POINTS, 128)).astype(np.float32)
    turns = random.uniform(0.0, 2.0 * np.pi, POINTS)
    axes = np.stack([np.cos(turns), np.sin(turns), np.zeros(POINTS)], axis=1) * xyz[:, 2:] * 3.0 / 700.0
    numbers = np.arange(POINTS)
    return KnownPoints(
        xyz,
        numbers,
        np.ones(POINTS, dtype=np.int64),
        numbers,
        descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True),
        axes,
        xyz / np.linalg.norm(xyz, axis=1, keepdims=True),
    )


@pytest.fixture(scope="module")
def features(known: KnownPoints) -> Features:
    """What a camera at TRUE sees of them, in the order of the points, and as many look-alikes elsewhere."""
    random = np.random.default_rng(1)
    local = TRUE.apply(known.xyz)
    pixels = np.asarray(CAMERA.img_from_cam(local)) + random.normal(size=(POINTS, 2))
    ahead = TRUE.apply(known.xyz + known.axes)
    axes = np.asarray(CAMERA.img_from_cam(ahead)) - np.asarray(CAMERA.img_from_cam(local))
    elsewhere = random.uniform([0.0, 0.0], [800.0, 600.0], (POINTS, 2))
    noisy = known.descriptors + random.normal(0.0, 0.01, known.descriptors.shape).astype(np.float32)
    alike = known.descriptors + random.normal(0.0, 0.01, known.descriptors.shape).astype(np.float32)
    descriptors = np.concatenate([noisy, alike])
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    return Features(np.concatenate([pixels, elsewhere]), np.concatenate([axes, axes]), descriptors)


def found(
    known: KnownPoints, features: Features, prior: ExpectedPose, camera: pycolmap.Camera = CAMERA
) -> GuidedPose:
    guided = guided_pose(known, features, camera, prior)
    assert guided is not None
    return guided


def test_windows_tell_points_from_their_look_alikes(known: KnownPoints, features: Features):
    """The ratio test over the whole image passes no feature: every one has a look-alike."""
    guided = found(known, features, expected())
    assert guided.believed
    right = guided.features == guided.points
    assert right.sum() > 100
    assert right.mean() > 0.95
    assert centre_error(guided.camera_from_model) < 0.2 * centre_error(expected().camera_from_model)


def test_features_of_another_place_are_not_believed(known: KnownPoints, features: Features):
    shuffled = replace(features, descriptors=features.descriptors[np.random.default_rng(2).permutation(800)])
    guided = guided_pose(known, shuffled, CAMERA, expected())
    assert guided is None or not guided.believed


def test_many_matches_far_from_the_expected_pose_are_not_believed(known: KnownPoints, features: Features):
    """As of a look-alike place: the windows are wide, because the orientation is hardly known."""
    off = replace(expected((0.5, 0.0, 0.0), (0.0, 0.0, 0.0)), orientation_sigma=np.radians(8.0))
    guided = found(known, features, off)
    assert len(guided.points) > 100
    assert guided.sigmas > 4.5
    assert not guided.believed


def test_features_turned_or_scaled_otherwise_do_not_match(known: KnownPoints, features: Features):
    turned = replace(features, axes=features.axes @ np.array([[0.0, 1.0], [-1.0, 0.0]]))
    scaled = replace(features, axes=4.0 * features.axes)
    for changed in (turned, scaled):
        guided = guided_pose(known, changed, CAMERA, expected())
        assert guided is None or not guided.believed


def test_features_that_the_distortion_gives_no_ray_do_not_match(known: KnownPoints, features: Features):
    """At a strong distortion the corners of the image are beyond the reach of its polynomial."""
    camera = pycolmap.Camera(
        model="SIMPLE_RADIAL", width=800, height=600, params=np.array([700.0, 400.0, 300.0, -0.5])
    )
    pixels = np.asarray(camera.img_from_cam(TRUE.apply(known.xyz)))
    outward = pixels - [400.0, 300.0]
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    pixels += np.where(length > 350.0, 20.0 * outward / length, 0.0)
    assert np.isnan(np.asarray(camera.cam_from_img(pixels))).any(axis=1).sum() > 10
    beyond = replace(features, pixels=np.concatenate([pixels, features.pixels[POINTS:]]))
    guided = found(known, beyond, expected(), camera)
    assert guided.believed
    assert centre_error(guided.camera_from_model) < 0.2 * centre_error(expected().camera_from_model)


def test_a_vague_prior_guides_nothing():
    """Its windows would be as large as the image."""
    random = np.random.default_rng(0)
    poses = {f"{k}": RigidTransform(np.eye(3), random.normal(0.0, 1.0, 3)) for k in range(12)}
    priors = PosePriors(by_name={name: PosePrior.of_camera(pose, 0.02, 5.0) for name, pose in poses.items()})
    frame = believed_frame(priors, poses)
    assert frame is not None
    for sigmas, guides in (((0.02, 5.0), True), ((1e9, 5.0), False), ((0.02, 90.0), False)):
        prior = PosePrior.of_camera(RigidTransform.identity(), *sigmas)
        assert (ExpectedPose.of(prior, priors, frame) is not None) is guides


def test_one_position_at_the_end_of_the_world_does_not_widen_the_windows():
    """Of a receiver without a fix, at one of the first images, which no other position contradicts yet."""
    random = np.random.default_rng(0)
    poses = {f"{k}": RigidTransform(np.eye(3), random.normal(0.0, 1.0, 3)) for k in range(12)}
    by_name = {name: PosePrior.of_camera(pose, 0.02, 5.0) for name, pose in poses.items()}
    far = by_name | {"0": PosePrior.of_camera(RigidTransform(np.eye(3), np.full(3, 1e5)), 0.02, 5.0)}
    new = PosePrior.of_camera(RigidTransform.identity(), 0.02, 5.0)
    sigmas = []
    for each in (by_name, far):
        priors = PosePriors(by_name=each)
        frame = believed_frame(priors, poses)
        assert frame is not None
        pose = ExpectedPose.of(new, priors, frame)
        assert pose is not None
        sigmas.append(pose.position_sigma)
    assert sigmas[1] < 1.2 * sigmas[0]


@pytest.mark.parametrize(("count", "gain"), [(4, 0.8), (200, 1.02)])
def test_a_prior_helps_where_points_are_few_and_does_not_hurt_where_they_are_many(count: int, gain: float):
    random = np.random.default_rng(3)
    errors: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(40):
        # Points in the middle of the image tell turns from shifts badly.
        points = random.uniform([-0.7, -0.7, 7.0], [0.7, 0.7, 8.0], (count, 3))
        pixels = np.asarray(CAMERA.img_from_cam(TRUE.apply(points))) + random.normal(0.0, 1.0, (count, 2))
        shift, turn = random.normal(0.0, POSITION_SIGMA, 3), random.normal(0.0, ORIENTATION_SIGMA, 3)
        prior = ExpectedPose(moved(TRUE, shift, turn), POSITION_SIGMA, ORIENTATION_SIGMA)
        for used in (True, False):
            pose = refine(TRUE, points, pixels, CAMERA, 1.0, prior if used else None)
            errors[used].append(centre_error(pose))
    assert np.median(errors[True]) <= gain * np.median(errors[False])


def test_a_wrong_prior_hardly_moves_a_pose_that_points_fix(known: KnownPoints, features: Features):
    pixels = features.pixels[:POINTS]
    wrong = expected((3.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    alone = refine(expected().camera_from_model, known.xyz, pixels, CAMERA, 1.0, None)
    pulled = refine(expected().camera_from_model, known.xyz, pixels, CAMERA, 1.0, wrong)
    assert centre_error(alone) < 0.01
    assert centre_error(pulled) < 0.02


@pytest.fixture
def unmatched(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
) -> dict[str, Any]:
    """The arguments of the job for a photograph of kermit whose verified pairs are gone, and exact priors."""
    name = kermit_names[5]
    database = Path(shutil.copy(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db"))
    ids = image_ids(database)
    numbers = [(pair_number(ids[name], ids[other]),) for other in kermit_names if other != name]
    with contextlib.closing(sqlite3.connect(database)) as db, db:
        for table in ("matches", "two_view_geometries"):
            db.executemany(f"DELETE FROM {table} WHERE pair_id = ?", numbers)
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    poses = camera_poses(model)
    spread = centre_spread(np.stack([pose.translation for pose in poses.values()]))
    priors = PosePriors(
        by_name={other: PosePrior.of_camera(pose, 0.02 * spread, 3.0) for other, pose in poses.items()}
    )
    leave_out(model, [name])
    for folder in ("model", "out"):
        (tmp_path / folder).mkdir()
    model.write_binary(tmp_path / "model")
    return {
        "neighbours": {name: [other for other in kermit_names if other != name]},
        "tried": [],
        "database": str(database),
        "image_dir": str(kermit_dir),
        "model_dir": str(tmp_path / "model"),
        "out_dir": str(tmp_path / "out"),
        "names": [name],
        "refine": True,
        "lens": True,
        "priors": priors.model_dump(mode="json"),
        "witness": None,
        "min_image_support": 0.75,
        "adjust_every": 1.0,
        "adjusted_images": len(poses),
        "adjusted_points": model.num_points3D(),
        "seed": 0,
        "threads": 1,
    }


def test_a_photograph_without_matches_is_registered_by_its_prior(
    unmatched: dict[str, Any], kermit_sfm: SfmResult
):
    (name,) = unmatched["names"]
    answer = register_guided(lambda _: None, **unmatched)["registration"]
    assert answer is not None
    assert answer["registered"] == [name]
    assert any(name in pair for pair in verified_matches(Path(unmatched["database"]), 15))
    truth = camera_poses(pycolmap.Reconstruction(kermit_sfm.model_dir))
    here = camera_poses(pycolmap.Reconstruction(unmatched["out_dir"]))
    spread = centre_spread(np.stack([pose.translation for pose in truth.values()]))
    assert np.linalg.norm(here[name].translation - truth[name].translation) < 0.01 * spread


def test_killed_between_matches_and_model_it_comes_to_the_same_model(
    unmatched: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    whole = unmatched | {
        "database": str(shutil.copy(unmatched["database"], tmp_path / "whole.db")),
        "out_dir": str(tmp_path / "whole"),
    }
    Path(whole["out_dir"]).mkdir()
    register_guided(lambda _: None, **whole)

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(guided_module, "register", killed)
        with pytest.raises(KeyboardInterrupt):
            register_guided(lambda _: None, **unmatched)
    (name,) = unmatched["names"]
    assert any(name in pair for pair in verified_matches(Path(unmatched["database"]), 15))
    register_guided(lambda _: None, **unmatched)
    files = sorted(Path(whole["out_dir"]).iterdir())
    assert files
    for file in files:
        assert file.read_bytes() == (Path(unmatched["out_dir"]) / file.name).read_bytes()


def test_what_ordinary_matches_leave_out_is_registered_after_them(
    unmatched: dict[str, Any], kermit_names: list[str], tmp_path: Path
):
    (name,) = unmatched["names"]
    image_dir = Path(unmatched["image_dir"])
    folder = GrowthFolder(tmp_path / "grown")
    folder.sfm.root.mkdir(parents=True)
    shutil.copy(unmatched["database"], folder.sfm.database)
    state = GrowthState(
        settings="",
        images={other: (image_dir / other).stat().st_size for other in kermit_names},
        registered=tuple(other for other in kermit_names if other != name),
        adjusted_images=unmatched["adjusted_images"],
        adjusted_points=unmatched["adjusted_points"],
    )
    stages = Stages(folder.sfm, SfmSettings(threads=1), Monitor())
    priors = PosePriors.model_validate(unmatched["priors"])
    model_dir = Path(unmatched["model_dir"])
    change = guide(stages, image_dir, ModelChange(state), kermit_names, priors, model_dir, folder)
    assert change.changed
    assert change.state.unregistered == ()
    model = pycolmap.Reconstruction(folder.next_model)
    assert model.find_image_with_name(name).has_pose
    assert all(point.color.any() for point in model.points3D.values())
    assert not folder.guided_model.exists()
    alone = guide(stages, image_dir, ModelChange(state), kermit_names, PosePriors(), model_dir, folder)
    assert not alone.changed


def test_an_image_whose_guided_pose_is_rejected_is_named_and_tried_again_when_its_chances_change(
    unmatched: dict[str, Any], kermit_names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """It has no other matches: without them nothing would be said of it."""
    (name,) = unmatched["names"]
    image_dir = Path(unmatched["image_dir"])
    folder = GrowthFolder(tmp_path / "grown")
    folder.sfm.root.mkdir(parents=True)
    shutil.copy(unmatched["database"], folder.sfm.database)
    state = GrowthState(
        settings="",
        images=dict.fromkeys(kermit_names, 1),
        registered=tuple(other for other in kermit_names if other != name),
    )
    stages = Stages(folder.sfm, SfmSettings(threads=1), Monitor())
    answer = {
        "registered": [],
        "loose": [],
        "unscaled": [],
        "conflicting": [],
        "posed": sorted(state.registered),
        "rejected": {name: "3 of its 90 verified matches fit its estimated pose"},
        "adjusted_images": 10,
        "adjusted_points": 10,
        "match_support": None,
    }
    tried: list[Any] = []

    def native_over(_job: str, names: list[str], *_: object, **__: object) -> dict[str, Any]:
        tried.append(names)
        return {"looked_at": names, "registration": answer}

    monkeypatch.setattr(stages, "native_over", native_over)
    priors = PosePriors.model_validate(unmatched["priors"])
    model_dir = Path(unmatched["model_dir"])
    change = guide(stages, image_dir, ModelChange(state), kermit_names, priors, model_dir, folder)
    assert not change.changed
    (digest,) = change.state.tried_guided.values()
    assert change.state == state.model_copy(
        update={"rejected": answer["rejected"], "tried_guided": {name: digest}}
    )
    (warning,) = change.warnings
    assert warning.startswith(f"{name} is not registered: 3 of its 90 ")
    assert "Photographs from between" in warning
    again = guide(stages, image_dir, ModelChange(change.state), kermit_names, priors, model_dir, folder)
    assert (again.state, tried) == (change.state, [[name]])
    less_accurate = priors.by_name[name].model_copy(update={"orientation_sigma_deg": 4.0})
    priors = PosePriors(by_name=priors.by_name | {name: less_accurate})
    guide(stages, image_dir, ModelChange(change.state), kermit_names, priors, model_dir, folder)
    assert tried == [[name], [name]]


@pytest.mark.parametrize(
    ("with_priors", "informative", "warned"), [(2, True, False), (1, True, True), (2, False, True)]
)
def test_new_images_that_conflict_are_named_unless_both_have_informative_priors(
    with_priors: int,
    informative: bool,
    warned: bool,
    unmatched: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    every = PosePriors.model_validate(unmatched["priors"]).by_name
    new, old = sorted(every)[:2]
    state = GrowthState(settings="", images=dict.fromkeys([new, old], 1), registered=(old,))
    stages = Stages(GrowthFolder(tmp_path / "grown").sfm, SfmSettings(threads=1), Monitor())
    answer = {
        "registered": [new],
        "loose": [],
        "unscaled": [],
        "conflicting": [(new, old)],
        "posed": [new, old],
        "rejected": {},
        "adjusted_images": 2,
        "adjusted_points": 10,
        "match_support": None,
    }
    monkeypatch.setattr(stages, "native_over", lambda *_, **__: answer)
    monkeypatch.setattr("fvs_engine.sfm.growing.registration.ask_witness", lambda *_: None)
    priors = PosePriors(by_name={name: every[name] for name in [new, old][:with_priors]})
    change = register(
        stages, tmp_path, state, [new], priors, tmp_path, tmp_path / "out", informative=informative
    )
    found = [warning for warning in change.warnings if "should show the same" in warning]
    assert len(found) == warned
    assert all(f"{new} and {old}" in warning for warning in found)


def test_a_warning_of_an_image_that_was_registered_after_all_is_dropped():
    state = GrowthState(settings="", images={"a": 1, "b": 1}, registered=("a",))
    lines = ["a is not registered: too few.", "b is not registered: too few.", "Something else."]
    assert still_true(lines, state) == tuple(lines[1:])


def test_a_photograph_that_shows_something_else_stays_as_it_was(unmatched: dict[str, Any]):
    """Its features are those of another place: shuffled among the keypoints."""
    (name,) = unmatched["names"]
    database = Path(unmatched["database"])
    number = image_ids(database)[name]
    with contextlib.closing(sqlite3.connect(database)) as db, db:
        ((data, rows),) = db.execute("SELECT data, rows FROM descriptors WHERE image_id = ?", (number,))
        mixed = np.random.default_rng(0).permutation(np.frombuffer(data, np.uint8).reshape(rows, 128))
        db.execute("UPDATE descriptors SET data = ? WHERE image_id = ?", (mixed.tobytes(), number))
    assert register_guided(lambda _: None, **unmatched)["registration"] is None
    assert not any(name in pair for pair in verified_matches(database, 1))


def test_images_of_a_camera_that_is_not_estimated_take_no_place_of_others(
    unmatched: dict[str, Any], kermit_names: list[str], monkeypatch: pytest.MonkeyPatch
):
    (name,), other = unmatched["names"], kermit_names[0]
    cameras = image_cameras(Path(unmatched["database"])) | {other: 99}
    monkeypatch.setattr(guided_module, "image_cameras", lambda _: cameras)
    model = pycolmap.Reconstruction(unmatched["model_dir"])
    leave_out(model, [other])
    model.write_binary(unmatched["model_dir"])
    neighbours = [each for each in kermit_names if each not in (name, other)]
    waiting = unmatched | {"neighbours": {other: neighbours, name: neighbours}, "names": [other, name]}
    monkeypatch.setattr(guided_module, "_MOST_LOOKED_AT", 1)
    tried = register_guided(lambda _: None, **waiting)
    assert tried["looked_at"] == [other, name]
    assert name in tried["registration"]["registered"]
    del waiting["neighbours"][name]
    assert register_guided(lambda _: None, **waiting) == {"looked_at": [other], "registration": None}


def test_an_image_that_a_call_does_not_get_to_counts_as_not_tried(
    unmatched: dict[str, Any], kermit_names: list[str], monkeypatch: pytest.MonkeyPatch
):
    (name,), other = unmatched["names"], kermit_names[0]
    model = pycolmap.Reconstruction(unmatched["model_dir"])
    leave_out(model, [other])
    model.write_binary(unmatched["model_dir"])
    neighbours = [each for each in kermit_names if each not in (name, other)]
    waiting = unmatched | {"neighbours": {name: neighbours, other: neighbours}, "names": [name, other]}
    monkeypatch.setattr(guided_module, "_MOST_GUIDED", 1)
    assert register_guided(lambda _: None, **waiting)["looked_at"] == [name]
    third = neighbours.pop()
    leave_out(model, [third])
    model.write_binary(unmatched["model_dir"])
    waiting["neighbours"] = dict.fromkeys([name, other, third], neighbours)
    monkeypatch.setattr(guided_module, "_MOST_GUIDED", 2)
    for tried, chosen in (([other], third), ([third, other], third), ([other, third], other)):
        looked_at = register_guided(lambda _: None, **waiting | {"tried": tried})["looked_at"]
        assert set(looked_at) == {name, chosen}


def test_pairs_of_an_image_that_is_not_registered_are_taken_back(unmatched: dict[str, Any]):
    """The check of poses rejects it: no pose explains more matches than there are."""
    (name,) = unmatched["names"]
    answer = register_guided(lambda _: None, **unmatched | {"min_image_support": 1.1})["registration"]
    assert answer is not None
    assert answer["registered"] == []
    assert name in answer["rejected"]
    assert not any(name in pair for pair in verified_matches(Path(unmatched["database"]), 1))
