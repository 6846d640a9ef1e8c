"""Lens distortion on the normalised image plane (z = 1), forwards and backwards.

Two families cover COLMAP's common models. The *rational* one (Brown–Conrady over a denominator, OpenCV's)
has eight coefficients k1 k2 p1 p2 k3 k4 k5 k6; simpler models leave some at zero. The *fisheye* one
(Kannala–Brandt) has k1 … k4 on the angle to the axis.

Far enough off the axis a polynomial folds back, and would project points outside the view into the image.
Both families stop at that fold: points beyond it, or without a preimage, become NaN.
"""

from typing import Any, Protocol

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MAX_ITERATIONS = 50
_TOLERANCE = 1e-12


class Distortion(Protocol):
    """A map of the normalised image plane onto itself, points [..., 2] to points [..., 2]."""

    def distort(self, points: Array) -> Array:
        """The distorted points of an ideal image's points; NaN beyond the fold."""
        ...

    def undistort(self, points: Array) -> Array:
        """The ideal points whose distorted ones are ``points``; NaN where there is none."""
        ...


class RationalDistortion:
    """OpenCV's model: radial (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶), tangential p1, p2."""

    def __init__(
        self,
        k1: float = 0.0,
        k2: float = 0.0,
        p1: float = 0.0,
        p2: float = 0.0,
        k3: float = 0.0,
        k4: float = 0.0,
        k5: float = 0.0,
        k6: float = 0.0,
    ) -> None:
        self._numerator = np.array([1.0, k1, k2, k3])  # in powers of r²
        self._denominator = np.array([1.0, k4, k5, k6])
        self._p1, self._p2 = p1, p2
        self._fold_r2 = _first_fold(self._numerator, self._denominator)

    def distort(self, points: Array) -> Array:
        """See ``Distortion``."""
        image, _ = self._value_and_jacobian(points)
        beyond = (points**2).sum(-1) > self._fold_r2
        return np.where(beyond[..., None], np.nan, image)

    def undistort(self, points: Array) -> Array:
        """See ``Distortion``. Damped Newton steps that never leave the disc inside the fold."""
        ideal = self._inside(points.copy())
        for _ in range(_MAX_ITERATIONS):
            image, jacobian = self._value_and_jacobian(ideal)
            error = image - points
            if not (np.abs(error) > _TOLERANCE).any():
                break
            ideal = self._inside(ideal - _solve_2x2(jacobian, error))
        image, _ = self._value_and_jacobian(ideal)
        found = np.abs(image - points).max(-1) <= 1e-9 * (1.0 + np.abs(points).max(-1))
        return np.where(found[..., None], ideal, np.nan)

    def _inside(self, points: Array) -> Array:
        """Pull points back onto the disc where the model is one-to-one."""
        limit = 0.999999 * np.sqrt(self._fold_r2)
        radius = np.linalg.norm(points, axis=-1, keepdims=True)
        return np.asarray(points * np.minimum(1.0, limit / np.maximum(radius, 1e-300)))

    def _value_and_jacobian(self, points: Array) -> tuple[Array, Array]:
        u, v = points[..., 0], points[..., 1]
        r2 = u * u + v * v
        top = polynomial.polyval(r2, self._numerator)
        bottom = polynomial.polyval(r2, self._denominator)
        radial = top / bottom
        slope = (  # d radial / d r²
            polynomial.polyval(r2, polynomial.polyder(self._numerator))
            - radial * polynomial.polyval(r2, polynomial.polyder(self._denominator))
        ) / bottom
        p1, p2 = self._p1, self._p2
        image = np.stack(
            [
                u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u),
                v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v * v),
            ],
            axis=-1,
        )
        across = 2 * u * v * slope + 2 * p1 * u + 2 * p2 * v
        jacobian = np.stack(
            [
                np.stack([radial + 2 * u * u * slope + 2 * p1 * v + 6 * p2 * u, across], axis=-1),
                np.stack([across, radial + 2 * v * v * slope + 2 * p2 * u + 6 * p1 * v], axis=-1),
            ],
            axis=-2,
        )
        return image, jacobian


class FisheyeDistortion:
    """Kannala–Brandt: θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), θ the angle to the optical axis."""

    def __init__(self, k1: float = 0.0, k2: float = 0.0, k3: float = 0.0, k4: float = 0.0) -> None:
        self._factor = np.array([1.0, k1, k2, k3, k4])  # in powers of θ²
        self._fold = min(float(np.sqrt(_first_fold(self._factor, np.ones(1)))), np.pi / 2)

    def distort(self, points: Array) -> Array:
        """See ``Distortion``."""
        radius = np.linalg.norm(points, axis=-1)
        angle = np.arctan(radius)
        image_radius = angle * polynomial.polyval(angle**2, self._factor)
        ratio = np.where(angle > self._fold, np.nan, _ratio(image_radius, radius))
        return points * ratio[..., None]

    def undistort(self, points: Array) -> Array:
        """See ``Distortion``. The angle by Newton steps kept inside a shrinking bracket."""
        image_radius = np.linalg.norm(points, axis=-1)
        low, high = np.zeros_like(image_radius), np.full_like(image_radius, self._fold)
        angle = np.minimum(image_radius, 0.5 * self._fold)
        powers = np.arange(1, 2 * len(self._factor), 2)
        for _ in range(_MAX_ITERATIONS):
            error = angle * polynomial.polyval(angle**2, self._factor) - image_radius
            if not (np.abs(error) > _TOLERANCE).any():
                break
            low, high = np.where(error < 0, angle, low), np.where(error > 0, angle, high)
            slope = polynomial.polyval(angle**2, self._factor * powers)
            step = angle - error / np.where(slope == 0.0, np.inf, slope)
            angle = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        error = angle * polynomial.polyval(angle**2, self._factor) - image_radius
        found = (np.abs(error) <= 1e-9) & (angle < np.pi / 2)
        radius = np.tan(np.where(found, angle, 0.0))
        return points * np.where(found, _ratio(radius, image_radius), np.nan)[..., None]


def _ratio(top: Array, bottom: Array) -> Array:
    """``top / bottom``, 1 where both are zero (on the optical axis)."""
    return np.divide(top, bottom, out=np.ones_like(top), where=bottom > 0)


def _solve_2x2(matrix: Array, right: Array) -> Array:
    """Solve ``matrix`` [..., 2, 2] x = ``right`` [..., 2] by Cramer's rule; no step where it is singular."""
    (a, b), (c, d) = np.moveaxis(matrix, (-2, -1), (0, 1))
    x, y = np.moveaxis(right, -1, 0)
    determinant = a * d - b * c
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=determinant != 0)
    return np.stack([(d * x - b * y) * inverse, (a * y - c * x) * inverse], axis=-1)


def _first_fold(numerator: Array, denominator: Array) -> float:
    """The smallest s = r² > 0 at which r · N(s) / D(s) stops growing or has a pole; inf if nowhere."""
    # d/dr [r N(s)/D(s)] = [(N + 2 s N') D − 2 s N D'] / D²
    twice_s = np.array([0.0, 2.0])
    slope_of_top = polynomial.polyadd(numerator, polynomial.polymul(twice_s, polynomial.polyder(numerator)))
    drop = polynomial.polymul(twice_s, polynomial.polymul(numerator, polynomial.polyder(denominator)))
    growth = polynomial.polysub(polynomial.polymul(slope_of_top, denominator), drop)
    roots = np.concatenate([_roots(growth), _roots(denominator)])
    real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)].real
    return float(real.min()) if real.size else np.inf


def _roots(coefficients: NDArray[np.floating[Any]]) -> NDArray[np.complex128]:
    """Roots of a polynomial whose leading coefficients may be zero."""
    trimmed = np.trim_zeros(coefficients, "b")
    return np.asarray(polynomial.polyroots(trimmed), dtype=np.complex128)
