"""Poses as the dataset gives them, with the points that the visited views support."""

from collections.abc import Sequence
from pathlib import Path
from statistics import median

import numpy as np

from fvs_engine.errors import ReconstructionError
from fvs_engine.monitor import Monitor
from fvs_engine.scene.color_evidence import MIN_AGREEMENT, color_agreement
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.poses import Standing
from fvs_engine.scene.sparse_points import PointCloud, SparsePoints
from fvs_engine.sfm.batch.mapping import read_witnesses
from fvs_engine.sfm.batch.triangulate import triangulate
from fvs_engine.sfm.colmap.model import has_colmap_model, open_colmap
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.sfm.report import GIVEN, Evidence
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages
from fvs_engine.sfm.verification.positions import Positions
from fvs_engine.views import AnyView

MIN_MATCH_SUPPORT = 0.5
"""Given poses that explain less of the verified matches than this belong to other photographs."""

_MIN_VIEWS = 2
_NO_POINTS = PointCloud(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8))


class KnownPoses:
    """A ``PoseSource`` for a dataset whose poses are taken as they are: the model frame is the world frame.

    The points are those of the dataset's model that at least two visited views saw; a dataset without points
    has them triangulated from the visited photographs. Features and matches are kept, but all points are
    found again with every new photograph.
    """

    def __init__(self, folder: Path, dataset: Dataset, settings: SfmSettings) -> None:
        self._folder = folder
        self._dataset = dataset
        self._settings = settings
        self._color_agreements: dict[str, float | None] = {}

    def stand(
        self,
        visited: Sequence[str],
        monitor: Monitor,
        positions: Positions | None = None,  # noqa: ARG002 - whole poses say more
    ) -> Standing:
        """See ``PoseSource``. Every view has its pose at once.

        Raises ``ReconstructionError`` when the photographs contradict the given poses: by the colours of the
        dataset's points, or, where it has none, by their matches with each other.
        """
        views = tuple(self._dataset.by_name[name] for name in visited)
        if self._dataset.points is not None:
            self._require_colors(views, self._dataset.points, monitor)
            return Standing(views, self._dataset.points.seen_by(visited), len(visited))
        points, warnings = self._triangulated(views, monitor)
        return Standing(views, points, len(visited), warnings)

    def localise(self, names: Sequence[str], monitor: Monitor) -> dict[str, AnyView]:
        """See ``PoseSource``: what the dataset says."""
        monitor.check()
        return {name: self._dataset.by_name[name] for name in names}

    def _triangulated(self, views: Sequence[AnyView], monitor: Monitor) -> tuple[PointCloud, tuple[str, ...]]:
        if len(views) < _MIN_VIEWS:
            return _NO_POINTS, ()
        given = Reconstruction(
            tuple(sorted(views, key=lambda view: view.name)), _NO_POINTS.xyz, _NO_POINTS.colors, np.zeros(0)
        )
        try:
            result = triangulate(given, self._dataset.image_dir, self._folder, self._settings, monitor)
        except ReconstructionError:  # no point: the views are too far apart, or the poses wrong
            folder = SfmFolder(self._folder)
            if not has_colmap_model(folder.mapping(GIVEN)):  # it did not get that far
                raise
            witnesses = read_witnesses(Stages(folder, self._settings, monitor))
            self._require_support(witnesses.testify(open_colmap(folder.mapping(GIVEN)), monitor))
            return _NO_POINTS, ()
        self._require_support(result.report.candidates[0].evidence)
        cloud = PointCloud(result.reconstruction.points, result.reconstruction.point_colors)
        return cloud, result.report.warnings

    def _require_support(self, evidence: Evidence | None) -> None:
        """Photographs that do not match at all say nothing; matches must not contradict the poses."""
        if evidence is not None and evidence.match_support < MIN_MATCH_SUPPORT:
            raise self._contradiction(f"only {evidence.match_support:.0%} of the verified matches fit them.")

    def _require_colors(self, views: Sequence[AnyView], points: SparsePoints, monitor: Monitor) -> None:
        """Most photographs must show the colours of their points, as far as points have any."""
        for view in views:
            if view.name not in self._color_agreements:
                monitor.check()
                seen = points.seen_in(view.name)
                self._color_agreements[view.name] = color_agreement(view, seen, self._dataset.image_dir)
        told = [value for view in views if (value := self._color_agreements[view.name]) is not None]
        if len(told) >= _MIN_VIEWS and median(told) < MIN_AGREEMENT:
            raise self._contradiction(
                "where they see the model's points, the photographs have other colours (correlation "
                f"{median(told):.2f}; at least {MIN_AGREEMENT} is expected)."
            )

    def _contradiction(self, evidence: str) -> ReconstructionError:
        return ReconstructionError(
            f"The given poses of {self._dataset.name} contradict its photographs: {evidence}",
            hint="Do they belong to these images? A transforms.json has OpenGL axes, camera to world.",
        )
