from fvs.v1 import poses_pb2 as _poses_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class PointStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    POINT_STATUS_UNSPECIFIED: _ClassVar[PointStatus]
    POINT_STATUS_USED: _ClassVar[PointStatus]
    POINT_STATUS_CHECK: _ClassVar[PointStatus]
    POINT_STATUS_OUTLIER: _ClassVar[PointStatus]
    POINT_STATUS_NO_HEIGHT: _ClassVar[PointStatus]
    POINT_STATUS_SEEN_ONCE: _ClassVar[PointStatus]
    POINT_STATUS_NO_PARALLAX: _ClassVar[PointStatus]
    POINT_STATUS_MARKS_DISAGREE: _ClassVar[PointStatus]
POINT_STATUS_UNSPECIFIED: PointStatus
POINT_STATUS_USED: PointStatus
POINT_STATUS_CHECK: PointStatus
POINT_STATUS_OUTLIER: PointStatus
POINT_STATUS_NO_HEIGHT: PointStatus
POINT_STATUS_SEEN_ONCE: PointStatus
POINT_STATUS_NO_PARALLAX: PointStatus
POINT_STATUS_MARKS_DISAGREE: PointStatus

class Mark(_message.Message):
    __slots__ = ("image", "x_px", "y_px")
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    X_PX_FIELD_NUMBER: _ClassVar[int]
    Y_PX_FIELD_NUMBER: _ClassVar[int]
    image: str
    x_px: float
    y_px: float
    def __init__(self, image: _Optional[str] = ..., x_px: _Optional[float] = ..., y_px: _Optional[float] = ...) -> None: ...

class ControlPoint(_message.Message):
    __slots__ = ("name", "x", "y", "z", "check", "marks")
    NAME_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    CHECK_FIELD_NUMBER: _ClassVar[int]
    MARKS_FIELD_NUMBER: _ClassVar[int]
    name: str
    x: float
    y: float
    z: float
    check: bool
    marks: _containers.RepeatedCompositeFieldContainer[Mark]
    def __init__(self, name: _Optional[str] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ..., check: _Optional[bool] = ..., marks: _Optional[_Iterable[_Union[Mark, _Mapping]]] = ...) -> None: ...

class ControlPoints(_message.Message):
    __slots__ = ("crs", "altitude_datum", "points")
    CRS_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    crs: str
    altitude_datum: _poses_pb2.AltitudeDatum
    points: _containers.RepeatedCompositeFieldContainer[ControlPoint]
    def __init__(self, crs: _Optional[str] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ..., points: _Optional[_Iterable[_Union[ControlPoint, _Mapping]]] = ...) -> None: ...

class PointResidual(_message.Message):
    __slots__ = ("name", "check", "status", "east_m", "north_m", "up_m", "distance_m", "marks", "wrong_marks", "reprojection_px")
    NAME_FIELD_NUMBER: _ClassVar[int]
    CHECK_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    EAST_M_FIELD_NUMBER: _ClassVar[int]
    NORTH_M_FIELD_NUMBER: _ClassVar[int]
    UP_M_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    MARKS_FIELD_NUMBER: _ClassVar[int]
    WRONG_MARKS_FIELD_NUMBER: _ClassVar[int]
    REPROJECTION_PX_FIELD_NUMBER: _ClassVar[int]
    name: str
    check: bool
    status: PointStatus
    east_m: float
    north_m: float
    up_m: float
    distance_m: float
    marks: int
    wrong_marks: _containers.RepeatedScalarFieldContainer[str]
    reprojection_px: float
    def __init__(self, name: _Optional[str] = ..., check: _Optional[bool] = ..., status: _Optional[_Union[PointStatus, str]] = ..., east_m: _Optional[float] = ..., north_m: _Optional[float] = ..., up_m: _Optional[float] = ..., distance_m: _Optional[float] = ..., marks: _Optional[int] = ..., wrong_marks: _Optional[_Iterable[str]] = ..., reprojection_px: _Optional[float] = ...) -> None: ...

class ControlResiduals(_message.Message):
    __slots__ = ("points", "control_rms_m", "check_rms_m")
    POINTS_FIELD_NUMBER: _ClassVar[int]
    CONTROL_RMS_M_FIELD_NUMBER: _ClassVar[int]
    CHECK_RMS_M_FIELD_NUMBER: _ClassVar[int]
    points: _containers.RepeatedCompositeFieldContainer[PointResidual]
    control_rms_m: float
    check_rms_m: float
    def __init__(self, points: _Optional[_Iterable[_Union[PointResidual, _Mapping]]] = ..., control_rms_m: _Optional[float] = ..., check_rms_m: _Optional[float] = ...) -> None: ...
