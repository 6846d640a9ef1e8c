"""The geometry of a scene for rankings: its registered cameras and the extent of its model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform, angle_between, level_axes
from fvs_engine.snapshot_cameras import model_from_cameras
from fvs_schema.snapshots import SnapshotCameras
from fvs_service.scenes.poses import WorldFrame

if TYPE_CHECKING:
    from scipy.spatial import KDTree

Array = NDArray[np.float64]

_SAME_POSITION = 0.05
"""Share of the median distance between neighbouring images within which two positions are the same."""
_SAME_DIRECTION_RAD = np.deg2rad(3.0)


@dataclass(frozen=True, eq=False)
class SceneGeometry:
    """The registered cameras and the extent of the model, in the world frame.

    ``cameras`` are world_from_camera; ``centre`` [3] is the middle of the model. The columns of ``level``
    [3, 3] are two horizontal directions and ``up``; ``lower`` and ``upper`` [3] are the corners of a box
    around the model's points in that basis.
    """

    cameras: tuple[RigidTransform, ...]
    centre: Array
    level: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, frame: WorldFrame, cameras: SnapshotCameras) -> "SceneGeometry":
        """The geometry of a snapshot in a world frame."""
        world_from_model = frame.world_from_model
        up = np.array([0.0, 0.0, 1.0]) if frame.aligned else np.array(cameras.up)
        level = level_axes(up)
        low, high = np.array(cameras.lower), np.array(cameras.upper)
        corners = np.array([[(low, high)[bit >> axis & 1][axis] for axis in range(3)] for bit in range(8)])
        box = world_from_model.apply(corners) @ level
        return cls(
            cameras=tuple(world_from_model.move_camera(camera) for camera in model_from_cameras(cameras)),
            centre=world_from_model.apply(cameras.centre),
            level=level,
            lower=box.min(axis=0),
            upper=box.max(axis=0),
        )

    @property
    def up(self) -> Array:
        """The upward direction [3]."""
        return np.asarray(self.level[:, 2])

    @cached_property
    def tree(self) -> "KDTree":
        """The camera centres as a k-d tree."""
        return _tree(self.cameras)

    @property
    def centres(self) -> Array:
        """The camera centres [N, 3]."""
        return np.asarray(self.tree.data)

    @cached_property
    def spacing(self) -> float:
        """The median distance from a camera to its nearest neighbour."""
        if len(self.cameras) < 2:
            return 0.0
        distances, _ = self.tree.query(self.centres, k=2)
        return float(np.median(distances[:, 1]))

    def visited(self, poses: Mapping[str, RigidTransform]) -> frozenset[str]:
        """The ids of ``poses`` (id → world_from_camera) at which an image was taken in the same direction."""
        return self._same_view(poses, self.cameras, self.tree)

    def same_view(
        self, poses: Mapping[str, RigidTransform], cameras: Sequence[RigidTransform]
    ) -> frozenset[str]:
        """The ids of ``poses`` that are where one of ``cameras`` (world_from_camera) is, and look there."""
        return self._same_view(poses, cameras, _tree(cameras)) if cameras else frozenset()

    def _same_view(
        self, poses: Mapping[str, RigidTransform], cameras: Sequence[RigidTransform], tree: "KDTree"
    ) -> frozenset[str]:
        if not poses:
            return frozenset()
        near = tree.query_ball_point(
            np.stack([pose.translation for pose in poses.values()]), _SAME_POSITION * self.spacing
        )
        return frozenset(
            name
            for (name, pose), indices in zip(poses.items(), near, strict=True)
            if any(
                angle_between(cameras[index].rotation, pose.rotation) <= _SAME_DIRECTION_RAD
                for index in indices
            )
        )


def _tree(cameras: Sequence[RigidTransform]) -> "KDTree":
    from scipy.spatial import KDTree  # slow to import

    return KDTree(np.stack([camera.translation for camera in cameras]))
