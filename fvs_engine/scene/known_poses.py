"""Poses of the dataset, with the points that the visited views saw."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median

from fvs_engine.errors import ReconstructionError
from fvs_engine.monitor import Monitor
from fvs_engine.scene.color_evidence import MIN_AGREEMENT, color_agreement
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.sparse_points import SparsePoints
from fvs_engine.sfm.batch.mapping import read_model_evidence
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.colmap.model import has_colmap_model, open_colmap
from fvs_engine.sfm.growing.update import PoseUpdate
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.reconstruction import PointCloud, Reconstruction
from fvs_engine.sfm.report import GIVEN, Evidence
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding

MIN_MATCH_SUPPORT = 0.5
"""Match support below which the given poses are taken to belong to other photographs."""

_MIN_VIEWS = 2


class KnownPoses:
    """A ``PoseSource`` that uses a dataset's poses unchanged: the model frame is the dataset's.

    The points are those of the dataset's model that at least two visited views saw; for a dataset without
    points they are triangulated from the visited images. Features and matches are kept, but all points are
    triangulated again with every new image.
    """

    def __init__(self, folder: Path, dataset: Dataset, settings: SfmSettings) -> None:
        self._folder = folder
        self._dataset = dataset
        self._settings = settings
        self._color_agreements: dict[str, float | None] = {}

    @property
    def model_dir(self) -> Path | None:
        """See ``PoseSource``: None, as the scene has no COLMAP model of its own."""
        return None

    @property
    def quarantined(self) -> Mapping[str, Finding]:
        """See ``PoseSource``: images that crash triangulation."""
        return SfmFolder(self._folder).quarantine.reasons

    @property
    def why_unregistered(self) -> Mapping[str, Finding]:
        """See ``PoseSource``: empty, as the dataset has a pose of every image."""
        return {}

    def has(self, visited: Collection[str]) -> bool:  # noqa: ARG002 - it keeps none
        """See ``PoseSource``."""
        return True

    def acknowledge(self) -> None:
        """See ``PoseSource``: it keeps no warnings."""

    def release(self, names: Collection[str]) -> None:
        """See ``PoseSource``."""
        SfmFolder(self._folder).quarantine.release(names)

    def update(
        self,
        visited: Sequence[str],
        known: Iterable[AnyView],
        monitor: Monitor,
        priors: PosePriors | None = None,  # noqa: ARG002 - the dataset's poses replace them
    ) -> PoseUpdate:
        """See ``PoseSource``. Every image is registered at once; the generation counts the images.

        Raises ``ReconstructionError`` when the images contradict the dataset's poses: by the colours of its
        points, or, where it has none, by their matches with each other.
        """
        views = tuple(self._dataset.by_name[name] for name in visited)
        warnings: tuple[Finding, ...] = ()
        if self._dataset.points is not None:
            self._require_colors(views, self._dataset.points, monitor)
            points = self._dataset.points.seen_by(visited)
        else:
            points, warnings = self._triangulated(views, monitor)
        update = PoseUpdate.between(known, views, points, visited, len(visited))
        return replace(update, warnings=warnings)

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, AnyView]:
        """See ``PoseSource``: the dataset's poses."""
        monitor.check()
        return {name: self._dataset.by_name[name] for name in names}

    def _triangulated(
        self, views: Sequence[AnyView], monitor: Monitor
    ) -> tuple[PointCloud, tuple[Finding, ...]]:
        if len(views) < _MIN_VIEWS:
            return PointCloud.empty(), ()
        given = Reconstruction.of_views(views)
        try:
            result = triangulate(given, self._dataset.image_dir, self._folder, self._settings, monitor)
        except ReconstructionError:  # no point: the views are too far apart, or their poses are wrong
            folder = SfmFolder(self._folder)
            if not has_colmap_model(folder.mapping(GIVEN)):  # it failed earlier
                raise
            stages = Stages(folder, self._dataset.image_dir, self._settings, monitor)
            try:
                evidence = read_model_evidence(stages)
            except CulpritError as culprit:
                folder.quarantine.add(culprit)
                return self._triangulated(views, monitor)
            self._require_support(evidence.of(open_colmap(folder.mapping(GIVEN)), monitor))
            return PointCloud.empty(), ()
        self._require_support(result.report.candidates[0].evidence)
        return result.reconstruction.points, result.report.warnings

    def _require_support(self, evidence: Evidence | None) -> None:
        """Raise when matches contradict the poses; images without matches pass."""
        if evidence is not None and evidence.match_support < MIN_MATCH_SUPPORT:
            raise self._contradiction(f"only {evidence.match_support:.0%} of the verified matches fit them.")

    def _require_colors(self, views: Sequence[AnyView], points: SparsePoints, monitor: Monitor) -> None:
        """Raise when most images contradict the colours of their points."""
        for view in views:
            if view.name not in self._color_agreements:
                monitor.check()
                seen = points.seen_in(view.name)
                self._color_agreements[view.name] = color_agreement(view, seen, self._dataset.image_dir)
        agreements = [value for view in views if (value := self._color_agreements[view.name]) is not None]
        if len(agreements) >= _MIN_VIEWS and median(agreements) < MIN_AGREEMENT:
            raise self._contradiction(
                "where they see the model's points, the photographs have other colours (correlation "
                f"{median(agreements):.2f}; at least {MIN_AGREEMENT} is expected)."
            )

    def _contradiction(self, evidence: str) -> ReconstructionError:
        return ReconstructionError(
            f"The given poses of {self._dataset.name} contradict its photographs: {evidence}",
            hint="Check that they belong to these images. A transforms.json has OpenGL axes, camera "
            "to world.",
        )
