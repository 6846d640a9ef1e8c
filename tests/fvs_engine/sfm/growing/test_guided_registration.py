"""Images without matches are registered by their pose priors, and tried again when their chances change."""

import contextlib
import shutil
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from growths import registration_request

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import leave_out
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.database import image_cameras, image_ids, pair_number, verified_matches
from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.growing.guided import guide
from fvs_engine.sfm.growing.registration import Unregistered, register
from fvs_engine.sfm.growing.state import GrowthFolder, GrowthState, ModelChange
from fvs_engine.sfm.jobs import GuidedRegistration, RegisterGuided, Registration
from fvs_engine.sfm.native import guided as guided_module
from fvs_engine.sfm.native.guided import register_guided
from fvs_engine.sfm.native.thresholds import GUIDED
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import Stages
from fvs_schema.findings import Finding, FindingCode, Severity


@pytest.fixture
def unmatched(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
) -> RegisterGuided:
    """The request for a photograph of kermit whose verified pairs are gone, and exact priors."""
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
    registration = registration_request(
        tmp_path,
        [name],
        image_dir=kermit_dir,
        refine=True,
        lens=True,
        priors=priors,
        adjust_every=1.0,
        adjusted_images=len(poses),
        adjusted_points=model.num_points3D(),
    )
    neighbours = {name: tuple(other for other in kermit_names if other != name)}
    return RegisterGuided(registration=registration, neighbours=neighbours, tried=())


def changed(
    request: RegisterGuided, neighbours: Mapping[str, Sequence[str]] | None = None, **registration: Any
) -> RegisterGuided:
    """The request with other ``neighbours`` and fields of its registration."""
    update = {"registration": request.registration.model_copy(update=registration)}
    return request.model_copy(update=update | ({} if neighbours is None else {"neighbours": neighbours}))


def registration(**changes: Any) -> Registration:
    """The answer of a registration that found nothing, but for ``changes``."""
    nothing = Registration(
        registered=(),
        loose=(),
        unscaled=(),
        conflicting=(),
        posed=(),
        rejected={},
        adjusted_images=10,
        adjusted_points=10,
        match_support=None,
    )
    return nothing.model_copy(update=changes)


def take_out(name: str, job: RegisterGuided) -> None:
    """Take the pose of an image from the model of a job."""
    model = pycolmap.Reconstruction(job.registration.model_dir)
    leave_out(model, [name])
    model.write_binary(job.registration.model_dir)


def test_a_photograph_without_matches_is_registered_by_its_prior(
    unmatched: RegisterGuided, kermit_sfm: SfmResult
):
    (name,) = unmatched.registration.names
    answer = register_guided(unmatched, lambda _: None).registration
    assert answer is not None
    assert answer.registered == (name,)
    assert any(name in pair for pair in verified_matches(unmatched.registration.database, 15))
    truth = camera_poses(pycolmap.Reconstruction(kermit_sfm.model_dir))
    here = camera_poses(pycolmap.Reconstruction(unmatched.registration.out_dir))
    spread = centre_spread(np.stack([pose.translation for pose in truth.values()]))
    assert np.linalg.norm(here[name].translation - truth[name].translation) < 0.01 * spread


@pytest.mark.system
def test_killed_between_matches_and_model_it_comes_to_the_same_model(
    unmatched: RegisterGuided, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    database = Path(shutil.copy(unmatched.registration.database, tmp_path / "whole.db"))
    whole = changed(unmatched, database=database, out_dir=tmp_path / "whole")
    whole.registration.out_dir.mkdir()
    register_guided(whole, lambda _: None)

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(guided_module, "register", killed)
        with pytest.raises(KeyboardInterrupt):
            register_guided(unmatched, lambda _: None)
    (name,) = unmatched.registration.names
    assert any(name in pair for pair in verified_matches(unmatched.registration.database, 15))
    register_guided(unmatched, lambda _: None)
    files = sorted(whole.registration.out_dir.iterdir())
    assert files
    for file in files:
        assert file.read_bytes() == (unmatched.registration.out_dir / file.name).read_bytes()


def growth_folder(unmatched: RegisterGuided, tmp_path: Path) -> GrowthFolder:
    """A folder with the database of the reconstruction, and its model as that of generation 0."""
    folder = GrowthFolder(tmp_path / "grown")
    folder.sfm.root.mkdir(parents=True)
    shutil.copytree(unmatched.registration.model_dir, folder.model(0))
    shutil.copy(unmatched.registration.database, folder.sfm.database)
    return folder


def test_what_ordinary_matches_leave_out_is_registered_after_them(
    unmatched: RegisterGuided, kermit_names: list[str], tmp_path: Path
):
    (name,) = unmatched.registration.names
    image_dir = unmatched.registration.image_dir
    folder = growth_folder(unmatched, tmp_path)
    state = GrowthState(
        settings="",
        images={other: (image_dir / other).stat().st_size for other in kermit_names},
        registered=tuple(other for other in kermit_names if other != name),
        adjusted_images=unmatched.registration.adjusted_images,
        adjusted_points=unmatched.registration.adjusted_points,
    )
    stages = Stages(folder.sfm, image_dir, SfmSettings(threads=1), Monitor())
    priors = unmatched.registration.priors
    change = guide(stages, folder, ModelChange(state), kermit_names, priors)
    assert change.changed
    assert change.state.unregistered == ()
    model = pycolmap.Reconstruction(folder.next_model)
    assert model.find_image_with_name(name).has_pose
    assert all(point.color.any() for point in model.points3D.values())
    assert not folder.guided_model.exists()
    alone = guide(stages, folder, ModelChange(state), kermit_names, PosePriors())
    assert not alone.changed


def test_an_image_whose_guided_pose_is_rejected_is_named_and_tried_again_when_its_chances_change(
    unmatched: RegisterGuided, kermit_names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """It has no other matches: without them nothing would be said of it."""
    (name,) = unmatched.registration.names
    image_dir = unmatched.registration.image_dir
    folder = growth_folder(unmatched, tmp_path)
    state = GrowthState(
        settings="",
        images=dict.fromkeys(kermit_names, 1),
        registered=tuple(other for other in kermit_names if other != name),
    )
    stages = Stages(folder.sfm, image_dir, SfmSettings(threads=1), Monitor())
    rejected = {name: Finding.of(FindingCode.POSE_UNSUPPORTED, [name], supported=3, matches=90)}
    answer = registration(posed=tuple(sorted(state.registered)), rejected=rejected)
    tried: list[Any] = []

    def native_over(names: list[str], *_: object, **__: object) -> GuidedRegistration:
        tried.append(names)
        return GuidedRegistration(looked_at=tuple(names), registration=answer)

    monkeypatch.setattr(stages, "native_over", native_over)
    priors = unmatched.registration.priors
    change = guide(stages, folder, ModelChange(state), kermit_names, priors)
    assert not change.changed
    (digest,) = change.state.tried_guided.values()
    assert change.state == state.model_copy(update={"rejected": rejected, "tried_guided": {name: digest}})
    (warning,) = change.warnings
    assert warning == change.state.rejected[name]
    again = guide(stages, folder, ModelChange(change.state), kermit_names, priors)
    assert (again.state, tried) == (change.state, [[name]])
    less_accurate = priors.by_name[name].model_copy(update={"orientation_sigma_deg": 4.0})
    priors = PosePriors(by_name=priors.by_name | {name: less_accurate})
    guide(stages, folder, ModelChange(change.state), kermit_names, priors)
    assert tried == [[name], [name]]


@pytest.mark.parametrize(
    ("with_priors", "informative", "warned"), [(2, True, False), (1, True, True), (2, False, True)]
)
def test_new_images_that_conflict_are_named_unless_both_have_informative_priors(
    with_priors: int,
    informative: bool,
    warned: bool,
    unmatched: RegisterGuided,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    every = unmatched.registration.priors.by_name
    new, old = sorted(every)[:2]
    state = GrowthState(settings="", images=dict.fromkeys([new, old], 1), registered=(old,))
    stages = Stages(GrowthFolder(tmp_path / "grown").sfm, tmp_path, SfmSettings(threads=1), Monitor())
    answer = registration(registered=(new,), conflicting=((new, old),), posed=(new, old))
    monkeypatch.setattr(stages, "native_over", lambda *_, **__: answer)
    priors = PosePriors(by_name={name: every[name] for name in [new, old][:with_priors]})
    images = Unregistered([new], priors, informative)
    change = register(stages, state, images, tmp_path, tmp_path / "out")
    conflict = Finding.of(FindingCode.CONFLICTING_VIEWS, [new, old], Severity.DOUBT)
    assert change.warnings == ((conflict,) if warned else ())


def test_a_photograph_that_shows_something_else_stays_as_it_was(unmatched: RegisterGuided):
    """Its features are those of another place: shuffled among the keypoints."""
    (name,) = unmatched.registration.names
    database = unmatched.registration.database
    number = image_ids(database)[name]
    with contextlib.closing(sqlite3.connect(database)) as db, db:
        ((data, rows),) = db.execute("SELECT data, rows FROM descriptors WHERE image_id = ?", (number,))
        mixed = np.random.default_rng(0).permutation(np.frombuffer(data, np.uint8).reshape(rows, 128))
        db.execute("UPDATE descriptors SET data = ? WHERE image_id = ?", (mixed.tobytes(), number))
    assert register_guided(unmatched, lambda _: None).registration is None
    assert not any(name in pair for pair in verified_matches(database, 1))


def test_images_of_a_camera_that_is_not_estimated_take_no_place_of_others(
    unmatched: RegisterGuided, kermit_names: list[str], monkeypatch: pytest.MonkeyPatch
):
    (name,), other = unmatched.registration.names, kermit_names[0]
    cameras = image_cameras(unmatched.registration.database) | {other: 99}
    monkeypatch.setattr(guided_module, "image_cameras", lambda _: cameras)
    take_out(other, unmatched)
    neighbours = [each for each in kermit_names if each not in (name, other)]
    waiting = changed(unmatched, {other: neighbours, name: neighbours}, names=(other, name))
    monkeypatch.setattr(guided_module, "GUIDED", replace(GUIDED, max_looked_at=1))
    tried = register_guided(waiting, lambda _: None)
    assert tried.looked_at == (other, name)
    assert tried.registration is not None
    assert name in tried.registration.registered
    waiting = changed(waiting, {other: neighbours})
    assert register_guided(waiting, lambda _: None) == GuidedRegistration(
        looked_at=(other,), registration=None
    )


@pytest.mark.system
def test_an_image_that_a_call_does_not_get_to_counts_as_not_tried(
    unmatched: RegisterGuided, kermit_names: list[str], monkeypatch: pytest.MonkeyPatch
):
    (name,), other = unmatched.registration.names, kermit_names[0]
    take_out(other, unmatched)
    neighbours = [each for each in kermit_names if each not in (name, other)]
    waiting = changed(unmatched, {name: neighbours, other: neighbours}, names=(name, other))
    monkeypatch.setattr(guided_module, "GUIDED", replace(GUIDED, max_guided=1))
    assert register_guided(waiting, lambda _: None).looked_at == (name,)
    third = neighbours.pop()
    take_out(third, unmatched)
    waiting = changed(waiting, dict.fromkeys([name, other, third], neighbours))
    monkeypatch.setattr(guided_module, "GUIDED", replace(GUIDED, max_guided=2))
    for tried, chosen in (([other], third), ([third, other], third), ([other, third], other)):
        again = waiting.model_copy(update={"tried": tried})
        looked_at = register_guided(again, lambda _: None).looked_at
        assert set(looked_at) == {name, chosen}


def test_pairs_of_an_image_that_is_not_registered_are_taken_back(unmatched: RegisterGuided):
    """The check of poses rejects it: no pose explains more matches than there are."""
    (name,) = unmatched.registration.names
    answer = register_guided(changed(unmatched, min_image_support=1.1), lambda _: None).registration
    assert answer is not None
    assert answer.registered == ()
    assert name in answer.rejected
    assert not any(name in pair for pair in verified_matches(unmatched.registration.database, 1))
