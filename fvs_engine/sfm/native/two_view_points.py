"""Points of a model that only two of its images show."""

from collections.abc import Sequence
from pathlib import Path

import pycolmap

from fvs_engine.sfm.native.match_cache import load_all


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
