"""Sparse points with their tracks, so that a model uses only what visited views saw."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.plan.familiarity import Observations
from fvs_engine.sfm.colmap.model import camera_centres, open_colmap
from fvs_engine.sfm.reconstruction import PointCloud

MIN_VIEWS = 2
"""Triangulation needs two views."""


@dataclass(frozen=True, eq=False)
class SparsePoints:
    """A dataset's points with their tracks.

    In observation i, view ``observing_view[i]`` (an index into ``view_names``) saw point
    ``observed_point[i]`` (an index into ``cloud``); no pair occurs twice.
    """

    cloud: PointCloud
    view_names: tuple[str, ...]
    observing_view: NDArray[np.int64]
    observed_point: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.cloud)

    def seen_in(self, name: str) -> PointCloud:
        """The points that the view ``name`` saw."""
        seen = self.observed_point[self.observing_view == self.view_names.index(name)]
        return PointCloud(self.cloud.xyz[seen], self.cloud.colors[seen])

    def seen_by(self, names: Iterable[str]) -> PointCloud:
        """The points that at least two of the views ``names`` saw.

        The position of a point also depends on views that were not visited; which points are returned does
        not.
        """
        visited = set(names)
        is_visited = np.array([name in visited for name in self.view_names], dtype=bool)
        seen = self.observed_point[is_visited[self.observing_view]]
        chosen = np.bincount(seen, minlength=len(self)) >= MIN_VIEWS
        return PointCloud(self.cloud.xyz[chosen], self.cloud.colors[chosen])


def points_from_pycolmap(model: pycolmap.Reconstruction, names: Mapping[str, str]) -> SparsePoints | None:
    """The points of a COLMAP model, and which views of ``names`` saw them; None when it has no points.

    ``names`` maps an image's name in the model to the view's. Points that are not finite are left out.
    """
    numbers = np.array(sorted(model.points3D), dtype=np.uint64)
    if len(numbers) == 0:
        return None
    points = [model.points3D[number] for number in numbers]
    xyz = np.array([point.xyz for point in points], dtype=np.float64)
    finite = np.isfinite(xyz).all(axis=1)
    colors = np.array([point.color for point in points], dtype=np.uint8)
    cloud, ids = PointCloud(xyz[finite], colors[finite]), numbers[finite]
    view_names = tuple(sorted(names.values()))
    index = {name: i for i, name in enumerate(view_names)}
    views, seen = [], []
    for image in model.images.values():
        if image.name not in names:
            continue
        observed = np.array([p.point3D_id for p in image.get_observation_points2D()], dtype=np.uint64)
        known = np.flatnonzero(np.isin(ids, observed))  # each once, however often the image saw it
        views.append(np.full(len(known), index[names[image.name]]))
        seen.append(known)
    return SparsePoints(cloud, view_names, np.concatenate(views), np.concatenate(seen))


def read_observations(model_dir: Path) -> Observations:
    """The sparse points of the model in ``model_dir`` and the centres that saw them, in its frame."""
    model = open_colmap(model_dir)
    centres = camera_centres(model)
    points = points_from_pycolmap(model, {name: name for name in centres})
    if points is None:
        return Observations(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    seen_from = np.stack([centres[name] for name in points.view_names])
    return Observations(points.cloud.xyz, points.observed_point, seen_from[points.observing_view])
