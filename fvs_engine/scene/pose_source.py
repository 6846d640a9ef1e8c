"""Sources of a scene's poses and sparse points: the dataset, or structure from motion."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.rotations import matrix_from_rotation_vector
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.known_poses import KnownPoses
from fvs_engine.scene.settings import PriorNoise, SceneSettings
from fvs_engine.scene.sfm_poses import SfmPoses
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding


class PoseSource(Protocol):
    """Source of the poses of a scene's images. Its state on disk survives a kill."""

    @property
    def model_dir(self) -> Path | None:
        """The folder of the current COLMAP model; None when there is none."""
        ...

    @property
    def quarantined(self) -> Mapping[str, Finding]:
        """Images that are left out because they crash structure from motion → the reasons."""
        ...

    @property
    def why_unregistered(self) -> Mapping[str, Finding]:
        """Images without a pose → the reason, by the last try."""
        ...

    def has(self, visited: Collection[str]) -> bool:
        """Whether its images are those ``visited``, apart from quarantined ones and deleted photographs.

        They are not after an ``update`` that failed or was killed: images may have left it, or come to it.
        """
        ...

    def acknowledge(self) -> None:
        """Forget the warnings of updates: their results were saved. Others are returned once more."""
        ...

    def release(self, names: Collection[str]) -> None:
        """Forget quarantined images, so that the next ``update`` tries them again."""
        ...

    def update(
        self,
        visited: Sequence[str],
        known: Iterable[AnyView],
        monitor: Monitor,
        priors: PosePriors | None = None,
    ) -> PoseUpdate:
        """Register new images; return all current poses.

        ``visited`` are all visited images, old and new; others lose their poses. ``known`` are the
        caller's views, to which the changes in the result are relative. A repeated call after a kill gives
        the same result. ``priors``: pose priors of images without a pose in the dataset.
        """
        ...

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, AnyView]:
        """Estimate the poses of images that are not added; those without a pose are left out."""
        ...


def open_pose_source(folder: Path, dataset: Dataset, settings: SceneSettings, monitor: Monitor) -> PoseSource:
    """Open the source that ``settings.poses`` selects, with its files in ``folder``."""
    if settings.poses == "known":
        return KnownPoses(folder, dataset, settings.sfm)
    priors = None
    if dataset.views and settings.prior_noise is not None:
        priors = dataset_priors(dataset, settings.prior_noise, settings.seed)
    return SfmPoses(folder, dataset, settings.sfm, monitor, priors)


def dataset_priors(dataset: Dataset, noise: PriorNoise, seed: int) -> PosePriors:
    """Pose priors of all views, in the dataset's frame; the noise depends on ``seed`` and dataset only."""
    random = np.random.default_rng(seed)
    centres = np.stack([view.centre for view in dataset.views])
    sigma = noise.position_share * centre_spread(centres)
    by_name = {}
    for view, centre in zip(dataset.views, centres, strict=True):
        turn = matrix_from_rotation_vector(np.deg2rad(noise.orientation_deg) * random.normal(size=3))
        world_from_camera = RigidTransform(
            turn @ view.camera_from_model.rotation.T, centre + sigma * random.normal(size=3)
        )
        by_name[view.name] = PosePrior.of_camera(world_from_camera, sigma, noise.orientation_deg)
    return PosePriors(by_name=by_name)
