from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fvs_engine.geometry import PinholeCamera, angle_between, look_at
from fvs_engine.monitor import Monitor
from fvs_engine.scene import sfm_poses
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.pose_source import dataset_priors, open_pose_source
from fvs_engine.scene.settings import PriorNoise, SceneSettings
from fvs_engine.sfm.growing.two_view_points import TwoViewPoints
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.views import View

Calls = tuple[list[Any], list[Any]]


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """What structure from motion is called with: the priors, and the names that it removes."""
    passed: list[Any] = []
    removed: list[Any] = []

    class Growing:
        added = ("a.png", "gone.png")

        def remove(self, names: Any) -> None:
            removed.append(names)

        def add(self, names: Any, _monitor: Any, priors: Any, known: Any) -> PoseUpdate:
            passed.append(priors)
            return PoseUpdate.between(known, (), PointCloud.empty(), names, 0)

        def two_view_points(self, _monitor: Any) -> TwoViewPoints:
            return TwoViewPoints(np.ones((1, 3)), np.array(["a.png"]))

    opened = SimpleNamespace(open=lambda *_, **__: Growing())
    monkeypatch.setattr(sfm_poses, "GrowingReconstruction", opened)
    return passed, removed


def test_pose_priors_reach_structure_from_motion(tmp_path: Path, calls: Calls) -> None:
    passed, removed = calls
    arriving = Dataset("arriving", tmp_path, (), arriving=True)
    source = open_pose_source(tmp_path, arriving, SceneSettings(), Monitor())
    priors = PosePriors(by_name={"a.png": PosePrior.at(np.zeros(3), 0.5)})
    update = source.update(["a.png"], (), Monitor(), priors)
    assert update.two_view_points is not None
    source.update(["a.png"], (), Monitor())
    assert passed == [priors, None]
    assert removed == [{"gone.png"}] * 2  # what is no longer visited loses its pose


def circle(count: int) -> Dataset:
    """Views on a circle around the middle, with a spread of 10."""
    camera = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    centres = 10.0 * np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    poses = [look_at(centre, np.zeros(3), np.array([0.0, 0.0, 1.0])).inverse() for centre in centres]
    return Dataset("circle", Path(), tuple(View(f"{i:03}.png", camera, pose) for i, pose in enumerate(poses)))


def test_the_noise_of_priors_is_as_requested_and_repeats() -> None:
    dataset = circle(300)
    priors = dataset_priors(dataset, PriorNoise(position_share=0.02, orientation_deg=5.0), seed=1)
    names = list(dataset.names)
    off = priors.positions(names) - np.stack([view.centre for view in dataset.views])
    rotations = np.stack([view.camera_from_model.rotation.T for view in dataset.views])
    turns = np.degrees(angle_between(rotations, np.stack([priors.by_name[n].rotation for n in names])))
    assert off.std() == pytest.approx(0.2, rel=0.1)
    np.testing.assert_allclose(priors.position_sigmas(names), 0.2)
    assert np.sqrt((turns**2).mean() / 3.0) == pytest.approx(5.0, rel=0.1)
    assert dataset_priors(dataset, PriorNoise(), seed=1) == priors
    assert dataset_priors(dataset, PriorNoise(), seed=2) != priors


def test_a_datasets_poses_are_priors_unless_they_are_not_wanted(tmp_path: Path, calls: Calls) -> None:
    dataset = circle(8)
    exact = SceneSettings(prior_noise=PriorNoise(position_share=0.0, orientation_deg=0.0))
    for settings in (exact, SceneSettings(prior_noise=None)):
        open_pose_source(tmp_path, dataset, settings, Monitor()).update(dataset.names, (), Monitor())
    given, none = calls[0]
    assert none is None
    np.testing.assert_allclose(given.positions(["003.png"])[0], dataset.by_name["003.png"].centre)
