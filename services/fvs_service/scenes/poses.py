"""Poses as they are written on the wire, and the one place that turns them into transforms and back."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Discriminator, Field, Tag, field_validator

from fvs_engine.geometry import (
    RigidTransform,
    SimilarityTransform,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at, enu_from_geodetic
from fvs_service.errors import InvalidRequestError
from fvs_service.model import Model, Number
from fvs_service.scenes.model import (
    Alignment,
    AlignmentStatus,
    Altitude,
    AltitudeDatum,
    Latitude,
    Longitude,
    Origin,
    Quaternion,
    Vector,
)

_UNIT_TOLERANCE = 1e-3


class FramePose(Model):
    """A camera in the world (frame_from_camera of an OpenCV camera: x right, y down, z forward)."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"frame": "world", "position": [0.0, 0.0, -3.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
            ]
        }
    )

    frame: Literal["world", "model"] = "world"
    position: Vector
    orientation_wxyz: Quaternion

    @field_validator("orientation_wxyz")
    @classmethod
    def _unit(cls, value: Quaternion) -> Quaternion:
        length = math.hypot(*value)
        if abs(length - 1.0) > _UNIT_TOLERANCE:
            raise ValueError(f"a unit quaternion, w first; the length of this one is {length:.4g}")
        return value


class VehiclePose(Model):
    """A camera as a vehicle tells it: yaw clockwise from north, pitch up, roll with the right side down."""

    latitude_deg: Latitude
    longitude_deg: Longitude
    altitude_m: Altitude
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL
    yaw_deg: Annotated[Number, Field(ge=-360, le=360)]
    pitch_deg: Annotated[Number, Field(ge=-180, le=180)]
    roll_deg: Annotated[Number, Field(ge=-180, le=180)] = 0.0


def _kind_of_pose(value: Any) -> str:
    geodetic = isinstance(value, VehiclePose) or (isinstance(value, Mapping) and "latitude_deg" in value)
    return "vehicle" if geodetic else "frame"


Pose = Annotated[
    Annotated[FramePose, Tag("frame")] | Annotated[VehiclePose, Tag("vehicle")], Discriminator(_kind_of_pose)
]


class WorldFrame:
    """The world of one scene and where the model stands in it."""

    def __init__(self, origin: Origin | None, alignment: Alignment) -> None:
        self._origin = origin
        self._alignment = alignment
        self.world_from_model = SimilarityTransform(
            alignment.scale,
            matrix_from_quaternion(alignment.rotation_wxyz),
            np.array(alignment.translation),
        )
        self.model_from_world = self.world_from_model.inverse()

    @property
    def aligned(self) -> bool:
        """Whether the world is not just the model's frame: z is up, and its unit the metre."""
        return self._alignment.status is not AlignmentStatus.MODEL

    def world_from_camera(self, pose: FramePose | VehiclePose) -> RigidTransform:
        """The camera of ``pose`` in the world; raises ``InvalidRequestError`` if that is not known."""
        return self.world_from_cameras([pose])[0]

    def world_from_cameras(self, poses: Sequence[FramePose | VehiclePose]) -> tuple[RigidTransform, ...]:
        """The same of many poses, in their order, in much less time than one by one."""
        turns = [pose.orientation_wxyz for pose in poses if isinstance(pose, FramePose)]
        rotations = iter(matrix_from_quaternion(np.array(turns)) if turns else ())
        return tuple(
            self._of_vehicle(pose)
            if isinstance(pose, VehiclePose)
            else self._in_world(pose, RigidTransform(next(rotations), np.array(pose.position)))
            for pose in poses
        )

    def model_from_camera(self, world_from_camera: RigidTransform) -> RigidTransform:
        """A camera of the world in the model's frame."""
        return self.model_from_world.move_camera(world_from_camera)

    def _in_world(self, pose: FramePose, frame_from_camera: RigidTransform) -> RigidTransform:
        return (
            frame_from_camera
            if pose.frame == "world"
            else self.world_from_model.move_camera(frame_from_camera)
        )

    def _of_vehicle(self, pose: VehiclePose) -> RigidTransform:
        if self._origin is None or not self.aligned:
            raise InvalidRequestError(
                "The scene is not georeferenced, so it has no place for a latitude.",
                hint='Send images with GPS, or give poses as {"frame", "position", "orientation_wxyz"}.',
            )
        if pose.altitude_datum is not self._origin.altitude_datum:
            raise InvalidRequestError(
                f"Altitudes of the scene are above {self._origin.altitude_datum.value}, "
                f"not {pose.altitude_datum.value}.",
                hint="Convert the altitude.",
            )
        place = GeodeticPosition(pose.latitude_deg, pose.longitude_deg, pose.altitude_m)
        position = enu_from_geodetic(place, place_of(self._origin))
        return camera_at(position, pose.yaw_deg, pose.pitch_deg, pose.roll_deg)


def world_poses(world_from_cameras: Sequence[RigidTransform]) -> tuple[FramePose, ...]:
    """Cameras of the world, for the wire."""
    if not world_from_cameras:
        return ()
    turns = quaternion_from_matrix(np.stack([camera.rotation for camera in world_from_cameras]))
    return tuple(
        FramePose(
            frame="world",
            position=tuple(camera.translation.tolist()),
            orientation_wxyz=tuple(turn),
        )
        for camera, turn in zip(world_from_cameras, turns.tolist(), strict=True)
    )


def place_of(origin: Origin) -> GeodeticPosition:
    """The origin, as geometry has it."""
    return GeodeticPosition(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
