from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fvs_engine.monitor import Monitor
from fvs_engine.scene import sfm_poses
from fvs_engine.scene.dataset import Dataset
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.verification.positions import Positions


def test_position_priors_reach_structure_from_motion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    passed: list[Any] = []
    removed: list[Any] = []

    class Growing:
        added = ("a.png", "gone.png")

        def remove(self, names: Any) -> None:
            removed.append(names)

        def add(self, _names: Any, _monitor: Any, positions: Any, _known: Any) -> None:
            passed.append(positions)

    opened = SimpleNamespace(open=lambda *_: Growing())
    monkeypatch.setattr(sfm_poses, "GrowingReconstruction", opened)
    arriving = Dataset("arriving", tmp_path, (), arriving=True)
    source = sfm_poses.SfmPoses(tmp_path, arriving, SfmSettings(), Monitor())
    priors = Positions({"a.png": np.zeros(3)}, 0.5)
    source.update(["a.png"], (), Monitor(), priors)
    source.update(["a.png"], (), Monitor())
    assert passed == [priors, None]
    assert removed == [{"gone.png"}] * 2  # what is no longer visited loses its pose
