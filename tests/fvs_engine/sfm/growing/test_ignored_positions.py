"""Positions that contradict the images: as a whole they are ignored; single ones are named."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.growing.state import GrowthFolder
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_schema.findings import Finding, FindingCode, Severity


@pytest.fixture
def growing(kermit_sfm: SfmResult, kermit_dir: Path, tmp_path: Path) -> GrowingReconstruction:
    """A growing reconstruction whose first update finds the features and the model of all photographs."""
    shutil.copytree(kermit_sfm.model_dir.parent, tmp_path / "sfm")
    (tmp_path / "sfm" / "report.json").unlink()
    return GrowingReconstruction.open(tmp_path, kermit_dir, SfmSettings(), Monitor())


@pytest.mark.system
@pytest.mark.parametrize("mirrored", [False, True])
def test_positions_that_the_images_contradict_are_ignored_by_the_first_model(
    mirrored: bool,
    growing: GrowingReconstruction,
    kermit_sfm: SfmResult,
    kermit_names: list[str],
    tmp_path: Path,
) -> None:
    assert not GrowthFolder(tmp_path).ignores_positions
    x = -1.0 if mirrored else 1.0
    centres = kermit_sfm.reconstruction.centres()
    given = {name: PosePrior.at(centre * [x, 1.0, 1.0], 0.01) for name, centre in centres.items()}
    update = growing.add(kermit_names, Monitor(), PosePriors(by_name=given))
    assert len(update.registered) == len(kermit_names)
    assert (Finding.of(FindingCode.POSITIONS_IGNORED) in update.warnings) == mirrored
    assert GrowthFolder(tmp_path).ignores_positions == mirrored


@pytest.mark.system
def test_an_image_that_its_position_contradicts_is_doubtful_once_priors_can_judge_it(
    growing: GrowingReconstruction, kermit_names: list[str]
) -> None:
    """As one that was registered while the track was too short for the accuracy of its positions."""
    assert not growing.add(kermit_names, Monitor(), PosePriors()).warnings
    centres = dict(growing.reconstruction.centres())
    centres[kermit_names[3]] = centres[kermit_names[3]] + 5.0

    def warnings(sigma: float) -> tuple[Finding, ...]:
        given = {name: PosePrior.at(centre, sigma) for name, centre in centres.items()}
        return growing.add(kermit_names, Monitor(), PosePriors(by_name=given)).warnings

    assert warnings(10.0) == ()
    (doubt,) = warnings(0.01)
    assert (doubt.code, doubt.severity) == (FindingCode.FAR_FROM_PRIORS, Severity.DOUBT)
    assert doubt.images == (kermit_names[3],)


@pytest.mark.system
def test_that_the_receiver_froze_is_said_once(
    growing: GrowingReconstruction, kermit_names: list[str]
) -> None:
    said = []
    for names in (kermit_names[:-1], kermit_names):
        priors = PosePriors(by_name={name: PosePrior.at(np.ones(3), 0.1) for name in names})
        warnings = growing.add(names, Monitor(), priors).warnings
        growing.acknowledge()
        said.append([warning.code for warning in warnings].count(FindingCode.FROZEN_POSITIONS))
    assert said == [1, 0]
