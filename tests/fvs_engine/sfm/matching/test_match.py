import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult
from fvs_engine.sfm.matching import match
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages


def test_pairs_of_a_large_set_are_selected_by_the_priors_of_the_request(
    kermit_sfm: SfmResult, kermit_names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    passed: list[Mapping[int, Any]] = []

    def selected(_count: int, _descriptors: Any, positions: Mapping[int, Any]) -> list[tuple[int, int]]:
        passed.append(positions)
        return []

    monkeypatch.setattr(match, "selected_pairs", selected)
    shutil.copyfile(kermit_sfm.model_dir.parent / "database.db", tmp_path / "database.db")
    stages = Stages(SfmFolder(tmp_path), SfmSettings(exhaustive_up_to=2), Monitor())
    priors = PosePriors(by_name={kermit_names[2]: PosePrior.at(np.array([1.0, 2.0, 3.0]))})
    match.match_features(stages, kermit_names, priors)
    match.match_features(stages, kermit_names)
    (given, in_exif) = passed
    assert {index: place.tolist() for index, place in given.items()} == {2: [1.0, 2.0, 3.0]}
    assert 2 not in in_exif or in_exif[2].tolist() != [1.0, 2.0, 3.0]
