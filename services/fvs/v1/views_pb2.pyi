import datetime

from fvs.v1 import findings_pb2 as _findings_pb2
from fvs.v1 import poses_pb2 as _poses_pb2
from google.protobuf import empty_pb2 as _empty_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class VisitState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VISIT_STATE_UNSPECIFIED: _ClassVar[VisitState]
    VISIT_STATE_GOING_TO: _ClassVar[VisitState]
    VISIT_STATE_TAKEN: _ClassVar[VisitState]
    VISIT_STATE_FAILED: _ClassVar[VisitState]

class ViewImage(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VIEW_IMAGE_UNSPECIFIED: _ClassVar[ViewImage]
    VIEW_IMAGE_RENDER: _ClassVar[ViewImage]
    VIEW_IMAGE_SPECTRUM: _ClassVar[ViewImage]

class RenderFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    RENDER_FORMAT_UNSPECIFIED: _ClassVar[RenderFormat]
    RENDER_FORMAT_PNG: _ClassVar[RenderFormat]
    RENDER_FORMAT_JPEG: _ClassVar[RenderFormat]

class CandidateStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CANDIDATE_STATUS_UNSPECIFIED: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_RANKED: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_VISITED: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_OUT_OF_RANGE: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_OUT_OF_MODEL: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_LOW_COVERAGE: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_TAKEN: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_IN_MATTER: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_TOO_CLOSE: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_NO_FLY: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_UNREGISTRABLE: _ClassVar[CandidateStatus]
    CANDIDATE_STATUS_UNDER_GROUND: _ClassVar[CandidateStatus]

class GridLook(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    GRID_LOOK_UNSPECIFIED: _ClassVar[GridLook]
    GRID_LOOK_CENTRE: _ClassVar[GridLook]
    GRID_LOOK_DOWN: _ClassVar[GridLook]

class VolumeLook(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VOLUME_LOOK_UNSPECIFIED: _ClassVar[VolumeLook]
    VOLUME_LOOK_MIDDLE: _ClassVar[VolumeLook]
    VOLUME_LOOK_NEAREST: _ClassVar[VolumeLook]

class MissionFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MISSION_FORMAT_UNSPECIFIED: _ClassVar[MissionFormat]
    MISSION_FORMAT_QGC_PLAN: _ClassVar[MissionFormat]
    MISSION_FORMAT_QGC_WPL: _ClassVar[MissionFormat]
    MISSION_FORMAT_GEOJSON: _ClassVar[MissionFormat]
    MISSION_FORMAT_CSV: _ClassVar[MissionFormat]
    MISSION_FORMAT_DJI_KMZ: _ClassVar[MissionFormat]
    MISSION_FORMAT_MAVSDK: _ClassVar[MissionFormat]
    MISSION_FORMAT_ROS_POSEARRAY: _ClassVar[MissionFormat]
    MISSION_FORMAT_ROS_POSESTAMPED: _ClassVar[MissionFormat]
    MISSION_FORMAT_NERFSTUDIO: _ClassVar[MissionFormat]
    MISSION_FORMAT_LITCHI_CSV: _ClassVar[MissionFormat]
    MISSION_FORMAT_KML: _ClassVar[MissionFormat]
    MISSION_FORMAT_BRIEFING: _ClassVar[MissionFormat]

class Autopilot(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    AUTOPILOT_UNSPECIFIED: _ClassVar[Autopilot]
    AUTOPILOT_ARDUPILOT: _ClassVar[Autopilot]
    AUTOPILOT_PX4: _ClassVar[Autopilot]

class Drone(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DRONE_UNSPECIFIED: _ClassVar[Drone]
    DRONE_M30: _ClassVar[Drone]
    DRONE_M30T: _ClassVar[Drone]
    DRONE_M3E: _ClassVar[Drone]
    DRONE_M3T: _ClassVar[Drone]
    DRONE_M3M: _ClassVar[Drone]
    DRONE_M3D: _ClassVar[Drone]
    DRONE_M3TD: _ClassVar[Drone]
    DRONE_M4E: _ClassVar[Drone]
    DRONE_M4T: _ClassVar[Drone]
    DRONE_M4D: _ClassVar[Drone]
    DRONE_M4TD: _ClassVar[Drone]
    DRONE_M300_H20: _ClassVar[Drone]
    DRONE_M300_H20T: _ClassVar[Drone]
    DRONE_M300_H20N: _ClassVar[Drone]
    DRONE_M300_H30: _ClassVar[Drone]
    DRONE_M300_H30T: _ClassVar[Drone]
    DRONE_M350_H20: _ClassVar[Drone]
    DRONE_M350_H20T: _ClassVar[Drone]
    DRONE_M350_H20N: _ClassVar[Drone]
    DRONE_M350_H30: _ClassVar[Drone]
    DRONE_M350_H30T: _ClassVar[Drone]

class Finish(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FINISH_UNSPECIFIED: _ClassVar[Finish]
    FINISH_RETURN: _ClassVar[Finish]
    FINISH_HOLD: _ClassVar[Finish]
VISIT_STATE_UNSPECIFIED: VisitState
VISIT_STATE_GOING_TO: VisitState
VISIT_STATE_TAKEN: VisitState
VISIT_STATE_FAILED: VisitState
VIEW_IMAGE_UNSPECIFIED: ViewImage
VIEW_IMAGE_RENDER: ViewImage
VIEW_IMAGE_SPECTRUM: ViewImage
RENDER_FORMAT_UNSPECIFIED: RenderFormat
RENDER_FORMAT_PNG: RenderFormat
RENDER_FORMAT_JPEG: RenderFormat
CANDIDATE_STATUS_UNSPECIFIED: CandidateStatus
CANDIDATE_STATUS_RANKED: CandidateStatus
CANDIDATE_STATUS_VISITED: CandidateStatus
CANDIDATE_STATUS_OUT_OF_RANGE: CandidateStatus
CANDIDATE_STATUS_OUT_OF_MODEL: CandidateStatus
CANDIDATE_STATUS_LOW_COVERAGE: CandidateStatus
CANDIDATE_STATUS_TAKEN: CandidateStatus
CANDIDATE_STATUS_IN_MATTER: CandidateStatus
CANDIDATE_STATUS_TOO_CLOSE: CandidateStatus
CANDIDATE_STATUS_NO_FLY: CandidateStatus
CANDIDATE_STATUS_UNREGISTRABLE: CandidateStatus
CANDIDATE_STATUS_UNDER_GROUND: CandidateStatus
GRID_LOOK_UNSPECIFIED: GridLook
GRID_LOOK_CENTRE: GridLook
GRID_LOOK_DOWN: GridLook
VOLUME_LOOK_UNSPECIFIED: VolumeLook
VOLUME_LOOK_MIDDLE: VolumeLook
VOLUME_LOOK_NEAREST: VolumeLook
MISSION_FORMAT_UNSPECIFIED: MissionFormat
MISSION_FORMAT_QGC_PLAN: MissionFormat
MISSION_FORMAT_QGC_WPL: MissionFormat
MISSION_FORMAT_GEOJSON: MissionFormat
MISSION_FORMAT_CSV: MissionFormat
MISSION_FORMAT_DJI_KMZ: MissionFormat
MISSION_FORMAT_MAVSDK: MissionFormat
MISSION_FORMAT_ROS_POSEARRAY: MissionFormat
MISSION_FORMAT_ROS_POSESTAMPED: MissionFormat
MISSION_FORMAT_NERFSTUDIO: MissionFormat
MISSION_FORMAT_LITCHI_CSV: MissionFormat
MISSION_FORMAT_KML: MissionFormat
MISSION_FORMAT_BRIEFING: MissionFormat
AUTOPILOT_UNSPECIFIED: Autopilot
AUTOPILOT_ARDUPILOT: Autopilot
AUTOPILOT_PX4: Autopilot
DRONE_UNSPECIFIED: Drone
DRONE_M30: Drone
DRONE_M30T: Drone
DRONE_M3E: Drone
DRONE_M3T: Drone
DRONE_M3M: Drone
DRONE_M3D: Drone
DRONE_M3TD: Drone
DRONE_M4E: Drone
DRONE_M4T: Drone
DRONE_M4D: Drone
DRONE_M4TD: Drone
DRONE_M300_H20: Drone
DRONE_M300_H20T: Drone
DRONE_M300_H20N: Drone
DRONE_M300_H30: Drone
DRONE_M300_H30T: Drone
DRONE_M350_H20: Drone
DRONE_M350_H20T: Drone
DRONE_M350_H20N: Drone
DRONE_M350_H30: Drone
DRONE_M350_H30T: Drone
FINISH_UNSPECIFIED: Finish
FINISH_RETURN: Finish
FINISH_HOLD: Finish

class ReportVisitsRequest(_message.Message):
    __slots__ = ("scene_id", "report")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    REPORT_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    report: VisitReport
    def __init__(self, scene_id: _Optional[str] = ..., report: _Optional[_Union[VisitReport, _Mapping]] = ...) -> None: ...

class ListVisitsRequest(_message.Message):
    __slots__ = ("scene_id",)
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    def __init__(self, scene_id: _Optional[str] = ...) -> None: ...

class VisitReport(_message.Message):
    __slots__ = ("vehicle", "state", "views", "expires_in_s")
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    EXPIRES_IN_S_FIELD_NUMBER: _ClassVar[int]
    vehicle: str
    state: VisitState
    views: CandidateList
    expires_in_s: int
    def __init__(self, vehicle: _Optional[str] = ..., state: _Optional[_Union[VisitState, str]] = ..., views: _Optional[_Union[CandidateList, _Mapping]] = ..., expires_in_s: _Optional[int] = ...) -> None: ...

class Visit(_message.Message):
    __slots__ = ("vehicle", "candidate_id", "state", "pose", "reported_at", "expires_at")
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    CANDIDATE_ID_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    REPORTED_AT_FIELD_NUMBER: _ClassVar[int]
    EXPIRES_AT_FIELD_NUMBER: _ClassVar[int]
    vehicle: str
    candidate_id: str
    state: VisitState
    pose: _poses_pb2.Pose
    reported_at: _timestamp_pb2.Timestamp
    expires_at: _timestamp_pb2.Timestamp
    def __init__(self, vehicle: _Optional[str] = ..., candidate_id: _Optional[str] = ..., state: _Optional[_Union[VisitState, str]] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., reported_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., expires_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class VisitList(_message.Message):
    __slots__ = ("visits",)
    VISITS_FIELD_NUMBER: _ClassVar[int]
    visits: _containers.RepeatedCompositeFieldContainer[Visit]
    def __init__(self, visits: _Optional[_Iterable[_Union[Visit, _Mapping]]] = ...) -> None: ...

class PlanViewsRequest(_message.Message):
    __slots__ = ("scene_id", "plan", "idempotency_key")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    PLAN_FIELD_NUMBER: _ClassVar[int]
    IDEMPOTENCY_KEY_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    plan: PlanRequest
    idempotency_key: str
    def __init__(self, scene_id: _Optional[str] = ..., plan: _Optional[_Union[PlanRequest, _Mapping]] = ..., idempotency_key: _Optional[str] = ...) -> None: ...

class ForecastViewsRequest(_message.Message):
    __slots__ = ("scene_id", "forecast")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    FORECAST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    forecast: ForecastRequest
    def __init__(self, scene_id: _Optional[str] = ..., forecast: _Optional[_Union[ForecastRequest, _Mapping]] = ...) -> None: ...

class GetPlanRequest(_message.Message):
    __slots__ = ("plan_id",)
    PLAN_ID_FIELD_NUMBER: _ClassVar[int]
    plan_id: str
    def __init__(self, plan_id: _Optional[str] = ...) -> None: ...

class ListPlansRequest(_message.Message):
    __slots__ = ("scene_id", "after", "limit")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    after: str
    limit: int
    def __init__(self, scene_id: _Optional[str] = ..., after: _Optional[str] = ..., limit: _Optional[int] = ...) -> None: ...

class DeletePlanRequest(_message.Message):
    __slots__ = ("plan_id",)
    PLAN_ID_FIELD_NUMBER: _ClassVar[int]
    plan_id: str
    def __init__(self, plan_id: _Optional[str] = ...) -> None: ...

class GetRankingMissionRequest(_message.Message):
    __slots__ = ("ranking_id", "format", "first", "home_latitude_deg", "home_longitude_deg", "home_altitude_m", "altitude_datum", "geoid_height_m", "transit_height_m", "lowest_height_m", "highest_height_m", "geofence", "leave_out", "speed_m_s", "acceptance_radius_m", "hold_s", "gimbal_lowest_deg", "gimbal_highest_deg", "takeoff", "finish", "autopilot", "drone", "above_ground", "battery_s", "part", "battery_reserve", "home_above_takeoff_m")
    RANKING_ID_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    HOME_LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    HOME_LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    HOME_ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    GEOID_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    TRANSIT_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    LOWEST_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    GEOFENCE_FIELD_NUMBER: _ClassVar[int]
    LEAVE_OUT_FIELD_NUMBER: _ClassVar[int]
    SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    ACCEPTANCE_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    HOLD_S_FIELD_NUMBER: _ClassVar[int]
    GIMBAL_LOWEST_DEG_FIELD_NUMBER: _ClassVar[int]
    GIMBAL_HIGHEST_DEG_FIELD_NUMBER: _ClassVar[int]
    TAKEOFF_FIELD_NUMBER: _ClassVar[int]
    FINISH_FIELD_NUMBER: _ClassVar[int]
    AUTOPILOT_FIELD_NUMBER: _ClassVar[int]
    DRONE_FIELD_NUMBER: _ClassVar[int]
    ABOVE_GROUND_FIELD_NUMBER: _ClassVar[int]
    BATTERY_S_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    BATTERY_RESERVE_FIELD_NUMBER: _ClassVar[int]
    HOME_ABOVE_TAKEOFF_M_FIELD_NUMBER: _ClassVar[int]
    ranking_id: str
    format: MissionFormat
    first: int
    home_latitude_deg: float
    home_longitude_deg: float
    home_altitude_m: float
    altitude_datum: _poses_pb2.AltitudeDatum
    geoid_height_m: float
    transit_height_m: float
    lowest_height_m: float
    highest_height_m: float
    geofence: str
    leave_out: bool
    speed_m_s: float
    acceptance_radius_m: float
    hold_s: float
    gimbal_lowest_deg: float
    gimbal_highest_deg: float
    takeoff: bool
    finish: Finish
    autopilot: Autopilot
    drone: Drone
    above_ground: bool
    battery_s: float
    part: int
    battery_reserve: float
    home_above_takeoff_m: float
    def __init__(self, ranking_id: _Optional[str] = ..., format: _Optional[_Union[MissionFormat, str]] = ..., first: _Optional[int] = ..., home_latitude_deg: _Optional[float] = ..., home_longitude_deg: _Optional[float] = ..., home_altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ..., geoid_height_m: _Optional[float] = ..., transit_height_m: _Optional[float] = ..., lowest_height_m: _Optional[float] = ..., highest_height_m: _Optional[float] = ..., geofence: _Optional[str] = ..., leave_out: _Optional[bool] = ..., speed_m_s: _Optional[float] = ..., acceptance_radius_m: _Optional[float] = ..., hold_s: _Optional[float] = ..., gimbal_lowest_deg: _Optional[float] = ..., gimbal_highest_deg: _Optional[float] = ..., takeoff: _Optional[bool] = ..., finish: _Optional[_Union[Finish, str]] = ..., autopilot: _Optional[_Union[Autopilot, str]] = ..., drone: _Optional[_Union[Drone, str]] = ..., above_ground: _Optional[bool] = ..., battery_s: _Optional[float] = ..., part: _Optional[int] = ..., battery_reserve: _Optional[float] = ..., home_above_takeoff_m: _Optional[float] = ...) -> None: ...

class GetPlanMissionRequest(_message.Message):
    __slots__ = ("plan_id", "format", "first", "home_latitude_deg", "home_longitude_deg", "home_altitude_m", "altitude_datum", "geoid_height_m", "transit_height_m", "lowest_height_m", "highest_height_m", "geofence", "leave_out", "speed_m_s", "acceptance_radius_m", "hold_s", "gimbal_lowest_deg", "gimbal_highest_deg", "takeoff", "finish", "autopilot", "drone", "vehicle", "above_ground", "battery_s", "part", "battery_reserve", "home_above_takeoff_m")
    PLAN_ID_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    HOME_LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    HOME_LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    HOME_ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    GEOID_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    TRANSIT_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    LOWEST_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    GEOFENCE_FIELD_NUMBER: _ClassVar[int]
    LEAVE_OUT_FIELD_NUMBER: _ClassVar[int]
    SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    ACCEPTANCE_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    HOLD_S_FIELD_NUMBER: _ClassVar[int]
    GIMBAL_LOWEST_DEG_FIELD_NUMBER: _ClassVar[int]
    GIMBAL_HIGHEST_DEG_FIELD_NUMBER: _ClassVar[int]
    TAKEOFF_FIELD_NUMBER: _ClassVar[int]
    FINISH_FIELD_NUMBER: _ClassVar[int]
    AUTOPILOT_FIELD_NUMBER: _ClassVar[int]
    DRONE_FIELD_NUMBER: _ClassVar[int]
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    ABOVE_GROUND_FIELD_NUMBER: _ClassVar[int]
    BATTERY_S_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    BATTERY_RESERVE_FIELD_NUMBER: _ClassVar[int]
    HOME_ABOVE_TAKEOFF_M_FIELD_NUMBER: _ClassVar[int]
    plan_id: str
    format: MissionFormat
    first: int
    home_latitude_deg: float
    home_longitude_deg: float
    home_altitude_m: float
    altitude_datum: _poses_pb2.AltitudeDatum
    geoid_height_m: float
    transit_height_m: float
    lowest_height_m: float
    highest_height_m: float
    geofence: str
    leave_out: bool
    speed_m_s: float
    acceptance_radius_m: float
    hold_s: float
    gimbal_lowest_deg: float
    gimbal_highest_deg: float
    takeoff: bool
    finish: Finish
    autopilot: Autopilot
    drone: Drone
    vehicle: int
    above_ground: bool
    battery_s: float
    part: int
    battery_reserve: float
    home_above_takeoff_m: float
    def __init__(self, plan_id: _Optional[str] = ..., format: _Optional[_Union[MissionFormat, str]] = ..., first: _Optional[int] = ..., home_latitude_deg: _Optional[float] = ..., home_longitude_deg: _Optional[float] = ..., home_altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ..., geoid_height_m: _Optional[float] = ..., transit_height_m: _Optional[float] = ..., lowest_height_m: _Optional[float] = ..., highest_height_m: _Optional[float] = ..., geofence: _Optional[str] = ..., leave_out: _Optional[bool] = ..., speed_m_s: _Optional[float] = ..., acceptance_radius_m: _Optional[float] = ..., hold_s: _Optional[float] = ..., gimbal_lowest_deg: _Optional[float] = ..., gimbal_highest_deg: _Optional[float] = ..., takeoff: _Optional[bool] = ..., finish: _Optional[_Union[Finish, str]] = ..., autopilot: _Optional[_Union[Autopilot, str]] = ..., drone: _Optional[_Union[Drone, str]] = ..., vehicle: _Optional[int] = ..., above_ground: _Optional[bool] = ..., battery_s: _Optional[float] = ..., part: _Optional[int] = ..., battery_reserve: _Optional[float] = ..., home_above_takeoff_m: _Optional[float] = ...) -> None: ...

class CreateMissionRequest(_message.Message):
    __slots__ = ("scene_id", "mission", "format", "first", "home_latitude_deg", "home_longitude_deg", "home_altitude_m", "altitude_datum", "geoid_height_m", "transit_height_m", "lowest_height_m", "highest_height_m", "geofence", "leave_out", "speed_m_s", "acceptance_radius_m", "hold_s", "gimbal_lowest_deg", "gimbal_highest_deg", "takeoff", "finish", "autopilot", "drone", "above_ground", "battery_s", "part", "battery_reserve", "home_above_takeoff_m")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    MISSION_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    FIRST_FIELD_NUMBER: _ClassVar[int]
    HOME_LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    HOME_LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    HOME_ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    GEOID_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    TRANSIT_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    LOWEST_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    HIGHEST_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    GEOFENCE_FIELD_NUMBER: _ClassVar[int]
    LEAVE_OUT_FIELD_NUMBER: _ClassVar[int]
    SPEED_M_S_FIELD_NUMBER: _ClassVar[int]
    ACCEPTANCE_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    HOLD_S_FIELD_NUMBER: _ClassVar[int]
    GIMBAL_LOWEST_DEG_FIELD_NUMBER: _ClassVar[int]
    GIMBAL_HIGHEST_DEG_FIELD_NUMBER: _ClassVar[int]
    TAKEOFF_FIELD_NUMBER: _ClassVar[int]
    FINISH_FIELD_NUMBER: _ClassVar[int]
    AUTOPILOT_FIELD_NUMBER: _ClassVar[int]
    DRONE_FIELD_NUMBER: _ClassVar[int]
    ABOVE_GROUND_FIELD_NUMBER: _ClassVar[int]
    BATTERY_S_FIELD_NUMBER: _ClassVar[int]
    PART_FIELD_NUMBER: _ClassVar[int]
    BATTERY_RESERVE_FIELD_NUMBER: _ClassVar[int]
    HOME_ABOVE_TAKEOFF_M_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    mission: MissionRequest
    format: MissionFormat
    first: int
    home_latitude_deg: float
    home_longitude_deg: float
    home_altitude_m: float
    altitude_datum: _poses_pb2.AltitudeDatum
    geoid_height_m: float
    transit_height_m: float
    lowest_height_m: float
    highest_height_m: float
    geofence: str
    leave_out: bool
    speed_m_s: float
    acceptance_radius_m: float
    hold_s: float
    gimbal_lowest_deg: float
    gimbal_highest_deg: float
    takeoff: bool
    finish: Finish
    autopilot: Autopilot
    drone: Drone
    above_ground: bool
    battery_s: float
    part: int
    battery_reserve: float
    home_above_takeoff_m: float
    def __init__(self, scene_id: _Optional[str] = ..., mission: _Optional[_Union[MissionRequest, _Mapping]] = ..., format: _Optional[_Union[MissionFormat, str]] = ..., first: _Optional[int] = ..., home_latitude_deg: _Optional[float] = ..., home_longitude_deg: _Optional[float] = ..., home_altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ..., geoid_height_m: _Optional[float] = ..., transit_height_m: _Optional[float] = ..., lowest_height_m: _Optional[float] = ..., highest_height_m: _Optional[float] = ..., geofence: _Optional[str] = ..., leave_out: _Optional[bool] = ..., speed_m_s: _Optional[float] = ..., acceptance_radius_m: _Optional[float] = ..., hold_s: _Optional[float] = ..., gimbal_lowest_deg: _Optional[float] = ..., gimbal_highest_deg: _Optional[float] = ..., takeoff: _Optional[bool] = ..., finish: _Optional[_Union[Finish, str]] = ..., autopilot: _Optional[_Union[Autopilot, str]] = ..., drone: _Optional[_Union[Drone, str]] = ..., above_ground: _Optional[bool] = ..., battery_s: _Optional[float] = ..., part: _Optional[int] = ..., battery_reserve: _Optional[float] = ..., home_above_takeoff_m: _Optional[float] = ...) -> None: ...

class RankViewsRequest(_message.Message):
    __slots__ = ("scene_id", "ranking", "idempotency_key")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    RANKING_FIELD_NUMBER: _ClassVar[int]
    IDEMPOTENCY_KEY_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    ranking: RankingRequest
    idempotency_key: str
    def __init__(self, scene_id: _Optional[str] = ..., ranking: _Optional[_Union[RankingRequest, _Mapping]] = ..., idempotency_key: _Optional[str] = ...) -> None: ...

class StreamRankViewsRequest(_message.Message):
    __slots__ = ("scene_id", "ranking", "idempotency_key")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    RANKING_FIELD_NUMBER: _ClassVar[int]
    IDEMPOTENCY_KEY_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    ranking: RankingRequest
    idempotency_key: str
    def __init__(self, scene_id: _Optional[str] = ..., ranking: _Optional[_Union[RankingRequest, _Mapping]] = ..., idempotency_key: _Optional[str] = ...) -> None: ...

class GetRankingRequest(_message.Message):
    __slots__ = ("ranking_id",)
    RANKING_ID_FIELD_NUMBER: _ClassVar[int]
    ranking_id: str
    def __init__(self, ranking_id: _Optional[str] = ...) -> None: ...

class ListRankingsRequest(_message.Message):
    __slots__ = ("scene_id", "after", "limit")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    after: str
    limit: int
    def __init__(self, scene_id: _Optional[str] = ..., after: _Optional[str] = ..., limit: _Optional[int] = ...) -> None: ...

class DeleteRankingRequest(_message.Message):
    __slots__ = ("ranking_id",)
    RANKING_ID_FIELD_NUMBER: _ClassVar[int]
    ranking_id: str
    def __init__(self, ranking_id: _Optional[str] = ...) -> None: ...

class RenderCandidateRequest(_message.Message):
    __slots__ = ("ranking_id", "candidate_id", "image")
    RANKING_ID_FIELD_NUMBER: _ClassVar[int]
    CANDIDATE_ID_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    ranking_id: str
    candidate_id: str
    image: ViewImage
    def __init__(self, ranking_id: _Optional[str] = ..., candidate_id: _Optional[str] = ..., image: _Optional[_Union[ViewImage, str]] = ...) -> None: ...

class CandidateRender(_message.Message):
    __slots__ = ("png",)
    PNG_FIELD_NUMBER: _ClassVar[int]
    png: bytes
    def __init__(self, png: _Optional[bytes] = ...) -> None: ...

class RenderViewRequest(_message.Message):
    __slots__ = ("snapshot_id", "render")
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    RENDER_FIELD_NUMBER: _ClassVar[int]
    snapshot_id: str
    render: RenderRequest
    def __init__(self, snapshot_id: _Optional[str] = ..., render: _Optional[_Union[RenderRequest, _Mapping]] = ...) -> None: ...

class RenderRequest(_message.Message):
    __slots__ = ("pose", "image", "long_side_px", "format")
    POSE_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    LONG_SIDE_PX_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    pose: _poses_pb2.Pose
    image: ViewImage
    long_side_px: int
    format: RenderFormat
    def __init__(self, pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., image: _Optional[_Union[ViewImage, str]] = ..., long_side_px: _Optional[int] = ..., format: _Optional[_Union[RenderFormat, str]] = ...) -> None: ...

class ViewRender(_message.Message):
    __slots__ = ("content", "media_type")
    CONTENT_FIELD_NUMBER: _ClassVar[int]
    MEDIA_TYPE_FIELD_NUMBER: _ClassVar[int]
    content: bytes
    media_type: str
    def __init__(self, content: _Optional[bytes] = ..., media_type: _Optional[str] = ...) -> None: ...

class Candidate(_message.Message):
    __slots__ = ("id", "pose")
    ID_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    id: str
    pose: _poses_pb2.Pose
    def __init__(self, id: _Optional[str] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ...) -> None: ...

class CandidateList(_message.Message):
    __slots__ = ("items",)
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[Candidate]
    def __init__(self, items: _Optional[_Iterable[_Union[Candidate, _Mapping]]] = ...) -> None: ...

class Orbit(_message.Message):
    __slots__ = ("count", "radius_m", "height_m", "centre")
    COUNT_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    CENTRE_FIELD_NUMBER: _ClassVar[int]
    count: int
    radius_m: float
    height_m: float
    centre: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, count: _Optional[int] = ..., radius_m: _Optional[float] = ..., height_m: _Optional[float] = ..., centre: _Optional[_Iterable[float]] = ...) -> None: ...

class Grid(_message.Message):
    __slots__ = ("columns", "rows", "height_m", "look", "margin_m")
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    ROWS_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    LOOK_FIELD_NUMBER: _ClassVar[int]
    MARGIN_M_FIELD_NUMBER: _ClassVar[int]
    columns: int
    rows: int
    height_m: float
    look: GridLook
    margin_m: float
    def __init__(self, columns: _Optional[int] = ..., rows: _Optional[int] = ..., height_m: _Optional[float] = ..., look: _Optional[_Union[GridLook, str]] = ..., margin_m: _Optional[float] = ...) -> None: ...

class Dataset(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class AroundCurrent(_message.Message):
    __slots__ = ("count",)
    COUNT_FIELD_NUMBER: _ClassVar[int]
    count: int
    def __init__(self, count: _Optional[int] = ...) -> None: ...

class Corner(_message.Message):
    __slots__ = ("items",)
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, items: _Optional[_Iterable[float]] = ...) -> None: ...

class Box(_message.Message):
    __slots__ = ("up", "centre", "size", "along")
    UP_FIELD_NUMBER: _ClassVar[int]
    CENTRE_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    ALONG_FIELD_NUMBER: _ClassVar[int]
    up: _containers.RepeatedScalarFieldContainer[float]
    centre: _containers.RepeatedScalarFieldContainer[float]
    size: _containers.RepeatedScalarFieldContainer[float]
    along: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, up: _Optional[_Iterable[float]] = ..., centre: _Optional[_Iterable[float]] = ..., size: _Optional[_Iterable[float]] = ..., along: _Optional[_Iterable[float]] = ...) -> None: ...

class Cylinder(_message.Message):
    __slots__ = ("up", "base", "radius", "height")
    UP_FIELD_NUMBER: _ClassVar[int]
    BASE_FIELD_NUMBER: _ClassVar[int]
    RADIUS_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    up: _containers.RepeatedScalarFieldContainer[float]
    base: _containers.RepeatedScalarFieldContainer[float]
    radius: float
    height: float
    def __init__(self, up: _Optional[_Iterable[float]] = ..., base: _Optional[_Iterable[float]] = ..., radius: _Optional[float] = ..., height: _Optional[float] = ...) -> None: ...

class Prism(_message.Message):
    __slots__ = ("up", "corners", "lower", "upper")
    UP_FIELD_NUMBER: _ClassVar[int]
    CORNERS_FIELD_NUMBER: _ClassVar[int]
    LOWER_FIELD_NUMBER: _ClassVar[int]
    UPPER_FIELD_NUMBER: _ClassVar[int]
    up: _containers.RepeatedScalarFieldContainer[float]
    corners: _containers.RepeatedCompositeFieldContainer[Corner]
    lower: float
    upper: float
    def __init__(self, up: _Optional[_Iterable[float]] = ..., corners: _Optional[_Iterable[_Union[Corner, _Mapping]]] = ..., lower: _Optional[float] = ..., upper: _Optional[float] = ...) -> None: ...

class Shell(_message.Message):
    __slots__ = ("up", "centre", "inner", "outer", "above")
    UP_FIELD_NUMBER: _ClassVar[int]
    CENTRE_FIELD_NUMBER: _ClassVar[int]
    INNER_FIELD_NUMBER: _ClassVar[int]
    OUTER_FIELD_NUMBER: _ClassVar[int]
    ABOVE_FIELD_NUMBER: _ClassVar[int]
    up: _containers.RepeatedScalarFieldContainer[float]
    centre: _containers.RepeatedScalarFieldContainer[float]
    inner: float
    outer: float
    above: float
    def __init__(self, up: _Optional[_Iterable[float]] = ..., centre: _Optional[_Iterable[float]] = ..., inner: _Optional[float] = ..., outer: _Optional[float] = ..., above: _Optional[float] = ...) -> None: ...

class Corridor(_message.Message):
    __slots__ = ("up", "path", "radius")
    UP_FIELD_NUMBER: _ClassVar[int]
    PATH_FIELD_NUMBER: _ClassVar[int]
    RADIUS_FIELD_NUMBER: _ClassVar[int]
    up: _containers.RepeatedScalarFieldContainer[float]
    path: _containers.RepeatedCompositeFieldContainer[Corner]
    radius: float
    def __init__(self, up: _Optional[_Iterable[float]] = ..., path: _Optional[_Iterable[_Union[Corner, _Mapping]]] = ..., radius: _Optional[float] = ...) -> None: ...

class Volume(_message.Message):
    __slots__ = ("box", "cylinder", "prism", "shell", "corridor")
    BOX_FIELD_NUMBER: _ClassVar[int]
    CYLINDER_FIELD_NUMBER: _ClassVar[int]
    PRISM_FIELD_NUMBER: _ClassVar[int]
    SHELL_FIELD_NUMBER: _ClassVar[int]
    CORRIDOR_FIELD_NUMBER: _ClassVar[int]
    box: Box
    cylinder: Cylinder
    prism: Prism
    shell: Shell
    corridor: Corridor
    def __init__(self, box: _Optional[_Union[Box, _Mapping]] = ..., cylinder: _Optional[_Union[Cylinder, _Mapping]] = ..., prism: _Optional[_Union[Prism, _Mapping]] = ..., shell: _Optional[_Union[Shell, _Mapping]] = ..., corridor: _Optional[_Union[Corridor, _Mapping]] = ...) -> None: ...

class InVolume(_message.Message):
    __slots__ = ("volume", "count", "look", "aim", "level")
    VOLUME_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    LOOK_FIELD_NUMBER: _ClassVar[int]
    AIM_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    volume: Volume
    count: int
    look: VolumeLook
    aim: _containers.RepeatedScalarFieldContainer[float]
    level: bool
    def __init__(self, volume: _Optional[_Union[Volume, _Mapping]] = ..., count: _Optional[int] = ..., look: _Optional[_Union[VolumeLook, str]] = ..., aim: _Optional[_Iterable[float]] = ..., level: _Optional[bool] = ...) -> None: ...

class Generator(_message.Message):
    __slots__ = ("orbit", "grid", "dataset", "around_current", "in_volume")
    ORBIT_FIELD_NUMBER: _ClassVar[int]
    GRID_FIELD_NUMBER: _ClassVar[int]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    AROUND_CURRENT_FIELD_NUMBER: _ClassVar[int]
    IN_VOLUME_FIELD_NUMBER: _ClassVar[int]
    orbit: Orbit
    grid: Grid
    dataset: Dataset
    around_current: AroundCurrent
    in_volume: InVolume
    def __init__(self, orbit: _Optional[_Union[Orbit, _Mapping]] = ..., grid: _Optional[_Union[Grid, _Mapping]] = ..., dataset: _Optional[_Union[Dataset, _Mapping]] = ..., around_current: _Optional[_Union[AroundCurrent, _Mapping]] = ..., in_volume: _Optional[_Union[InVolume, _Mapping]] = ...) -> None: ...

class RankingRequest(_message.Message):
    __slots__ = ("candidates", "generator", "current_pose", "radius_m", "frame", "top_k", "method", "snapshot_id", "budget", "seed", "for_vehicle", "safety_m", "no_fly", "rank_all", "terrain")
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    GENERATOR_FIELD_NUMBER: _ClassVar[int]
    CURRENT_POSE_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    TOP_K_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    BUDGET_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    FOR_VEHICLE_FIELD_NUMBER: _ClassVar[int]
    SAFETY_M_FIELD_NUMBER: _ClassVar[int]
    NO_FLY_FIELD_NUMBER: _ClassVar[int]
    RANK_ALL_FIELD_NUMBER: _ClassVar[int]
    TERRAIN_FIELD_NUMBER: _ClassVar[int]
    candidates: CandidateList
    generator: Generator
    current_pose: _poses_pb2.Pose
    radius_m: float
    frame: _poses_pb2.PoseFrame
    top_k: int
    method: str
    snapshot_id: str
    budget: int
    seed: int
    for_vehicle: str
    safety_m: float
    no_fly: _containers.RepeatedCompositeFieldContainer[Volume]
    rank_all: bool
    terrain: AnyTerrain
    def __init__(self, candidates: _Optional[_Union[CandidateList, _Mapping]] = ..., generator: _Optional[_Union[Generator, _Mapping]] = ..., current_pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., radius_m: _Optional[float] = ..., frame: _Optional[_Union[_poses_pb2.PoseFrame, str]] = ..., top_k: _Optional[int] = ..., method: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., budget: _Optional[int] = ..., seed: _Optional[int] = ..., for_vehicle: _Optional[str] = ..., safety_m: _Optional[float] = ..., no_fly: _Optional[_Iterable[_Union[Volume, _Mapping]]] = ..., rank_all: _Optional[bool] = ..., terrain: _Optional[_Union[AnyTerrain, _Mapping]] = ...) -> None: ...

class ScoredCandidate(_message.Message):
    __slots__ = ("id", "score", "status", "coverage", "distance_m", "pose", "estimated")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    COVERAGE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    ESTIMATED_FIELD_NUMBER: _ClassVar[int]
    id: str
    score: float
    status: CandidateStatus
    coverage: float
    distance_m: float
    pose: _poses_pb2.Pose
    estimated: bool
    def __init__(self, id: _Optional[str] = ..., score: _Optional[float] = ..., status: _Optional[_Union[CandidateStatus, str]] = ..., coverage: _Optional[float] = ..., distance_m: _Optional[float] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., estimated: _Optional[bool] = ...) -> None: ...

class RankedCandidate(_message.Message):
    __slots__ = ("id", "rank", "score", "status", "coverage", "distance_m", "pose", "estimated", "chance")
    ID_FIELD_NUMBER: _ClassVar[int]
    RANK_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    COVERAGE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    ESTIMATED_FIELD_NUMBER: _ClassVar[int]
    CHANCE_FIELD_NUMBER: _ClassVar[int]
    id: str
    rank: int
    score: float
    status: CandidateStatus
    coverage: float
    distance_m: float
    pose: _poses_pb2.Pose
    estimated: bool
    chance: float
    def __init__(self, id: _Optional[str] = ..., rank: _Optional[int] = ..., score: _Optional[float] = ..., status: _Optional[_Union[CandidateStatus, str]] = ..., coverage: _Optional[float] = ..., distance_m: _Optional[float] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., estimated: _Optional[bool] = ..., chance: _Optional[float] = ...) -> None: ...

class Ranking(_message.Message):
    __slots__ = ("id", "scene_id", "snapshot_id", "request", "alignment", "origin", "iterations", "gaussians", "fallback", "candidates", "total", "seconds", "waited_s", "warnings", "created_at")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    ITERATIONS_FIELD_NUMBER: _ClassVar[int]
    GAUSSIANS_FIELD_NUMBER: _ClassVar[int]
    FALLBACK_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    TOTAL_FIELD_NUMBER: _ClassVar[int]
    SECONDS_FIELD_NUMBER: _ClassVar[int]
    WAITED_S_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    id: str
    scene_id: str
    snapshot_id: str
    request: RankingRequest
    alignment: _poses_pb2.Alignment
    origin: _poses_pb2.Origin
    iterations: int
    gaussians: int
    fallback: str
    candidates: _containers.RepeatedCompositeFieldContainer[RankedCandidate]
    total: int
    seconds: float
    waited_s: float
    warnings: _containers.RepeatedCompositeFieldContainer[_findings_pb2.Notice]
    created_at: _timestamp_pb2.Timestamp
    def __init__(self, id: _Optional[str] = ..., scene_id: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., request: _Optional[_Union[RankingRequest, _Mapping]] = ..., alignment: _Optional[_Union[_poses_pb2.Alignment, _Mapping]] = ..., origin: _Optional[_Union[_poses_pb2.Origin, _Mapping]] = ..., iterations: _Optional[int] = ..., gaussians: _Optional[int] = ..., fallback: _Optional[str] = ..., candidates: _Optional[_Iterable[_Union[RankedCandidate, _Mapping]]] = ..., total: _Optional[int] = ..., seconds: _Optional[float] = ..., waited_s: _Optional[float] = ..., warnings: _Optional[_Iterable[_Union[_findings_pb2.Notice, _Mapping]]] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class RankingSummary(_message.Message):
    __slots__ = ("id", "scene_id", "snapshot_id", "method", "generator", "total", "best", "created_at")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    METHOD_FIELD_NUMBER: _ClassVar[int]
    GENERATOR_FIELD_NUMBER: _ClassVar[int]
    TOTAL_FIELD_NUMBER: _ClassVar[int]
    BEST_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    id: str
    scene_id: str
    snapshot_id: str
    method: str
    generator: str
    total: int
    best: str
    created_at: _timestamp_pb2.Timestamp
    def __init__(self, id: _Optional[str] = ..., scene_id: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., method: _Optional[str] = ..., generator: _Optional[str] = ..., total: _Optional[int] = ..., best: _Optional[str] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class RankingList(_message.Message):
    __slots__ = ("items", "next")
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[RankingSummary]
    next: str
    def __init__(self, items: _Optional[_Iterable[_Union[RankingSummary, _Mapping]]] = ..., next: _Optional[str] = ...) -> None: ...

class RankingPart(_message.Message):
    __slots__ = ("candidates", "ranking")
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    RANKING_FIELD_NUMBER: _ClassVar[int]
    candidates: _containers.RepeatedCompositeFieldContainer[ScoredCandidate]
    ranking: Ranking
    def __init__(self, candidates: _Optional[_Iterable[_Union[ScoredCandidate, _Mapping]]] = ..., ranking: _Optional[_Union[Ranking, _Mapping]] = ...) -> None: ...

class PoseList(_message.Message):
    __slots__ = ("items",)
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[_poses_pb2.Pose]
    def __init__(self, items: _Optional[_Iterable[_Union[_poses_pb2.Pose, _Mapping]]] = ...) -> None: ...

class PlanRequest(_message.Message):
    __slots__ = ("candidates", "generator", "targets", "views", "distance_m", "home", "vehicles", "frame", "snapshot_id", "safety_m", "no_fly", "for_vehicle", "terrain")
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    GENERATOR_FIELD_NUMBER: _ClassVar[int]
    TARGETS_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    HOME_FIELD_NUMBER: _ClassVar[int]
    VEHICLES_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    SAFETY_M_FIELD_NUMBER: _ClassVar[int]
    NO_FLY_FIELD_NUMBER: _ClassVar[int]
    FOR_VEHICLE_FIELD_NUMBER: _ClassVar[int]
    TERRAIN_FIELD_NUMBER: _ClassVar[int]
    candidates: CandidateList
    generator: Generator
    targets: CandidateList
    views: int
    distance_m: float
    home: bool
    vehicles: PoseList
    frame: _poses_pb2.PoseFrame
    snapshot_id: str
    safety_m: float
    no_fly: _containers.RepeatedCompositeFieldContainer[Volume]
    for_vehicle: str
    terrain: AnyTerrain
    def __init__(self, candidates: _Optional[_Union[CandidateList, _Mapping]] = ..., generator: _Optional[_Union[Generator, _Mapping]] = ..., targets: _Optional[_Union[CandidateList, _Mapping]] = ..., views: _Optional[int] = ..., distance_m: _Optional[float] = ..., home: _Optional[bool] = ..., vehicles: _Optional[_Union[PoseList, _Mapping]] = ..., frame: _Optional[_Union[_poses_pb2.PoseFrame, str]] = ..., snapshot_id: _Optional[str] = ..., safety_m: _Optional[float] = ..., no_fly: _Optional[_Iterable[_Union[Volume, _Mapping]]] = ..., for_vehicle: _Optional[str] = ..., terrain: _Optional[_Union[AnyTerrain, _Mapping]] = ...) -> None: ...

class Expectation(_message.Message):
    __slots__ = ("variance", "psnr_db", "low_db", "high_db")
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    PSNR_DB_FIELD_NUMBER: _ClassVar[int]
    LOW_DB_FIELD_NUMBER: _ClassVar[int]
    HIGH_DB_FIELD_NUMBER: _ClassVar[int]
    variance: float
    psnr_db: float
    low_db: float
    high_db: float
    def __init__(self, variance: _Optional[float] = ..., psnr_db: _Optional[float] = ..., low_db: _Optional[float] = ..., high_db: _Optional[float] = ...) -> None: ...

class Stop(_message.Message):
    __slots__ = ("id", "pose", "distance_m", "travel_m", "after", "via")
    ID_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    TRAVEL_M_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    VIA_FIELD_NUMBER: _ClassVar[int]
    id: str
    pose: _poses_pb2.Pose
    distance_m: float
    travel_m: float
    after: Expectation
    via: _containers.RepeatedCompositeFieldContainer[_poses_pb2.Pose]
    def __init__(self, id: _Optional[str] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., distance_m: _Optional[float] = ..., travel_m: _Optional[float] = ..., after: _Optional[_Union[Expectation, _Mapping]] = ..., via: _Optional[_Iterable[_Union[_poses_pb2.Pose, _Mapping]]] = ...) -> None: ...

class Tour(_message.Message):
    __slots__ = ("vehicle", "stops", "length_m", "via_home")
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    STOPS_FIELD_NUMBER: _ClassVar[int]
    LENGTH_M_FIELD_NUMBER: _ClassVar[int]
    VIA_HOME_FIELD_NUMBER: _ClassVar[int]
    vehicle: int
    stops: _containers.RepeatedCompositeFieldContainer[Stop]
    length_m: float
    via_home: _containers.RepeatedCompositeFieldContainer[_poses_pb2.Pose]
    def __init__(self, vehicle: _Optional[int] = ..., stops: _Optional[_Iterable[_Union[Stop, _Mapping]]] = ..., length_m: _Optional[float] = ..., via_home: _Optional[_Iterable[_Union[_poses_pb2.Pose, _Mapping]]] = ...) -> None: ...

class CandidateTerms(_message.Message):
    __slots__ = ("id", "planned", "gain", "gain_in_plan", "variance", "distance_m", "chance", "helps", "coverage", "median_frequency")
    ID_FIELD_NUMBER: _ClassVar[int]
    PLANNED_FIELD_NUMBER: _ClassVar[int]
    GAIN_FIELD_NUMBER: _ClassVar[int]
    GAIN_IN_PLAN_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    CHANCE_FIELD_NUMBER: _ClassVar[int]
    HELPS_FIELD_NUMBER: _ClassVar[int]
    COVERAGE_FIELD_NUMBER: _ClassVar[int]
    MEDIAN_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    id: str
    planned: bool
    gain: float
    gain_in_plan: float
    variance: float
    distance_m: float
    chance: float
    helps: _containers.RepeatedScalarFieldContainer[str]
    coverage: float
    median_frequency: float
    def __init__(self, id: _Optional[str] = ..., planned: _Optional[bool] = ..., gain: _Optional[float] = ..., gain_in_plan: _Optional[float] = ..., variance: _Optional[float] = ..., distance_m: _Optional[float] = ..., chance: _Optional[float] = ..., helps: _Optional[_Iterable[str]] = ..., coverage: _Optional[float] = ..., median_frequency: _Optional[float] = ...) -> None: ...

class Plan(_message.Message):
    __slots__ = ("id", "scene_id", "snapshot_id", "request", "summary", "now", "end", "tours", "candidates", "photographed", "alignment", "origin", "warnings", "created_at")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    NOW_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    TOURS_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    PHOTOGRAPHED_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    id: str
    scene_id: str
    snapshot_id: str
    request: PlanRequest
    summary: str
    now: Expectation
    end: Expectation
    tours: _containers.RepeatedCompositeFieldContainer[Tour]
    candidates: _containers.RepeatedCompositeFieldContainer[CandidateTerms]
    photographed: _containers.RepeatedScalarFieldContainer[str]
    alignment: _poses_pb2.Alignment
    origin: _poses_pb2.Origin
    warnings: _containers.RepeatedCompositeFieldContainer[_findings_pb2.Notice]
    created_at: _timestamp_pb2.Timestamp
    def __init__(self, id: _Optional[str] = ..., scene_id: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., request: _Optional[_Union[PlanRequest, _Mapping]] = ..., summary: _Optional[str] = ..., now: _Optional[_Union[Expectation, _Mapping]] = ..., end: _Optional[_Union[Expectation, _Mapping]] = ..., tours: _Optional[_Iterable[_Union[Tour, _Mapping]]] = ..., candidates: _Optional[_Iterable[_Union[CandidateTerms, _Mapping]]] = ..., photographed: _Optional[_Iterable[str]] = ..., alignment: _Optional[_Union[_poses_pb2.Alignment, _Mapping]] = ..., origin: _Optional[_Union[_poses_pb2.Origin, _Mapping]] = ..., warnings: _Optional[_Iterable[_Union[_findings_pb2.Notice, _Mapping]]] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class Surface(_message.Message):
    __slots__ = ("count",)
    COUNT_FIELD_NUMBER: _ClassVar[int]
    count: int
    def __init__(self, count: _Optional[int] = ...) -> None: ...

class ForecastRequest(_message.Message):
    __slots__ = ("candidates", "generator", "surface", "after", "frame", "snapshot_id")
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    GENERATOR_FIELD_NUMBER: _ClassVar[int]
    SURFACE_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    candidates: CandidateList
    generator: Generator
    surface: Surface
    after: _containers.RepeatedCompositeFieldContainer[Candidate]
    frame: _poses_pb2.PoseFrame
    snapshot_id: str
    def __init__(self, candidates: _Optional[_Union[CandidateList, _Mapping]] = ..., generator: _Optional[_Union[Generator, _Mapping]] = ..., surface: _Optional[_Union[Surface, _Mapping]] = ..., after: _Optional[_Iterable[_Union[Candidate, _Mapping]]] = ..., frame: _Optional[_Union[_poses_pb2.PoseFrame, str]] = ..., snapshot_id: _Optional[str] = ...) -> None: ...

class FramePosition(_message.Message):
    __slots__ = ("frame", "position")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    frame: _poses_pb2.PoseFrame
    position: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, frame: _Optional[_Union[_poses_pb2.PoseFrame, str]] = ..., position: _Optional[_Iterable[float]] = ...) -> None: ...

class GeodeticPosition(_message.Message):
    __slots__ = ("latitude_deg", "longitude_deg", "altitude_m", "altitude_datum")
    LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: _poses_pb2.AltitudeDatum
    def __init__(self, latitude_deg: _Optional[float] = ..., longitude_deg: _Optional[float] = ..., altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ...) -> None: ...

class Position(_message.Message):
    __slots__ = ("frame", "geodetic")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    GEODETIC_FIELD_NUMBER: _ClassVar[int]
    frame: FramePosition
    geodetic: GeodeticPosition
    def __init__(self, frame: _Optional[_Union[FramePosition, _Mapping]] = ..., geodetic: _Optional[_Union[GeodeticPosition, _Mapping]] = ...) -> None: ...

class ForecastSample(_message.Message):
    __slots__ = ("id", "pose", "position", "variance", "psnr_db", "low_db", "high_db")
    ID_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    VARIANCE_FIELD_NUMBER: _ClassVar[int]
    PSNR_DB_FIELD_NUMBER: _ClassVar[int]
    LOW_DB_FIELD_NUMBER: _ClassVar[int]
    HIGH_DB_FIELD_NUMBER: _ClassVar[int]
    id: str
    pose: _poses_pb2.Pose
    position: Position
    variance: float
    psnr_db: float
    low_db: float
    high_db: float
    def __init__(self, id: _Optional[str] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., position: _Optional[_Union[Position, _Mapping]] = ..., variance: _Optional[float] = ..., psnr_db: _Optional[float] = ..., low_db: _Optional[float] = ..., high_db: _Optional[float] = ...) -> None: ...

class Forecast(_message.Message):
    __slots__ = ("scene_id", "snapshot_id", "calibrated", "samples", "alignment", "origin")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    CALIBRATED_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    ALIGNMENT_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    snapshot_id: str
    calibrated: bool
    samples: _containers.RepeatedCompositeFieldContainer[ForecastSample]
    alignment: _poses_pb2.Alignment
    origin: _poses_pb2.Origin
    def __init__(self, scene_id: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., calibrated: _Optional[bool] = ..., samples: _Optional[_Iterable[_Union[ForecastSample, _Mapping]]] = ..., alignment: _Optional[_Union[_poses_pb2.Alignment, _Mapping]] = ..., origin: _Optional[_Union[_poses_pb2.Origin, _Mapping]] = ...) -> None: ...

class PlanSummary(_message.Message):
    __slots__ = ("id", "scene_id", "snapshot_id", "summary", "created_at")
    ID_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    SUMMARY_FIELD_NUMBER: _ClassVar[int]
    CREATED_AT_FIELD_NUMBER: _ClassVar[int]
    id: str
    scene_id: str
    snapshot_id: str
    summary: str
    created_at: _timestamp_pb2.Timestamp
    def __init__(self, id: _Optional[str] = ..., scene_id: _Optional[str] = ..., snapshot_id: _Optional[str] = ..., summary: _Optional[str] = ..., created_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class PlanList(_message.Message):
    __slots__ = ("items", "next")
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[PlanSummary]
    next: str
    def __init__(self, items: _Optional[_Iterable[_Union[PlanSummary, _Mapping]]] = ..., next: _Optional[str] = ...) -> None: ...

class MissionView(_message.Message):
    __slots__ = ("id", "pose", "via")
    ID_FIELD_NUMBER: _ClassVar[int]
    POSE_FIELD_NUMBER: _ClassVar[int]
    VIA_FIELD_NUMBER: _ClassVar[int]
    id: str
    pose: _poses_pb2.Pose
    via: _containers.RepeatedCompositeFieldContainer[_poses_pb2.Pose]
    def __init__(self, id: _Optional[str] = ..., pose: _Optional[_Union[_poses_pb2.Pose, _Mapping]] = ..., via: _Optional[_Iterable[_Union[_poses_pb2.Pose, _Mapping]]] = ...) -> None: ...

class MissionRequest(_message.Message):
    __slots__ = ("views", "via_home", "snapshot_id", "terrain", "images", "all_images")
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    VIA_HOME_FIELD_NUMBER: _ClassVar[int]
    SNAPSHOT_ID_FIELD_NUMBER: _ClassVar[int]
    TERRAIN_FIELD_NUMBER: _ClassVar[int]
    IMAGES_FIELD_NUMBER: _ClassVar[int]
    ALL_IMAGES_FIELD_NUMBER: _ClassVar[int]
    views: _containers.RepeatedCompositeFieldContainer[MissionView]
    via_home: _containers.RepeatedCompositeFieldContainer[_poses_pb2.Pose]
    snapshot_id: str
    terrain: AnyTerrain
    images: _containers.RepeatedScalarFieldContainer[str]
    all_images: bool
    def __init__(self, views: _Optional[_Iterable[_Union[MissionView, _Mapping]]] = ..., via_home: _Optional[_Iterable[_Union[_poses_pb2.Pose, _Mapping]]] = ..., snapshot_id: _Optional[str] = ..., terrain: _Optional[_Union[AnyTerrain, _Mapping]] = ..., images: _Optional[_Iterable[str]] = ..., all_images: _Optional[bool] = ...) -> None: ...

class Terrain(_message.Message):
    __slots__ = ("south_deg", "west_deg", "latitude_step_deg", "longitude_step_deg", "columns", "heights_m", "altitude_datum")
    SOUTH_DEG_FIELD_NUMBER: _ClassVar[int]
    WEST_DEG_FIELD_NUMBER: _ClassVar[int]
    LATITUDE_STEP_DEG_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_STEP_DEG_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    HEIGHTS_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    south_deg: float
    west_deg: float
    latitude_step_deg: float
    longitude_step_deg: float
    columns: int
    heights_m: _containers.RepeatedScalarFieldContainer[float]
    altitude_datum: _poses_pb2.AltitudeDatum
    def __init__(self, south_deg: _Optional[float] = ..., west_deg: _Optional[float] = ..., latitude_step_deg: _Optional[float] = ..., longitude_step_deg: _Optional[float] = ..., columns: _Optional[int] = ..., heights_m: _Optional[_Iterable[float]] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ...) -> None: ...

class TerrainOfPoints(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class AnyTerrain(_message.Message):
    __slots__ = ("heights", "points")
    HEIGHTS_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    heights: Terrain
    points: TerrainOfPoints
    def __init__(self, heights: _Optional[_Union[Terrain, _Mapping]] = ..., points: _Optional[_Union[TerrainOfPoints, _Mapping]] = ...) -> None: ...

class MissionFile(_message.Message):
    __slots__ = ("name", "media_type", "content", "left_out", "reasons", "parts", "views", "length_m", "duration_s")
    NAME_FIELD_NUMBER: _ClassVar[int]
    MEDIA_TYPE_FIELD_NUMBER: _ClassVar[int]
    CONTENT_FIELD_NUMBER: _ClassVar[int]
    LEFT_OUT_FIELD_NUMBER: _ClassVar[int]
    REASONS_FIELD_NUMBER: _ClassVar[int]
    PARTS_FIELD_NUMBER: _ClassVar[int]
    VIEWS_FIELD_NUMBER: _ClassVar[int]
    LENGTH_M_FIELD_NUMBER: _ClassVar[int]
    DURATION_S_FIELD_NUMBER: _ClassVar[int]
    name: str
    media_type: str
    content: bytes
    left_out: _containers.RepeatedScalarFieldContainer[str]
    reasons: _containers.RepeatedScalarFieldContainer[str]
    parts: int
    views: int
    length_m: float
    duration_s: float
    def __init__(self, name: _Optional[str] = ..., media_type: _Optional[str] = ..., content: _Optional[bytes] = ..., left_out: _Optional[_Iterable[str]] = ..., reasons: _Optional[_Iterable[str]] = ..., parts: _Optional[int] = ..., views: _Optional[int] = ..., length_m: _Optional[float] = ..., duration_s: _Optional[float] = ...) -> None: ...
