"""Cameras: OpenCV axes (x right, y down, z forward); the top left corner of the image is (0, 0) px.

The centre of the top left pixel is therefore at (0.5, 0.5), as in COLMAP and gsplat.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.distortion import Distortion, FisheyeDistortion, RationalDistortion
from fvs_engine.geometry.validation import points_array

Array = NDArray[np.float64]

MAX_SIDE_PX = 65_535
"""The longest side of a JPEG."""
_FOCAL_SHARES = (0.01, 100.0)
"""Focal lengths in long sides: fields of view from 179° to 0.6°, beyond those of any photograph."""
_MAX_PARAMETER = 1e3
"""Bound on distortion coefficients, and on principal points in long sides: a small crop may lie far away."""

CAMERA_MODELS: dict[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "SIMPLE_FISHEYE": ("f", "cx", "cy"),
    "FISHEYE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL_FISHEYE": ("f", "cx", "cy", "k1"),
    "RADIAL_FISHEYE": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
"""COLMAP's camera models that the engine reads → the names of their parameters, in COLMAP's order."""

_INTRINSICS = frozenset({"f", "fx", "fy", "cx", "cy"})


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without distortion: ``width`` × ``height`` px, focal lengths and principal point in px.

    Raises ``InvalidInputError`` when a number is not finite or out of the range that photographs have.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        _check_intrinsics((self.width, self.height), (self.fx, self.fy), (self.cx, self.cy))

    @property
    def matrix(self) -> Array:
        """K [3, 3]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> "PinholeCamera":
        """The same view on another pixel grid."""
        sx, sy = width / self.width, height / self.height
        return PinholeCamera(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)

    def project(self, points: ArrayLike) -> Array:
        """Pixels [..., 2] of ``points`` [..., 3] in camera coordinates; NaN where z ≤ 0."""
        return _to_pixels(self, _to_image_plane(points))

    def unproject(self, pixels: ArrayLike, depth: ArrayLike = 1.0) -> Array:
        """Points [..., 3] in camera coordinates with z = ``depth`` [...] behind ``pixels`` [..., 2]."""
        return _at_depth(_from_pixels(self, pixels), depth)


@dataclass(frozen=True)
class DistortedCamera:
    """A camera with one of COLMAP's models (``CAMERA_MODELS``); ``params`` in COLMAP's order.

    Raises ``InvalidInputError`` for a model that is not known, a wrong number of parameters, numbers that
    are not finite or out of the range that photographs have.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.model not in CAMERA_MODELS:
            raise InvalidInputError(
                f"Camera model {self.model!r} is not known.", hint=f"Use one of {', '.join(CAMERA_MODELS)}."
            )
        names = CAMERA_MODELS[self.model]
        params = tuple(float(p) for p in self.params)
        if len(params) != len(names):
            raise InvalidInputError(
                f"Camera model {self.model} has {len(names)} parameters, not {len(params)}.",
                hint=f"They are {', '.join(names)}.",
            )
        object.__setattr__(self, "params", params)
        size, focals = (self.width, self.height), (self.fx, self.fy)
        _check_intrinsics(size, focals, (self.cx, self.cy), tuple(self._coefficients.values()))

    @cached_property
    def named_params(self) -> dict[str, float]:
        """``params`` by their names in ``CAMERA_MODELS``."""
        return dict(zip(CAMERA_MODELS[self.model], self.params, strict=True))

    @property
    def fx(self) -> float:
        """Horizontal focal length in px."""
        return self.named_params["fx"] if "fx" in self.named_params else self.named_params["f"]

    @property
    def fy(self) -> float:
        """Vertical focal length in px."""
        return self.named_params["fy"] if "fy" in self.named_params else self.named_params["f"]

    @property
    def cx(self) -> float:
        """Principal point, px from the left edge."""
        return self.named_params["cx"]

    @property
    def cy(self) -> float:
        """Principal point, px from the top edge."""
        return self.named_params["cy"]

    @cached_property
    def distortion(self) -> Distortion:
        """The distortion on the normalised image plane."""
        if self.is_fisheye:
            return FisheyeDistortion(**self._coefficients)
        return RationalDistortion(**self._coefficients)

    @property
    def is_fisheye(self) -> bool:
        """Whether the model bends even without coefficients: image radii are proportional to angles."""
        return self.model.endswith("FISHEYE")

    @property
    def is_pinhole(self) -> bool:
        """Whether it has no distortion, by its coefficients."""
        return not self.is_fisheye and not any(self._coefficients.values())

    @property
    def _coefficients(self) -> dict[str, float]:
        return {name: value for name, value in self.named_params.items() if name not in _INTRINSICS}

    def resized(self, width: int, height: int) -> "DistortedCamera":
        """The same view on another pixel grid (a single focal length takes the mean of both scales)."""
        sx, sy = width / self.width, height / self.height
        scales = {"f": 0.5 * (sx + sy), "fx": sx, "fy": sy, "cx": sx, "cy": sy}
        params = tuple(value * scales.get(name, 1.0) for name, value in self.named_params.items())
        return DistortedCamera(self.model, width, height, params)

    def project(self, points: ArrayLike) -> Array:
        """Pixels [..., 2] of ``points`` [..., 3] in camera coordinates.

        NaN where z ≤ 0 and beyond the fold of the distortion (see ``distortion``).
        """
        return _to_pixels(self, self.distortion.distort(_to_image_plane(points)))

    def unproject(self, pixels: ArrayLike, depth: ArrayLike = 1.0) -> Array:
        """Points [..., 3] in camera coordinates with z = ``depth`` [...] behind ``pixels`` [..., 2].

        NaN where no ray with z > 0 reaches the pixel.
        """
        return _at_depth(self.distortion.undistort(_from_pixels(self, pixels)), depth)


Camera = PinholeCamera | DistortedCamera
"""Any camera. Structure from motion works with all of them; the rasterisers take ``PinholeCamera``."""


def _check_intrinsics(
    size: tuple[int, int],
    focals: tuple[float, float],
    principal_point: tuple[float, float],
    coefficients: tuple[float, ...] = (),
) -> None:
    width, height = size
    if width <= 0 or height <= 0:
        raise InvalidInputError(f"A camera's image must have pixels, not {width} × {height}.")
    long_side = max(size)
    if long_side > MAX_SIDE_PX:
        raise InvalidInputError(
            f"A camera's image is {width} × {height} px; a side has {MAX_SIDE_PX} px at most."
        )
    if not all(math.isfinite(value) for value in (*focals, *principal_point, *coefficients)):
        raise InvalidInputError("A camera's parameters must be finite.")
    shortest, longest = (share * long_side for share in _FOCAL_SHARES)
    for focal in focals:
        if focal <= 0:
            raise InvalidInputError(f"A camera's focal lengths must be positive, not {focal:g} px.")
        if not shortest <= focal <= longest:
            raise InvalidInputError(
                f"A camera's focal length is {focal:g} px at {width} × {height} px: a field of view of "
                f"{math.degrees(2.0 * math.atan2(0.5 * long_side, focal)):.3g}°.",
                hint="Focal lengths are in px of the image, not in mm.",
            )
    if max(map(abs, principal_point)) > _MAX_PARAMETER * long_side:
        raise InvalidInputError("A camera's principal point is too far from its image.")
    if any(abs(value) > _MAX_PARAMETER for value in coefficients):
        raise InvalidInputError(f"A camera's distortion coefficients are {_MAX_PARAMETER:g} at most.")


def _to_image_plane(points: ArrayLike) -> Array:
    """Points [..., 3] onto z = 1 as [..., 2], NaN where they are not in front of the camera."""
    xyz = points_array("points", points, 3)
    depth = np.where(xyz[..., 2:] > 0, xyz[..., 2:], np.nan)
    return np.asarray(xyz[..., :2] / depth)


def _to_pixels(camera: Camera, plane: Array) -> Array:
    return np.asarray(plane * np.array([camera.fx, camera.fy]) + np.array([camera.cx, camera.cy]))


def _from_pixels(camera: Camera, pixels: ArrayLike) -> Array:
    centred = points_array("pixels", pixels, 2) - np.array([camera.cx, camera.cy])
    return np.asarray(centred / np.array([camera.fx, camera.fy]))


def _at_depth(plane: Array, depth: ArrayLike) -> Array:
    z = np.broadcast_to(np.asarray(depth, dtype=np.float64), plane.shape[:-1])[..., None]
    return np.concatenate([plane * z, z], axis=-1)
