"""Training views: views with their photographs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.images.masks import Mask, reduced_mask
from fvs_engine.images.pixels import reduced_rgb, reduced_size
from fvs_engine.views import PinholeView, View

EXTENT_MARGIN = 1.1

MIN_LONG_SIDE_PX = 64
"""Images are not reduced below this long side: they lose too much detail."""


@dataclass(frozen=True, eq=False)
class TrainingView(View[PinholeCamera]):
    """A view with its undistorted photograph: ``image`` [H, W, 3] uint8, of exactly the camera's size.

    ``mask`` [H, W] is True where the image counts; None: all of it.
    Raises ``InvalidInputError`` when image and camera do not fit.
    """

    image: NDArray[np.uint8]
    mask: Mask | None = None

    def __post_init__(self) -> None:
        expected = (self.camera.height, self.camera.width, 3)
        if self.image.shape != expected or self.image.dtype != np.uint8:
            raise InvalidInputError(
                f"{self.name}: the image is {self.image.dtype} {self.image.shape}, "
                f"its camera needs uint8 {expected}.",
                hint="Resize the image and its camera together.",
            )

    def reduced(self, reduction: int) -> "TrainingView":
        """The view with both sides divided by ``reduction``, but not below ``MIN_LONG_SIDE_PX``."""
        long_side_px = max(self.camera.width, self.camera.height)
        wanted_px = max(MIN_LONG_SIDE_PX, round(long_side_px / reduction))
        size = reduced_size(self.camera.width, self.camera.height, wanted_px)
        if size == (self.camera.width, self.camera.height):
            return self
        mask = None if self.mask is None else reduced_mask(self.mask, size)
        image = reduced_rgb(self.image, size)
        return replace(self, camera=self.camera.resized(*size), image=image, mask=mask)

    @property
    def empty(self) -> bool:
        """Whether no pixel of the image counts."""
        return self.mask is not None and not self.mask.any()

    @property
    def counted_share(self) -> float:
        """See ``View``."""
        return 1.0 if self.mask is None else float(self.mask.mean())


def counted_pixels(view: PinholeView) -> Mask | None:
    """Which pixels [H, W] of a view's image count; None: all of them, or the view has no image."""
    return view.mask if isinstance(view, TrainingView) else None


def points_that_count(points: NDArray[np.float64], views: Sequence[TrainingView]) -> Mask:
    """Which of the points [P, 3] are not shown by masked pixels alone: a bool [P]."""
    masked, counts = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool)
    for view in views if any(view.mask is not None for view in views) else ():
        in_camera = view.camera_from_model.apply(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = view.camera.project(in_camera)
        size = (view.camera.width, view.camera.height)
        shown = (in_camera[:, 2] > 0) & ((pixels >= 0) & (pixels < size)).all(axis=1)
        column, row = pixels[shown].astype(np.int64).T
        here = np.ones(len(row), dtype=bool) if view.mask is None else view.mask[row, column]
        counts[shown] |= here
        masked[shown] |= ~here
    return counts | ~masked


def scene_extent(views: Sequence[TrainingView], points: NDArray[np.float32]) -> float:
    """The length that learning rates and size limits are proportional to: the spread of the cameras.

    1.1 × the greatest distance of a camera from their mean (3DGS's "camera extent"). Where all centres
    coincide, it is the median distance of the ``points`` [N, 3] to them.
    """
    centres = np.stack([view.centre for view in views])
    centre = centres.mean(axis=0)
    extent = EXTENT_MARGIN * float(np.linalg.norm(centres - centre, axis=1).max())
    if extent > 1e-6 * max(1.0, float(np.abs(centre).max())):
        return extent
    return float(np.median(np.linalg.norm(points - centre, axis=1)))


def median_depth(views: Sequence[TrainingView], points: NDArray[np.float32]) -> float:
    """The median over the views of the median depth of those of ``points`` [N, 3] in front of the camera.

    Infinite where no view has a point in front of it.
    """
    medians = []
    for view in views:
        pose = view.camera_from_model
        depths = points @ pose.rotation[2].astype(np.float32) + np.float32(pose.translation[2])
        if (depths > 0).any():
            medians.append(float(np.median(depths[depths > 0])))
    return float(np.median(medians)) if medians else math.inf
