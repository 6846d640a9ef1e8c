"""Colours of points from the photographs that show them."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.sfm.growing.two_view_points import TwoViewPoints
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.views import TrainingView


def colored(points: TwoViewPoints, views: Sequence[TrainingView]) -> PointCloud:
    """The points, each with the colour of the pixel that shows it.

    Points outside of their undistorted photograph are left out.
    """
    found, colors = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.uint8)]
    for view in views:
        xyz = points.xyz[points.seen_in == view.name]
        px = view.camera.project(view.camera_from_model.apply(xyz))
        inside = ((px >= 0) & (px < (view.camera.width, view.camera.height))).all(axis=1)
        column, row = px[inside].astype(np.int64).T
        found.append(xyz[inside])
        colors.append(view.image[row, column])
    return PointCloud(np.concatenate(found), np.concatenate(colors))
