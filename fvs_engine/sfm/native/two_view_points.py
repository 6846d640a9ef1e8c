"""Points of a model that only two of its images show, which COLMAP's mappers leave out."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.sfm.jobs import FindTwoViewPoints, Report
from fvs_engine.sfm.native.match_cache import load_all


def two_view_points(request: FindTwoViewPoints, _report: Report) -> None:
    """See ``FindTwoViewPoints``; points with an error that COLMAP's mappers do not accept are left out."""
    model = pycolmap.Reconstruction(request.model_dir)
    old = set(model.point3D_ids())
    registered = sorted(image.name for image in model.images.values() if image.has_pose)
    add_two_view_points(model, request.database, registered)
    model.update_point_3d_errors()
    points = (model.point3D(point_id) for point_id in sorted(model.point3D_ids() - old))
    largest = pycolmap.IncrementalMapperOptions().filter_max_reproj_error
    added = [point for point in points if point.track.length() == 2 and point.error <= largest]
    np.savez(
        request.target,
        xyz=np.array([point.xyz for point in added]).reshape(-1, 3),
        seen_in=np.array([model.image(point.track.elements[0].image_id).name for point in added], dtype=str),
    )


def add_two_view_points(model: pycolmap.Reconstruction, database: Path, names: Sequence[str]) -> None:
    """Triangulate the points of the registered images ``names``, also those that only two images show.

    The points have no colours yet.
    """
    cache = load_all(database, {image.name for image in model.images.values()}, model)
    mapper = pycolmap.IncrementalMapper(cache)
    mapper.begin_reconstruction(model)
    options = pycolmap.IncrementalPipelineOptions()
    options.triangulation.ignore_two_view_tracks = False
    for name in names:
        mapper.triangulate_image(options.get_triangulation(), model.find_image_with_name(name).image_id)
    mapper.end_reconstruction(False)
