"""Interface of the sources of a scene's poses and sparse points: the dataset, or structure from motion."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.dataset_priors import dataset_priors
from fvs_engine.scene.known_poses import KnownPoses
from fvs_engine.scene.settings import SceneSettings
from fvs_engine.scene.sfm_poses import SfmPoses
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.views import AnyView


class PoseSource(Protocol):
    """Source of the poses of a scene's images. Its state on disk survives a kill."""

    @property
    def model_dir(self) -> Path | None:
        """The folder of the current COLMAP model; None when there is none."""
        ...

    @property
    def quarantined(self) -> Mapping[str, str]:
        """Images that are left out because they crash structure from motion → the reasons."""
        ...

    @property
    def why_unregistered(self) -> Mapping[str, str]:
        """Images without a pose → the reason, a sentence, by the last try."""
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
