"""The position of a point in a model, from its marks in the images: robust, with its uncertainty."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.views import AnyView
from fvs_schema.control_points import PointStatus

Array = NDArray[np.float64]

_MIN_ANGLE_RAD = np.deg2rad(1.0)
"""Smallest angle between two rays that meet in a point whose depth can be relied on."""
_MAX_OFF_PX, _MAX_OFF_SHARE = 3.0, 0.003
"""Largest distance of a right mark from the projection, in px and in long sides of the image."""
_MOST_PAIRS = 500


@dataclass(frozen=True, eq=False)
class Sight:
    """A mark ``pixel`` [2] in an image of the model, in px of the camera of ``view``."""

    view: AnyView
    pixel: Array

    @property
    def limit_px(self) -> float:
        """The largest distance at which the mark still agrees with a projection."""
        return max(_MAX_OFF_PX, _MAX_OFF_SHARE * max(self.view.camera.width, self.view.camera.height))


@dataclass(frozen=True, eq=False)
class MeasuredPoint:
    """A ``position`` [3] in the model frame, and which ``sights`` agree on it, bool [N].

    ``sigma`` is the standard error of the position, in model units, when marks are 1 px off;
    ``reprojection_px`` the RMS distance of the agreeing marks from the projections.
    """

    position: Array
    agrees: NDArray[np.bool_]
    sigma: float
    reprojection_px: float


def measure(sights: Sequence[Sight]) -> MeasuredPoint | PointStatus:
    """The point that most of the ``sights`` agree on, or why there is none."""
    if len(sights) < 2:
        return PointStatus.SEEN_ONCE
    limits = np.array([sight.limit_px for sight in sights])
    meetings = _meetings(sights)
    if len(meetings) == 0:
        return PointStatus.NO_PARALLAX
    costs = [float(np.minimum(_off(sights, point) / limits, 1.0).sum()) for point in meetings]
    position = meetings[int(np.argmin(costs))]
    agrees = _off(sights, position) <= limits
    for _ in range(5):
        if agrees.sum() < 2 or 2 * agrees.sum() < len(sights):
            return PointStatus.MARKS_DISAGREE
        used = [sight for sight, fits in zip(sights, agrees, strict=True) if fits]
        position, covariance = _refine(used, position)
        now = _off(sights, position) <= limits
        if (now == agrees).all():
            break
        agrees = now
    off = _off(sights, position)[agrees]
    return MeasuredPoint(
        position, agrees, float(np.sqrt(np.trace(covariance))), float(np.sqrt(np.mean(off**2)))
    )


def _meetings(sights: Sequence[Sight]) -> Array:
    """Where pairs of rays are closest to each other [K, 3], for pairs with enough of an angle."""
    centres = np.stack([sight.view.centre for sight in sights])
    rays = np.stack(
        [
            sight.view.camera_from_model.rotation.T @ sight.view.camera.unproject(sight.pixel)
            for sight in sights
        ]
    )
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    pairs = np.array(list(itertools.combinations(range(len(sights)), 2)))
    if len(pairs) > _MOST_PAIRS:
        pairs = np.random.default_rng(0).choice(pairs, _MOST_PAIRS, replace=False)
    first, second = pairs.T
    cosines = (rays[first] * rays[second]).sum(axis=1)
    # A mark beyond the lens's fold has no ray: its comparison is false.
    pairs = pairs[np.abs(cosines) < np.cos(_MIN_ANGLE_RAD)]
    found = []
    for i, j in pairs:
        along = np.column_stack([rays[i], -rays[j]])
        depths = np.linalg.lstsq(along, centres[j] - centres[i], rcond=None)[0]
        if (depths > 0).all():
            found.append(0.5 * (centres[i] + depths[0] * rays[i] + centres[j] + depths[1] * rays[j]))
    return np.array(found).reshape(-1, 3)


def _off(sights: Sequence[Sight], position: Array) -> Array:
    """Distances [N] of the marks from the projections of ``position``, in px; inf where there is none."""
    misses = np.linalg.norm(_misses(sights, position), axis=1)
    return np.where(np.isfinite(misses), misses, np.inf)


def _misses(sights: Sequence[Sight], position: Array) -> Array:
    return np.stack(
        [
            sight.view.camera.project(sight.view.camera_from_model.apply(position)) - sight.pixel
            for sight in sights
        ]
    )


def _refine(sights: Sequence[Sight], position: Array) -> tuple[Array, Array]:
    """The position with the least squared reprojection errors, and its covariance for marks 1 px off."""
    from scipy.optimize import least_squares  # slow to import

    # Steps of the solver are relative to the coordinates: the point is its own origin, one distance the unit.
    reach = float(np.median([np.linalg.norm(sight.view.centre - position) for sight in sights]))

    def residuals(shift: Array) -> Array:
        return np.nan_to_num(_misses(sights, position + reach * shift), nan=1e6).ravel()

    fit = least_squares(residuals, np.zeros(3), x_scale=1e-3)
    covariance = reach**2 * np.linalg.pinv(fit.jac.T @ fit.jac)
    return position + reach * fit.x, covariance
