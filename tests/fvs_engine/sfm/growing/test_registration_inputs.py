"""Images that wait are tried again when what decides about them has changed."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from row_of_cameras import row_of_cameras

from fvs_engine.sfm.growing.registration_inputs import RegistrationInputs, matches_of
from fvs_engine.sfm.growing.state import GrowthFolder, GrowthState, settings_digest
from fvs_engine.sfm.growing.step import _adjusts_all
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import GrowthSettings, SfmSettings

A, B, C, D, LONELY = "a.jpg", "b.jpg", "c.jpg", "d.jpg", "lonely.jpg"
NONE = PosePriors()


@pytest.fixture
def model() -> pycolmap.Reconstruction:
    return row_of_cameras(0.0, seen_by=3)


def inputs_of(
    model: pycolmap.Reconstruction,
    folder: Path,
    matches: dict[str, dict[str, int]],
    priors: PosePriors = NONE,
    camera: int = 1,
    *,
    informative: bool = True,
) -> RegistrationInputs:
    folder.mkdir(exist_ok=True)
    model.write_binary(folder)
    return RegistrationInputs(
        folder, matches, dict.fromkeys(matches, camera), priors, informative=informative
    )


def test_matches_are_of_both_images_of_a_pair():
    pairs = {(A, "00.jpg"): 20, ("01.jpg", A): 30, (B, A): 40, ("00.jpg", "01.jpg"): 50}
    assert matches_of([A, B, C], pairs) == {A: {"00.jpg": 20, "01.jpg": 30, B: 40}, B: {A: 40}}


def test_nothing_changes_while_the_images_around_one_stay(model: pycolmap.Reconstruction, tmp_path: Path):
    matches = {A: {"00.jpg": 20, "01.jpg": 30}}
    tried = {A: inputs_of(model, tmp_path / "before", matches).of(A)}
    far = model.find_image_with_name("20.jpg")
    model.deregister_frame(far.frame_id)
    after = inputs_of(model, tmp_path / "after", matches)
    assert not after.changed(A, tried)
    assert after.due(tried) == []


@pytest.mark.parametrize(
    "change", ["pose", "points", "camera", "own camera", "matches", "prior", "their prior", "informative"]
)
def test_each_of_what_decides_counts(change: str, model: pycolmap.Reconstruction, tmp_path: Path):
    matches, priors, own = {A: {"00.jpg": 20, "01.jpg": 30}}, NONE, 1
    tried = {A: inputs_of(model, tmp_path / "before", matches).of(A)}
    image = model.find_image_with_name("01.jpg")
    match change:
        case "pose":
            image.frame.rig_from_world.translation[0] += 1e-9
        case "points":
            model.delete_observation(image.image_id, image.get_observation_point2D_idxs()[0])
        case "camera":
            model.camera(image.camera_id).params = np.array([700.1, 400.0, 300.0])
        case "own camera":
            own = 2  # of which no image is registered
        case "matches":
            matches = {A: {"00.jpg": 20, "01.jpg": 31}}
        case "prior":
            priors = PosePriors(by_name={A: PosePrior.at(np.zeros(3), 1.0)})
        case "their prior":
            priors = PosePriors(by_name={"01.jpg": PosePrior.at(np.zeros(3), 1.0)})
    after = inputs_of(model, tmp_path / "after", matches, priors, own, informative=change != "informative")
    assert after.due(tried) == [A]


def test_what_one_image_may_change_is_tried_with_it(model: pycolmap.Reconstruction, tmp_path: Path):
    """B matches the new image, C an image that B matches, D matches C; the lonely one matches others."""
    matches = {
        LONELY: {"20.jpg": 20},
        D: {C: 20},
        C: {"05.jpg": 20, D: 20},
        B: {"05.jpg": 20, A: 20},
        A: {"00.jpg": 20, B: 20},
    }
    now = inputs_of(model, tmp_path / "model", matches)
    tried = {name: now.of(name) for name in matches if name != A}
    assert now.due(tried) == [D, C, B, A]
    assert now.due({}) == list(matches)


def test_a_stored_state_is_read_as_it_was(tmp_path: Path):
    folder = GrowthFolder(tmp_path)
    waiting = GrowthState(settings=settings_digest(SfmSettings()), images={A: 1}, tried={A: "1"})
    folder.save(waiting)
    assert folder.open(SfmSettings()) == waiting


def test_the_state_forgets_the_tries_of_images_that_are_registered_or_removed():
    state = GrowthState(
        settings="", images={A: 1, B: 1, C: 1}, tried={A: "1", B: "2", C: "3"}, tried_guided={A: "4", B: "5"}
    )
    posed = state.with_poses([A], 1, 10)
    assert (posed.tried, posed.tried_guided) == ({B: "2", C: "3"}, {B: "5"})
    left = posed.without([B])
    assert (left.tried, left.tried_guided) == ({C: "3"}, {})


@pytest.mark.parametrize(("new", "all_change"), [(0, False), (1, True)])
def test_an_adjustment_of_all_images_that_is_due_changes_the_inputs_of_all(new: int, all_change: bool):
    names = [f"{number}.jpg" for number in range(10)]
    state = GrowthState(settings="", registered=tuple(names), adjusted_images=10)
    assert _adjusts_all(state, new, GrowthSettings(adjust_every=0.1)) == all_change
