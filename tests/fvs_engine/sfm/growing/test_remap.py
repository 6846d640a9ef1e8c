import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import leave_out, load_models
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.colmap.model import camera_poses, move, read_colmap
from fvs_engine.sfm.growing.remap import reason_to_remap, remap, start_again
from fvs_engine.sfm.growing.state import GrowthState
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import GateSettings, SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages
from fvs_schema.findings import FindingCode, Severity

MODEL_FROM_COLMAP = SimilarityTransform(
    3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
)


def centres(model: pycolmap.Reconstruction) -> dict[str, np.ndarray]:
    return {name: pose.translation for name, pose in camera_poses(model).items()}


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
    move(model, MODEL_FROM_COLMAP)
    current = tmp_path / "current"
    current.mkdir()
    model.write_binary(current)
    before = read_colmap(current).centres()
    stages = Stages(SfmFolder(folder), kermit_dir, SfmSettings(), Monitor())
    state = current_state(kermit_dir, kermit_names, kermit_names[:5])

    outcome = remap(stages, state, PosePriors(), current, tmp_path / "next")

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
    stages = Stages(SfmFolder(folder), kermit_dir, SfmSettings(), Monitor())
    state = current_state(kermit_dir, kermit_names, kermit_names)
    outcome = remap(stages, state, PosePriors(), kermit_sfm.model_dir, tmp_path / "next")
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
    fell = reason_to_remap(state, 0.90, 0, settings)
    assert fell is not None
    assert (fell.code, fell.numbers) == (FindingCode.SUPPORT_FELL, {"before": 0.95, "now": 0.90})
    many = reason_to_remap(state, None, 4, settings)
    assert many is not None
    assert (many.code, many.numbers) == (FindingCode.MANY_UNREGISTERED, {"unregistered": 4})
    # Tried when there were hardly fewer images: not again so soon.
    tried = state.model_copy(update={"mapped_images": 28})
    assert reason_to_remap(tried, 0.80, 10, settings) is None


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
    stages = Stages(folder, kermit_dir, SfmSettings(gate=everyone), Monitor())
    folded = load_models(folder.mapping("incremental"))[0]
    fold(folded, kermit_names[:5])
    folded.write_binary(folder.mapping("incremental") / "0")
    outcome = remap(stages, state, PosePriors(), current, tmp_path / "next")
    assert not outcome.changed


@pytest.mark.system
def test_a_doubtful_model_of_all_images_does_not_replace_an_accepted_one_that_it_contradicts(
    kermit_sfm: SfmResult, kermit_dir: Path, kermit_names: list[str], tmp_path: Path
):
    """GPS confirms the new model, so that the gate does not reject it for its few fitting matches."""
    folder = SfmFolder(shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm"))
    model = pycolmap.Reconstruction(kermit_sfm.model_dir)
    priors = PosePriors(by_name={name: PosePrior.at(place) for name, place in centres(model).items()})
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
    stages = Stages(folder, kermit_dir, SfmSettings(gate=gate), Monitor())
    outcome = start_again(stages, state, priors, current, tmp_path / "next")
    assert not outcome.changed
    kept, *reasons = outcome.warnings
    assert kept.code is FindingCode.NEW_MODEL_DOUBTFUL
    assert {reason.severity for reason in reasons} == {Severity.REJECTION}

    strict = gate.model_copy(update={"min_doubtful_match_support": 0.985})
    stages = Stages(folder, kermit_dir, SfmSettings(gate=strict), Monitor())
    outcome = start_again(stages, state, PosePriors(), current, tmp_path / "next")
    assert not outcome.changed
    kept, *reasons = outcome.warnings
    assert kept.code is FindingCode.NEW_MODEL_REJECTED
    assert {reason.severity for reason in reasons} == {Severity.REJECTION}


def fold(model: pycolmap.Reconstruction, names: list[str], by: float = 0.01) -> None:
    """Move some cameras aside by a share of the spread: with the default hardly any match minds."""
    by_name = {image.name: image for image in model.images.values() if image.has_pose}
    aside = by * centre_spread(np.stack(list(centres(model).values())))
    for name in names:
        image = by_name[name]
        away = pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0.0, 0.0, aside]))
        image.frame.rig_from_world = away * image.cam_from_world()
