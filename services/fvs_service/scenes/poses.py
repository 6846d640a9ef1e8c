"""Poses on the wire, and their conversion to transforms and views and back: the only place for it."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import (
    PinholeCamera,
    RigidTransform,
    SimilarityTransform,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from fvs_engine.geometry.geodetic import (
    GeodeticPosition,
    attitude_of,
    camera_at,
    enu_from_geodetic,
    geodetic_coordinates,
    geodetic_from_enu,
)
from fvs_engine.views import PinholeView, View
from fvs_schema.forecasts import FramePosition
from fvs_schema.forecasts import GeodeticPosition as GeodeticPlace
from fvs_schema.mistakes import InvalidInput
from fvs_schema.poses import FramePose, PoseFrame, VehiclePose
from fvs_schema.quantities import MAX_COORDINATE_M
from fvs_schema.scenes import Alignment, AlignmentStatus, Origin
from fvs_service.errors import InvalidRequestError

Array = NDArray[np.float64]


class WorldFrame:
    """The world frame of one scene and its similarity to the model frame."""

    def __init__(self, origin: Origin | None, alignment: Alignment) -> None:
        self._origin = origin
        self.alignment = alignment
        self.world_from_model = SimilarityTransform(
            alignment.scale,
            matrix_from_quaternion(alignment.rotation_wxyz),
            np.array(alignment.translation),
        )
        self.model_from_world = self.world_from_model.inverse()

    @property
    def georeferenced(self) -> bool:
        """Whether positions of the world are positions on Earth."""
        return self._origin is not None and self.aligned

    @property
    def aligned(self) -> bool:
        """Whether the model is aligned: the world's z is up and its unit is the metre."""
        return self.alignment.status is not AlignmentStatus.MODEL

    def world_from_camera(self, pose: FramePose | VehiclePose) -> RigidTransform:
        """The transform of a pose; raises ``InvalidRequestError`` for a geodetic one without an origin."""
        return self.world_from_cameras([pose])[0]

    def world_from_cameras(self, poses: Sequence[FramePose | VehiclePose]) -> tuple[RigidTransform, ...]:
        """The transforms of many poses, in their order: much faster than one by one."""
        given = [pose for pose in poses if isinstance(pose, FramePose)]
        cameras = iter(_frame_from_cameras(given))
        return tuple(
            self._of_vehicle(pose) if isinstance(pose, VehiclePose) else self._in_world(pose, next(cameras))
            for pose in poses
        )

    def known_cameras(self, poses: Sequence[FramePose | VehiclePose]) -> tuple[RigidTransform, ...]:
        """The transforms of those poses that have a meaning in this frame."""
        known = [pose for pose in poses if self.georeferenced or not isinstance(pose, VehiclePose)]
        return self.world_from_cameras(known)

    def poses(
        self, world_from_cameras: Sequence[RigidTransform], frame: PoseFrame
    ) -> tuple[FramePose | VehiclePose, ...]:
        """The poses of cameras in ``frame``, in their order; raises as ``require_origin``."""
        match frame:
            case "world":
                return _frame_poses(world_from_cameras, frame)
            case "model":
                in_model = [self.model_from_world.move_camera(camera) for camera in world_from_cameras]
                return _frame_poses(in_model, frame)
            case "geodetic":
                origin = self.require_origin()
                return tuple(_vehicle_pose(camera, origin) for camera in world_from_cameras)

    def positions(self, places: Array, frame: PoseFrame) -> tuple[FramePosition | GeodeticPlace, ...]:
        """Places [N, 3] of the model frame as positions in ``frame``; raises as ``require_origin``."""
        if frame == "model":
            return tuple(FramePosition(frame=frame, position=place) for place in places.tolist())
        in_world = self.world_from_model.apply(places)
        if frame == "world":
            return tuple(FramePosition(frame=frame, position=place) for place in in_world.tolist())
        origin = self.require_origin()
        return tuple(
            GeodeticPlace(
                latitude_deg=latitude,
                longitude_deg=longitude,
                altitude_m=altitude,
                altitude_datum=origin.altitude_datum,
            )
            for latitude, longitude, altitude in geodetic_coordinates(
                in_world, geodetic_origin(origin)
            ).tolist()
        )

    def views(
        self, world_from_cameras: Mapping[str, RigidTransform], camera: PinholeCamera
    ) -> tuple[PinholeView, ...]:
        """Views in the model frame, by name, that all have one camera."""
        if not world_from_cameras:
            return ()
        poses = world_from_cameras.values()
        rotations = self.model_from_world.rotation @ np.stack([pose.rotation for pose in poses])
        centres = self.model_from_world.apply(np.stack([pose.translation for pose in poses]))
        inverse = rotations.transpose(0, 2, 1)
        translations = -(inverse @ centres[:, :, None])[:, :, 0]
        transforms = RigidTransform.many(inverse, translations)
        return tuple(
            View(name, camera, transform)
            for name, transform in zip(world_from_cameras, transforms, strict=True)
        )

    def _in_world(self, pose: FramePose, frame_from_camera: RigidTransform) -> RigidTransform:
        return (
            frame_from_camera
            if pose.frame == "world"
            else self.world_from_model.move_camera(frame_from_camera)
        )

    def _of_vehicle(self, pose: VehiclePose) -> RigidTransform:
        origin = self.require_origin()
        if pose.altitude_datum is not origin.altitude_datum:
            raise InvalidRequestError(
                f"Altitudes of the scene are above {origin.altitude_datum.in_words}, "
                f"not {pose.altitude_datum.in_words}.",
                hint="Convert the altitude.",
            )
        geodetic = GeodeticPosition(pose.latitude_deg, pose.longitude_deg, pose.altitude_m)
        position = enu_from_geodetic(geodetic, geodetic_origin(origin))
        return camera_at(position, pose.yaw_deg, pose.pitch_deg, pose.roll_deg)

    def require_origin(self) -> Origin:
        """The origin; raises ``InvalidRequestError`` when the scene is not georeferenced."""
        if self._origin is None or not self.aligned:
            raise InvalidRequestError(
                "The scene is not georeferenced, so geodetic poses and terrains have no meaning in it.",
                hint="Send images with GPS to a scene with an automatic or an enu world; or give poses as "
                '{"frame", "position", "orientation_wxyz"}, and no terrain.',
            )
        return self._origin


def require_on_earth(world_from_cameras: Mapping[str, RigidTransform]) -> None:
    """Check poses by id; raises ``InvalidRequestError`` for a pose beyond the ranges of requests.

    Poses in the model frame and those of generators can be that far away.
    """
    for name, camera in world_from_cameras.items():
        if np.abs(camera.translation).max() > MAX_COORDINATE_M:
            raise InvalidRequestError(
                f"The position of {name} has a coordinate beyond {MAX_COORDINATE_M:g}.",
                hint="Coordinates in the world frame are metres from its origin.",
            )


def _frame_from_cameras(poses: Sequence[FramePose]) -> tuple[RigidTransform, ...]:
    if not poses:
        return ()
    rotations = matrix_from_quaternion(np.array([pose.orientation_wxyz for pose in poses]))
    return RigidTransform.many(rotations, np.array([pose.position for pose in poses]))


def _frame_poses(
    frame_from_cameras: Sequence[RigidTransform], frame: Literal["world", "model"]
) -> tuple[FramePose, ...]:
    if not frame_from_cameras:
        return ()
    quaternions = quaternion_from_matrix(np.stack([camera.rotation for camera in frame_from_cameras]))
    return tuple(
        FramePose(
            frame=frame,
            position=tuple(camera.translation.tolist()),
            orientation_wxyz=tuple(quaternion),
        )
        for camera, quaternion in zip(frame_from_cameras, quaternions.tolist(), strict=True)
    )


def _vehicle_pose(world_from_camera: RigidTransform, origin: Origin) -> VehiclePose:
    position = geodetic_from_enu(world_from_camera.translation, geodetic_origin(origin))
    yaw_deg, pitch_deg, roll_deg = attitude_of(world_from_camera)
    try:
        return VehiclePose(
            latitude_deg=position.latitude_deg,
            longitude_deg=position.longitude_deg,
            altitude_m=position.altitude_m,
            altitude_datum=origin.altitude_datum,
            yaw_deg=yaw_deg,
            pitch_deg=pitch_deg,
            roll_deg=roll_deg,
        )
    except InvalidInput as error:
        raise InvalidRequestError(
            f"A candidate at an altitude of {position.altitude_m:g} m has no geodetic pose.",
            hint='Choose another generator, or "frame": "world".',
        ) from error


def geodetic_origin(origin: Origin) -> GeodeticPosition:
    """The origin as the engine's type."""
    return GeodeticPosition(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
