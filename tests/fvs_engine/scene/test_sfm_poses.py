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


def test_told_positions_reach_structure_from_motion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[Any] = []
    nothing = SimpleNamespace(views=(), points=np.zeros((0, 3)), point_colors=np.zeros((0, 3), np.uint8))

    class Growing:
        generation = 0
        reconstruction = nothing

        def add(self, _names: Any, _monitor: Any, positions: Any = None) -> Any:
            heard.append(positions)
            return SimpleNamespace(warnings=())

    opened = SimpleNamespace(open=lambda *_: Growing())
    monkeypatch.setattr(sfm_poses, "GrowingReconstruction", opened)
    arriving = Dataset("arriving", tmp_path, (), arriving=True)
    source = sfm_poses.SfmPoses(tmp_path, arriving, SfmSettings(), Monitor())
    told = Positions({"a.png": np.zeros(3)}, 0.5)
    source.stand(["a.png"], Monitor(), told)
    source.stand(["a.png"], Monitor())
    assert heard == [told, None]
