"""Pose priors: camera poses expected before structure from motion.

Sources are GPS and gimbals, a planner's targets, a dataset. They are noisy, and may be entirely wrong;
``verification`` compares them with a model.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from fvs_engine.geometry import RigidTransform, matrix_from_quaternion, quaternion_from_matrix
from fvs_engine.records import Record

Array = NDArray[np.float64]


class PosePrior(Record):
    """The expected pose of one image, in a frame (world) and unit that all priors of a scene share.

    ``position`` is the camera centre, ``position_sigma`` the standard deviation of each coordinate.
    ``orientation_wxyz`` is the rotation world_from_camera, None when only the position is known, and
    ``orientation_sigma_deg`` the standard deviation of its angle about each axis.
    """

    position: tuple[float, float, float]
    position_sigma: float = Field(default=0.0, ge=0)
    orientation_wxyz: tuple[float, float, float, float] | None = None
    orientation_sigma_deg: float = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _is_a_rotation(self) -> Self:
        if self.orientation_wxyz is not None and not any(self.orientation_wxyz):
            raise ValueError("orientation_wxyz must not be zero")
        return self

    @staticmethod
    def at(position: Array, sigma: float = 0.0) -> "PosePrior":
        """A prior of the position [3] alone."""
        x, y, z = position.tolist()
        return PosePrior(position=(x, y, z), position_sigma=sigma)

    @staticmethod
    def of_camera(
        world_from_camera: RigidTransform, position_sigma: float, orientation_sigma_deg: float
    ) -> "PosePrior":
        """A prior of the whole pose."""
        x, y, z = world_from_camera.translation.tolist()
        qw, qx, qy, qz = quaternion_from_matrix(world_from_camera.rotation).tolist()
        return PosePrior(
            position=(x, y, z),
            position_sigma=position_sigma,
            orientation_wxyz=(qw, qx, qy, qz),
            orientation_sigma_deg=orientation_sigma_deg,
        )

    @property
    def rotation(self) -> Array | None:
        """world_from_camera's rotation [3, 3]; None when it is not known."""
        return None if self.orientation_wxyz is None else matrix_from_quaternion(self.orientation_wxyz)

    @property
    def world_from_camera(self) -> RigidTransform | None:
        """The whole expected pose; None when only the position is known."""
        rotation = self.rotation
        return None if rotation is None else RigidTransform(rotation, np.array(self.position))


class PosePriors(Record):
    """The pose priors of images by name; images without one are left out."""

    by_name: dict[str, PosePrior] = Field(default={})

    def positions(self, names: list[str]) -> Array:
        """The positions [N, 3] of these images."""
        return np.array([self.by_name[name].position for name in names], dtype=np.float64).reshape(-1, 3)

    def position_sigmas(self, names: list[str]) -> Array:
        """The standard deviations [N] of these positions."""
        return np.array([self.by_name[name].position_sigma for name in names], dtype=np.float64)


@dataclass(frozen=True)
class ImageSet:
    """Images to reconstruct together: ``names``, posix paths in ``folder``, in capture order.

    ``priors`` are the pose priors of images; None: the positions in their metadata.
    """

    folder: Path
    names: Sequence[str]
    priors: PosePriors | None = None
