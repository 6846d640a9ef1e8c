"""Images are added to a model; their true positions are known exactly."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from growing_yard import (
    AGREEMENT,
    BETWEEN,
    FAR,
    FIRST,
    NAMES,
    NEVER,
    NEXT,
    SETTINGS,
    Grown,
    copy_of,
    shares_apart,
    strangers,
)

from fvs_engine.geometry import angle_between, umeyama
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor
from fvs_engine.sfm import stages as stages_module
from fvs_engine.sfm.growing import step as step_module
from fvs_engine.sfm.growing.prior_veto import Veto, veto
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.growing.state import GrowthState, ModelChange
from fvs_engine.sfm.jobs import RegisterImages, Request
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.stages import Stages
from fvs_schema.findings import Finding, FindingCode, Severity


def test_added_images_are_registered_where_they_were_taken(grown: Grown, truth: Reconstruction):
    assert [view.name for view in grown.last.views] == NAMES[:8]
    assert shares_apart(grown.last, truth).max() < AGREEMENT
    assert len(grown.last.points) > 1.5 * len(grown.first.points)
    assert grown.last.point_errors_px.mean() < 1.0


def test_every_new_point_has_a_colour(grown: Grown):
    assert (grown.last.points.colors.max(axis=1) == 0).mean() <= 0.01


def test_the_model_frame_does_not_move(grown: Grown):
    names = [view.name for view in grown.first.views]
    before = np.stack([grown.first.centres()[name] for name in names])
    after = np.stack([grown.last.centres()[name] for name in names])
    moved = umeyama(before, after)
    assert set(names) <= grown.updates[3].moved  # by global bundle adjustment
    assert moved.scale == pytest.approx(1.0, abs=AGREEMENT)
    assert np.degrees(angle_between(moved.rotation, np.eye(3))) < 1.0
    assert np.linalg.norm(after - before, axis=1).max() < 2 * AGREEMENT * centre_spread(before)


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_many_new_images_are_reconstructed_with_the_first_ones_in_their_frame(
    grown: Grown, images: Path, truth: Reconstruction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder, stages, tested = copy_of(grown.bootstrapped, tmp_path), set[str](), list[Sequence[str]]()

    def veto_of(run: stages_module.Stages, model_dir: Path, names: Sequence[str], priors: PosePriors) -> Veto:
        tested.append(names)
        return veto(run, model_dir, names, priors)

    monkeypatch.setattr(step_module, "veto", veto_of)
    vocabulary_of_first = (folder / "words.npz").read_bytes()
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    update = growing.add(NAMES, Monitor(lambda progress: stages.add(progress.stage)))
    assert "incremental-mapping" in stages
    assert "registration" not in stages
    assert set(update.registered) == set(NAMES) - set(FIRST)
    assert [set(names) for names in tested] == [set(NAMES) - set(FIRST)]
    assert shares_apart(growing.reconstruction, truth).max() < AGREEMENT
    before, after = grown.first.centres(), growing.reconstruction.centres()
    spread = centre_spread(np.stack(list(after.values())))
    assert max(np.linalg.norm(after[name] - before[name]) for name in FIRST) < 2 * AGREEMENT * spread
    again = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    assert again.add(NAMES, Monitor()).registered == ()
    assert (folder / "words.npz").read_bytes() != vocabulary_of_first


def test_an_image_that_cannot_be_registered_is_tried_again_when_the_scene_has_grown(grown: Grown):
    boot, near, far, between = grown.updates
    assert set(boot.registered) == set(FIRST)
    assert (near.registered, near.unregistered) == ((NEXT,), ())
    assert (far.registered, far.unregistered) == ((), (FAR,))
    assert set(between.registered) == {*BETWEEN, FAR}
    assert between.unregistered == ()


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_an_image_is_tried_again_when_its_chances_have_changed_and_only_then(
    grown: Grown, images_copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    growing = GrowingReconstruction.open(
        copy_of(grown.bootstrapped, tmp_path), images_copy, SETTINGS, Monitor()
    )
    tried, native = list[str](), stages_module.Stages.native

    def spy(stages: stages_module.Stages, request: Request[Any], **rest: Any) -> Any:
        tried.extend(request.names if isinstance(request, RegisterImages) else ())
        return native(stages, request, **rest)

    monkeypatch.setattr(stages_module.Stages, "native", spy)
    first, second = strangers(images_copy, 2)
    tries = []
    for names in ([FAR], [first], [NEXT], [second], BETWEEN):
        tried.clear()
        growing.add(names, Monitor())
        tries.append(FAR in tried)
    assert tries == [
        True,
        False,  # what it matches is as before
        True,  # an image that matches the same ones is new, and could bring it in
        True,  # which did change them
        True,
    ]
    assert FAR in growing.registered


DUE = Finding.of(FindingCode.MANY_UNREGISTERED, severity=Severity.NOTE, unregistered=4)


def _doubt(support: float) -> Finding:
    return Finding.of(FindingCode.MATCH_SUPPORT, severity=Severity.DOUBT, support=support)


def test_nothing_is_said_of_images_or_cameras_that_a_remap_puts_right(
    grown: Grown, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    growing = GrowingReconstruction.open(copy_of(grown.bootstrapped, tmp_path), images, SETTINGS, Monitor())

    def register(_stages: object, state: GrowthState, *_: object) -> ModelChange:
        unregistered = (Finding.of(FindingCode.POSE_UNDETERMINED, [name]) for name in [NEXT, FAR])
        return ModelChange(state, warnings=(_doubt(0.8), *unregistered))

    def remap(_stages: object, state: GrowthState, *_: object) -> ModelChange:
        posed = [*state.registered, NEXT]
        return ModelChange(state.with_poses(posed, len(posed), state.adjusted_points), mapper="global")

    monkeypatch.setattr(step_module, "register", register)
    monkeypatch.setattr(step_module, "remap", remap)
    monkeypatch.setattr(step_module, "reason_to_remap", lambda *_: DUE)
    update = growing.add([NEXT, FAR], Monitor())
    assert update.warnings[0] == Finding.of(FindingCode.POSE_UNDETERMINED, [FAR])
    assert not any(NEXT in warning.images for warning in update.warnings)
    assert _doubt(0.8) not in update.warnings


def test_a_remap_ends_earlier_doubts_and_its_own_warnings_are_kept(
    grown: Grown, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    growing = GrowingReconstruction.open(copy_of(grown.bootstrapped, tmp_path), images, SETTINGS, Monitor())
    views, reasons = growing.reconstruction.views, iter([None, DUE])

    def register(_stages: object, state: GrowthState, *_: object) -> ModelChange:
        return ModelChange(state, warnings=(DUE, _doubt(0.8)))

    def remap(stages: Stages, state: GrowthState, *_: object) -> ModelChange:
        stages.warnings.append(Finding.of(FindingCode.UNCALIBRATED))
        return ModelChange(state, mapper="global", warnings=(_doubt(0.9),))

    monkeypatch.setattr(step_module, "register", register)
    monkeypatch.setattr(step_module, "remap", remap)
    monkeypatch.setattr(step_module, "reason_to_remap", lambda *_: next(reasons))
    assert _doubt(0.8) in growing.add([FAR], Monitor(), known=views).warnings
    warnings = growing.add([NEXT], Monitor(), known=views).warnings
    assert _doubt(0.8) not in warnings
    assert Finding.of(FindingCode.UNCALIBRATED) in warnings
    assert _doubt(0.9) in warnings


def test_what_was_added_is_not_added_again(
    grown: Grown, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = copy_of(grown.folder, tmp_path)
    monkeypatch.setattr(stages_module, "run_native", lambda *_args, **_named: pytest.fail("done again"))
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    generation = growing.generation
    update = growing.add(NAMES[:8], Monitor())
    assert (update.registered, update.unregistered, update.warnings, update.seconds) == ((), (), (), {})
    assert update.lost == update.moved == frozenset()
    assert [view.name for view in update.views] == NAMES[:8]
    assert growing.generation == generation
    assert set(growing.registered) == set(NAMES[:8])


def test_points_that_only_two_images_show_are_found_beside_the_model(
    grown: Grown, images: Path, tmp_path: Path
):
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images, SETTINGS, Monitor())
    found, model = growing.two_view_points(Monitor()), growing.reconstruction
    assert found is not None
    assert len(found.xyz) == len(found.seen_in) > 0.2 * len(model.points)
    assert not set(map(tuple, found.xyz)) & set(map(tuple, model.points.xyz))
    views = {view.name: view for view in model.views}
    assert set(found.seen_in) <= set(views)
    assert len(growing.reconstruction.points) == len(grown.last.points)
    for name, view in views.items():
        px = view.camera.project(view.camera_from_model.apply(found.xyz[found.seen_in == name]))
        assert ((px >= 0) & (px <= (view.camera.width, view.camera.height))).all()
    empty = GrowingReconstruction.open(tmp_path / "new", images, SETTINGS, Monitor())
    assert empty.two_view_points(Monitor()) is None


@pytest.mark.parametrize("gone", [False, True])
def test_models_do_without_points_of_two_images_when_these_cannot_be_computed(
    gone: bool, grown: Grown, images: Path, tmp_path: Path
):
    folder = copy_of(grown.folder, tmp_path)
    growing = GrowingReconstruction.open(folder, images, SETTINGS, Monitor())
    database = folder / "sfm" / "database.db"
    if gone:
        database.unlink()
    else:
        database.write_bytes(b"no database")
    assert growing.two_view_points(Monitor()) is None
    assert database.exists() != gone


def test_localising_finds_where_an_image_was_taken_and_changes_nothing(
    grown: Grown, images: Path, truth: Reconstruction, tmp_path: Path
):
    assert set(grown.localised) == {FAR, NEVER}
    assert grown.before_localising == grown.after_localising
    np.testing.assert_array_equal(grown.localised[FAR].centre, grown.last.centres()[FAR])
    guest = grown.localised[NEVER]
    together = Reconstruction((*grown.last.views, guest), grown.last.points, grown.last.point_errors_px)
    assert shares_apart(together, truth).max() < AGREEMENT
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images, SETTINGS, Monitor())
    (again,) = growing.localise([NEVER], Monitor()).values()
    np.testing.assert_array_equal(again.camera_from_model.matrix, guest.camera_from_model.matrix)
