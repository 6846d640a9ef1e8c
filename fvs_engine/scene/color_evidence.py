"""Correlation of images with the colours of the points that a dataset's model has in their views."""

from pathlib import Path

import numpy as np

from fvs_engine.images.masks import read_mask, reduced_mask
from fvs_engine.images.pixels import load_rgb
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.views import AnyView

MIN_AGREEMENT = 0.3
"""Poses belong to other images when the median image agrees less than this with its points.

Measured on *bonsai*, median of fifteen views: 0.75 as given, 0.41 with every photograph replaced by the next
of the capture (which is almost the same), 0.17 by the one sixty frames later, 0.18 in reversed order.
"""

_LONG_SIDE_PX = 128
"""A point's colour is a mean over many photographs: fine detail would only add noise."""

_MIN_POINTS = 30


def color_agreement(view: AnyView, seen: PointCloud, image_dir: Path) -> float | None:
    """Correlation between the brightness of the points ``seen`` and of the photograph where they project.

    None where there is nothing to compare: too few points in the image, or all of one brightness (a model
    without colours). Raises ``InvalidInputError`` when the photograph cannot be read.
    """
    photograph = load_rgb(image_dir / view.name, _LONG_SIDE_PX).mean(axis=-1)
    height, width = photograph.shape
    camera_points = view.camera_from_model.apply(seen.xyz)
    ahead = camera_points[:, 2] > 0
    pixels = view.camera.project(camera_points[ahead]) * [
        width / view.camera.width,
        height / view.camera.height,
    ]
    inside = (np.isfinite(pixels) & (pixels >= 0) & (pixels < [width, height])).all(axis=1)
    columns, rows = pixels[inside].astype(np.int64).T
    mask = read_mask(image_dir, view.name)
    if mask is not None:
        inside[inside] &= reduced_mask(mask, (width, height))[rows, columns]
        columns, rows = pixels[inside].astype(np.int64).T
    shown, known = photograph[rows, columns], seen.colors[ahead][inside].mean(axis=-1)
    if len(shown) < _MIN_POINTS or shown.std() == 0 or known.std() == 0:
        return None
    return float(np.corrcoef(shown, known)[0, 1])
