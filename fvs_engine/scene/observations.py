"""The observations of a COLMAP model, for plans."""

from pathlib import Path

import numpy as np

from fvs_engine.plan.familiarity import Observations
from fvs_engine.scene.sparse_points import points_from_pycolmap
from fvs_engine.sfm.colmap.model import open_colmap


def read_observations(model_dir: Path) -> Observations:
    """The sparse points of the model in ``model_dir`` and the centres that saw them, in its frame."""
    model = open_colmap(model_dir)
    centres = {image.name: image.projection_center() for image in model.images.values() if image.has_pose}
    points = points_from_pycolmap(model, {name: name for name in centres})
    if points is None:
        return Observations(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    seen_from = np.stack([centres[name] for name in points.view_names])
    return Observations(points.cloud.xyz, points.observed_point, seen_from[points.observing_view])
