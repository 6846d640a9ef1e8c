"""The rotation between model and world from the attitudes that gimbals and compasses report.

Pitch and roll are measured against gravity, and are accurate to a degree everywhere; yaw is a compass
bearing, which iron nearby deflects by tens of degrees. So they are two kinds of evidence, and either may be
missing, from some cameras or from all.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry.geodetic import camera_at
from fvs_engine.geometry.transforms import RigidTransform

Array = NDArray[np.float64]

_MIN_CAMERAS = 2
_DOWN_SCATTER_DEG = 10.0
_HEADING_SCATTER_DEG = 15.0
"""Largest angle from the median report at which another one agrees with it; more than half must agree."""
_MIN_HORIZONTAL = 0.3
"""Minimum horizontal share of a viewing direction that has a heading."""


@dataclass(frozen=True)
class Attitude:
    """What is known of a camera's attitude: yaw clockwise from y (north), pitch up, roll right side down."""

    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None


def model_down(
    model_from_cameras: Sequence[RigidTransform], attitudes: Sequence[Attitude | None]
) -> Array | None:
    """The direction of gravity [3] in the model frame; None without enough reports that agree."""
    downs = [
        camera.rotation @ _level(attitude).T @ np.array([0.0, 0.0, -1.0])
        for camera, attitude in zip(model_from_cameras, attitudes, strict=True)
        if attitude is not None and attitude.pitch_deg is not None
    ]
    if len(downs) < _MIN_CAMERAS:
        return None
    directions = np.stack(downs)
    agreeing = _agreeing(np.arccos(np.clip(directions @ directions.T, -1.0, 1.0)), _DOWN_SCATTER_DEG)
    if agreeing is None:
        return None
    mean = directions[agreeing].mean(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


@dataclass(frozen=True, eq=False)
class Headings:
    """The headings of cameras in the model, and the yaws that they report.

    A camera with a pitch has a ``world_from_model`` [K, 3, 3] computed from its attitude, so that one that
    looks straight down has a heading too. The others have a viewing direction ``forward`` [L, 3] in the model
    frame and a ``yaw_rad`` [L].
    """

    world_from_model: Array
    forward: Array
    yaw_rad: Array

    @staticmethod
    def of(model_from_cameras: Sequence[RigidTransform], attitudes: Sequence[Attitude | None]) -> "Headings":
        """The headings of the cameras with a yaw."""
        whole, forward, yaws = [], [], []
        for camera, attitude in zip(model_from_cameras, attitudes, strict=True):
            if attitude is None or attitude.yaw_deg is None:
                continue
            if attitude.pitch_deg is not None:
                angles = (attitude.yaw_deg, attitude.pitch_deg, attitude.roll_deg or 0.0)
                whole.append(camera_at(np.zeros(3), *angles).rotation @ camera.rotation.T)
            else:
                forward.append(camera.rotation[:, 2])
                yaws.append(np.deg2rad(attitude.yaw_deg))
        return Headings(
            np.array(whole).reshape(-1, 3, 3), np.array(forward).reshape(-1, 3), np.array(yaws, np.float64)
        )

    def error_rad(self, world_from_model: Array) -> float | None:
        """The rotation about z (up) from the cameras' headings to their yaws; None as ``model_down``."""
        off = self.world_from_model @ world_from_model.T
        # The twist about z of a rotation (its swing does not affect a heading).
        twists = np.arctan2(off[:, 1, 0] - off[:, 0, 1], off[:, 0, 0] + off[:, 1, 1])
        looks = self.forward @ world_from_model.T
        level = np.hypot(looks[:, 0], looks[:, 1]) >= _MIN_HORIZONTAL
        turns = (np.arctan2(looks[:, 0], looks[:, 1]) - self.yaw_rad)[level]
        phases = np.exp(1j * np.concatenate([twists, turns]))
        if len(phases) < _MIN_CAMERAS:
            return None
        agreeing = _agreeing(np.abs(np.angle(phases[:, None] / phases[None])), _HEADING_SCATTER_DEG)
        return None if agreeing is None else float(np.angle(phases[agreeing].mean()))


def _level(attitude: Attitude) -> Array:
    """The rotation from a camera to a frame with z up; its heading has no meaning."""
    return camera_at(np.zeros(3), 0.0, attitude.pitch_deg or 0.0, attitude.roll_deg or 0.0).rotation


def _agreeing(angles_rad: Array, scatter_deg: float) -> NDArray[np.bool_] | None:
    """The reports that agree with the median one, by the angles [N, N] between them; None unless most do."""
    middle = int(np.argmin(np.median(angles_rad, axis=1)))
    near = angles_rad[middle] <= np.deg2rad(scatter_deg)
    return np.asarray(near) if near.sum() >= max(_MIN_CAMERAS, len(near) // 2 + 1) else None
