from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class AltitudeDatum(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ALTITUDE_DATUM_UNSPECIFIED: _ClassVar[AltitudeDatum]
    ALTITUDE_DATUM_ELLIPSOID: _ClassVar[AltitudeDatum]
    ALTITUDE_DATUM_SEA_LEVEL: _ClassVar[AltitudeDatum]
    ALTITUDE_DATUM_TAKEOFF: _ClassVar[AltitudeDatum]

class PoseFrame(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POSE_FRAME_UNSPECIFIED: _ClassVar[PoseFrame]
    POSE_FRAME_WORLD: _ClassVar[PoseFrame]
    POSE_FRAME_MODEL: _ClassVar[PoseFrame]
    POSE_FRAME_GEODETIC: _ClassVar[PoseFrame]

class AlignmentStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ALIGNMENT_STATUS_UNSPECIFIED: _ClassVar[AlignmentStatus]
    ALIGNMENT_STATUS_MODEL: _ClassVar[AlignmentStatus]
    ALIGNMENT_STATUS_ALIGNED: _ClassVar[AlignmentStatus]
    ALIGNMENT_STATUS_ILL_CONDITIONED: _ClassVar[AlignmentStatus]

class AlignmentSource(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ALIGNMENT_SOURCE_UNSPECIFIED: _ClassVar[AlignmentSource]
    ALIGNMENT_SOURCE_POSITIONS: _ClassVar[AlignmentSource]
    ALIGNMENT_SOURCE_CONTROL_POINTS: _ClassVar[AlignmentSource]
ALTITUDE_DATUM_UNSPECIFIED: AltitudeDatum
ALTITUDE_DATUM_ELLIPSOID: AltitudeDatum
ALTITUDE_DATUM_SEA_LEVEL: AltitudeDatum
ALTITUDE_DATUM_TAKEOFF: AltitudeDatum
POSE_FRAME_UNSPECIFIED: PoseFrame
POSE_FRAME_WORLD: PoseFrame
POSE_FRAME_MODEL: PoseFrame
POSE_FRAME_GEODETIC: PoseFrame
ALIGNMENT_STATUS_UNSPECIFIED: AlignmentStatus
ALIGNMENT_STATUS_MODEL: AlignmentStatus
ALIGNMENT_STATUS_ALIGNED: AlignmentStatus
ALIGNMENT_STATUS_ILL_CONDITIONED: AlignmentStatus
ALIGNMENT_SOURCE_UNSPECIFIED: AlignmentSource
ALIGNMENT_SOURCE_POSITIONS: AlignmentSource
ALIGNMENT_SOURCE_CONTROL_POINTS: AlignmentSource

class FramePose(_message.Message):
    __slots__ = ("frame", "position", "orientation_wxyz")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    ORIENTATION_WXYZ_FIELD_NUMBER: _ClassVar[int]
    frame: PoseFrame
    position: _containers.RepeatedScalarFieldContainer[float]
    orientation_wxyz: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, frame: _Optional[_Union[PoseFrame, str]] = ..., position: _Optional[_Iterable[float]] = ..., orientation_wxyz: _Optional[_Iterable[float]] = ...) -> None: ...

class VehiclePose(_message.Message):
    __slots__ = ("latitude_deg", "longitude_deg", "altitude_m", "altitude_datum", "yaw_deg", "pitch_deg", "roll_deg")
    LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    YAW_DEG_FIELD_NUMBER: _ClassVar[int]
    PITCH_DEG_FIELD_NUMBER: _ClassVar[int]
    ROLL_DEG_FIELD_NUMBER: _ClassVar[int]
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: AltitudeDatum
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    def __init__(self, latitude_deg: _Optional[float] = ..., longitude_deg: _Optional[float] = ..., altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[AltitudeDatum, str]] = ..., yaw_deg: _Optional[float] = ..., pitch_deg: _Optional[float] = ..., roll_deg: _Optional[float] = ...) -> None: ...

class Pose(_message.Message):
    __slots__ = ("frame", "vehicle")
    FRAME_FIELD_NUMBER: _ClassVar[int]
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    frame: FramePose
    vehicle: VehiclePose
    def __init__(self, frame: _Optional[_Union[FramePose, _Mapping]] = ..., vehicle: _Optional[_Union[VehiclePose, _Mapping]] = ...) -> None: ...

class Origin(_message.Message):
    __slots__ = ("latitude_deg", "longitude_deg", "altitude_m", "altitude_datum")
    LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: AltitudeDatum
    def __init__(self, latitude_deg: _Optional[float] = ..., longitude_deg: _Optional[float] = ..., altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[AltitudeDatum, str]] = ...) -> None: ...

class Alignment(_message.Message):
    __slots__ = ("status", "scale", "rotation_wxyz", "translation", "rms_m", "inliers", "positions", "source", "takeoff_altitude_m")
    STATUS_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    ROTATION_WXYZ_FIELD_NUMBER: _ClassVar[int]
    TRANSLATION_FIELD_NUMBER: _ClassVar[int]
    RMS_M_FIELD_NUMBER: _ClassVar[int]
    INLIERS_FIELD_NUMBER: _ClassVar[int]
    POSITIONS_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    TAKEOFF_ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    status: AlignmentStatus
    scale: float
    rotation_wxyz: _containers.RepeatedScalarFieldContainer[float]
    translation: _containers.RepeatedScalarFieldContainer[float]
    rms_m: float
    inliers: int
    positions: int
    source: AlignmentSource
    takeoff_altitude_m: float
    def __init__(self, status: _Optional[_Union[AlignmentStatus, str]] = ..., scale: _Optional[float] = ..., rotation_wxyz: _Optional[_Iterable[float]] = ..., translation: _Optional[_Iterable[float]] = ..., rms_m: _Optional[float] = ..., inliers: _Optional[int] = ..., positions: _Optional[int] = ..., source: _Optional[_Union[AlignmentSource, str]] = ..., takeoff_altitude_m: _Optional[float] = ...) -> None: ...
