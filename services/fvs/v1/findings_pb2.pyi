from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Severity(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SEVERITY_UNSPECIFIED: _ClassVar[Severity]
    SEVERITY_NOTE: _ClassVar[Severity]
    SEVERITY_WARNING: _ClassVar[Severity]
    SEVERITY_DOUBT: _ClassVar[Severity]
    SEVERITY_REJECTION: _ClassVar[Severity]

class FindingCode(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FINDING_CODE_UNSPECIFIED: _ClassVar[FindingCode]
    FINDING_CODE_NO_FEATURES: _ClassVar[FindingCode]
    FINDING_CODE_FEW_FEATURES: _ClassVar[FindingCode]
    FINDING_CODE_UNCALIBRATED: _ClassVar[FindingCode]
    FINDING_CODE_NO_PAIRS: _ClassVar[FindingCode]
    FINDING_CODE_MATCH_SUPPORT: _ClassVar[FindingCode]
    FINDING_CODE_ROTATION_SUPPORT: _ClassVar[FindingCode]
    FINDING_CODE_DIRECTION_SUPPORT: _ClassVar[FindingCode]
    FINDING_CODE_CONTRADICTED_POSES: _ClassVar[FindingCode]
    FINDING_CODE_WEAK_POSES: _ClassVar[FindingCode]
    FINDING_CODE_WRONG_DISTANCE: _ClassVar[FindingCode]
    FINDING_CODE_UNKNOWN_DISTANCE: _ClassVar[FindingCode]
    FINDING_CODE_LOOSELY_LINKED: _ClassVar[FindingCode]
    FINDING_CODE_CONFLICTING_VIEWS: _ClassVar[FindingCode]
    FINDING_CODE_UNLIKELY_FOCAL_LENGTH: _ClassVar[FindingCode]
    FINDING_CODE_FAR_FROM_PRIORS: _ClassVar[FindingCode]
    FINDING_CODE_CENTRES_OFF_PRIORS: _ClassVar[FindingCode]
    FINDING_CODE_UNCONFIRMED: _ClassVar[FindingCode]
    FINDING_CODE_HARDLY_CONFIRMED: _ClassVar[FindingCode]
    FINDING_CODE_CONFIRMED_BY_POSITIONS: _ClassVar[FindingCode]
    FINDING_CODE_RIVAL_MODEL: _ClassVar[FindingCode]
    FINDING_CODE_POSITIONS_IGNORED: _ClassVar[FindingCode]
    FINDING_CODE_ORIENTATIONS_IGNORED: _ClassVar[FindingCode]
    FINDING_CODE_FROZEN_POSITIONS: _ClassVar[FindingCode]
    FINDING_CODE_POSE_UNSUPPORTED: _ClassVar[FindingCode]
    FINDING_CODE_POSE_AT_WRONG_DISTANCE: _ClassVar[FindingCode]
    FINDING_CODE_POSE_FAR_FROM_PRIOR: _ClassVar[FindingCode]
    FINDING_CODE_POSE_UNCERTAIN: _ClassVar[FindingCode]
    FINDING_CODE_POSE_UNDETERMINED: _ClassVar[FindingCode]
    FINDING_CODE_LOOK_ALIKE_PLACE: _ClassVar[FindingCode]
    FINDING_CODE_UNMATCHED: _ClassVar[FindingCode]
    FINDING_CODE_FEW_POINTS: _ClassVar[FindingCode]
    FINDING_CODE_UNREGISTERED: _ClassVar[FindingCode]
    FINDING_CODE_SEPARATE_MODEL: _ClassVar[FindingCode]
    FINDING_CODE_POSES_LOST: _ClassVar[FindingCode]
    FINDING_CODE_LEFT_OUT: _ClassVar[FindingCode]
    FINDING_CODE_QUARANTINED: _ClassVar[FindingCode]
    FINDING_CODE_NO_IMAGE_OF_CAMERA: _ClassVar[FindingCode]
    FINDING_CODE_SUPPORT_FELL: _ClassVar[FindingCode]
    FINDING_CODE_MANY_UNREGISTERED: _ClassVar[FindingCode]
    FINDING_CODE_REMAPPED: _ClassVar[FindingCode]
    FINDING_CODE_NO_BETTER_MODEL: _ClassVar[FindingCode]
    FINDING_CODE_NEW_MODEL_REJECTED: _ClassVar[FindingCode]
    FINDING_CODE_NEW_MODEL_DOUBTFUL: _ClassVar[FindingCode]
    FINDING_CODE_NEW_MODEL_UNALIGNED: _ClassVar[FindingCode]
    FINDING_CODE_VIEWS_WITHOUT_PHOTOGRAPH: _ClassVar[FindingCode]
    FINDING_CODE_PHOTOGRAPHS_WITHOUT_POSE: _ClassVar[FindingCode]
    FINDING_CODE_UNUSABLE_PHOTOGRAPH: _ClassVar[FindingCode]
    FINDING_CODE_WITHOUT_MASK: _ClassVar[FindingCode]
    FINDING_CODE_VIDEO_DAMAGED: _ClassVar[FindingCode]
    FINDING_CODE_FRAMES_BLURRED: _ClassVar[FindingCode]
    FINDING_CODE_FRAMES_WITHOUT_POSITION: _ClassVar[FindingCode]
    FINDING_CODE_FRAMES_WITHOUT_ALTITUDE: _ClassVar[FindingCode]
    FINDING_CODE_FEW_STARTS: _ClassVar[FindingCode]
    FINDING_CODE_ALREADY_TRAINED: _ClassVar[FindingCode]
    FINDING_CODE_NONE_HELD_OUT: _ClassVar[FindingCode]
    FINDING_CODE_LITTLE_MEMORY: _ClassVar[FindingCode]
    FINDING_CODE_RUN_FAILED: _ClassVar[FindingCode]
    FINDING_CODE_STARTED_AGAIN_AFTER_DAMAGE: _ClassVar[FindingCode]
    FINDING_CODE_STARTED_AGAIN_WITH_SETTINGS: _ClassVar[FindingCode]
    FINDING_CODE_UPDATE_UNCHANGED: _ClassVar[FindingCode]
    FINDING_CODE_ILL_CONDITIONED: _ClassVar[FindingCode]
    FINDING_CODE_POSITIONS_UNUSED: _ClassVar[FindingCode]
    FINDING_CODE_FEW_REGISTRABLE: _ClassVar[FindingCode]
    FINDING_CODE_NONE_FEASIBLE: _ClassVar[FindingCode]
    FINDING_CODE_FEWER_CANDIDATES: _ClassVar[FindingCode]
    FINDING_CODE_CANDIDATES_DRAWN: _ClassVar[FindingCode]
    FINDING_CODE_VEHICLE_BLOCKED: _ClassVar[FindingCode]
    FINDING_CODE_VEHICLE_WITHOUT_WAY: _ClassVar[FindingCode]
    FINDING_CODE_VEHICLE_OUT_OF_RANGE: _ClassVar[FindingCode]
    FINDING_CODE_TOO_CLOSE: _ClassVar[FindingCode]
    FINDING_CODE_UNREACHABLE: _ClassVar[FindingCode]
    FINDING_CODE_SAME_POSE: _ClassVar[FindingCode]
    FINDING_CODE_NOTHING_IN_VIEW: _ClassVar[FindingCode]
    FINDING_CODE_HEIGHTS_NOT_ELLIPSOIDAL: _ClassVar[FindingCode]
    FINDING_CODE_COARSE_POSITIONS: _ClassVar[FindingCode]
    FINDING_CODE_NAMES_RESPELLED: _ClassVar[FindingCode]
    FINDING_CODE_PIXELS_AS_STORED: _ClassVar[FindingCode]
    FINDING_CODE_FAR_COORDINATES: _ClassVar[FindingCode]
    FINDING_CODE_CONTROL_POINT_OFF: _ClassVar[FindingCode]
    FINDING_CODE_CONTROL_POINTS_SWAPPED: _ClassVar[FindingCode]
    FINDING_CODE_CONTROL_POINT_SEEN_ONCE: _ClassVar[FindingCode]
    FINDING_CODE_CONTROL_POINT_WITHOUT_PARALLAX: _ClassVar[FindingCode]
    FINDING_CODE_CONTROL_MARKS_DISAGREE: _ClassVar[FindingCode]
    FINDING_CODE_CONTROL_MARK_OFF: _ClassVar[FindingCode]
    FINDING_CODE_MARKED_IMAGES_UNKNOWN: _ClassVar[FindingCode]
SEVERITY_UNSPECIFIED: Severity
SEVERITY_NOTE: Severity
SEVERITY_WARNING: Severity
SEVERITY_DOUBT: Severity
SEVERITY_REJECTION: Severity
FINDING_CODE_UNSPECIFIED: FindingCode
FINDING_CODE_NO_FEATURES: FindingCode
FINDING_CODE_FEW_FEATURES: FindingCode
FINDING_CODE_UNCALIBRATED: FindingCode
FINDING_CODE_NO_PAIRS: FindingCode
FINDING_CODE_MATCH_SUPPORT: FindingCode
FINDING_CODE_ROTATION_SUPPORT: FindingCode
FINDING_CODE_DIRECTION_SUPPORT: FindingCode
FINDING_CODE_CONTRADICTED_POSES: FindingCode
FINDING_CODE_WEAK_POSES: FindingCode
FINDING_CODE_WRONG_DISTANCE: FindingCode
FINDING_CODE_UNKNOWN_DISTANCE: FindingCode
FINDING_CODE_LOOSELY_LINKED: FindingCode
FINDING_CODE_CONFLICTING_VIEWS: FindingCode
FINDING_CODE_UNLIKELY_FOCAL_LENGTH: FindingCode
FINDING_CODE_FAR_FROM_PRIORS: FindingCode
FINDING_CODE_CENTRES_OFF_PRIORS: FindingCode
FINDING_CODE_UNCONFIRMED: FindingCode
FINDING_CODE_HARDLY_CONFIRMED: FindingCode
FINDING_CODE_CONFIRMED_BY_POSITIONS: FindingCode
FINDING_CODE_RIVAL_MODEL: FindingCode
FINDING_CODE_POSITIONS_IGNORED: FindingCode
FINDING_CODE_ORIENTATIONS_IGNORED: FindingCode
FINDING_CODE_FROZEN_POSITIONS: FindingCode
FINDING_CODE_POSE_UNSUPPORTED: FindingCode
FINDING_CODE_POSE_AT_WRONG_DISTANCE: FindingCode
FINDING_CODE_POSE_FAR_FROM_PRIOR: FindingCode
FINDING_CODE_POSE_UNCERTAIN: FindingCode
FINDING_CODE_POSE_UNDETERMINED: FindingCode
FINDING_CODE_LOOK_ALIKE_PLACE: FindingCode
FINDING_CODE_UNMATCHED: FindingCode
FINDING_CODE_FEW_POINTS: FindingCode
FINDING_CODE_UNREGISTERED: FindingCode
FINDING_CODE_SEPARATE_MODEL: FindingCode
FINDING_CODE_POSES_LOST: FindingCode
FINDING_CODE_LEFT_OUT: FindingCode
FINDING_CODE_QUARANTINED: FindingCode
FINDING_CODE_NO_IMAGE_OF_CAMERA: FindingCode
FINDING_CODE_SUPPORT_FELL: FindingCode
FINDING_CODE_MANY_UNREGISTERED: FindingCode
FINDING_CODE_REMAPPED: FindingCode
FINDING_CODE_NO_BETTER_MODEL: FindingCode
FINDING_CODE_NEW_MODEL_REJECTED: FindingCode
FINDING_CODE_NEW_MODEL_DOUBTFUL: FindingCode
FINDING_CODE_NEW_MODEL_UNALIGNED: FindingCode
FINDING_CODE_VIEWS_WITHOUT_PHOTOGRAPH: FindingCode
FINDING_CODE_PHOTOGRAPHS_WITHOUT_POSE: FindingCode
FINDING_CODE_UNUSABLE_PHOTOGRAPH: FindingCode
FINDING_CODE_WITHOUT_MASK: FindingCode
FINDING_CODE_VIDEO_DAMAGED: FindingCode
FINDING_CODE_FRAMES_BLURRED: FindingCode
FINDING_CODE_FRAMES_WITHOUT_POSITION: FindingCode
FINDING_CODE_FRAMES_WITHOUT_ALTITUDE: FindingCode
FINDING_CODE_FEW_STARTS: FindingCode
FINDING_CODE_ALREADY_TRAINED: FindingCode
FINDING_CODE_NONE_HELD_OUT: FindingCode
FINDING_CODE_LITTLE_MEMORY: FindingCode
FINDING_CODE_RUN_FAILED: FindingCode
FINDING_CODE_STARTED_AGAIN_AFTER_DAMAGE: FindingCode
FINDING_CODE_STARTED_AGAIN_WITH_SETTINGS: FindingCode
FINDING_CODE_UPDATE_UNCHANGED: FindingCode
FINDING_CODE_ILL_CONDITIONED: FindingCode
FINDING_CODE_POSITIONS_UNUSED: FindingCode
FINDING_CODE_FEW_REGISTRABLE: FindingCode
FINDING_CODE_NONE_FEASIBLE: FindingCode
FINDING_CODE_FEWER_CANDIDATES: FindingCode
FINDING_CODE_CANDIDATES_DRAWN: FindingCode
FINDING_CODE_VEHICLE_BLOCKED: FindingCode
FINDING_CODE_VEHICLE_WITHOUT_WAY: FindingCode
FINDING_CODE_VEHICLE_OUT_OF_RANGE: FindingCode
FINDING_CODE_TOO_CLOSE: FindingCode
FINDING_CODE_UNREACHABLE: FindingCode
FINDING_CODE_SAME_POSE: FindingCode
FINDING_CODE_NOTHING_IN_VIEW: FindingCode
FINDING_CODE_HEIGHTS_NOT_ELLIPSOIDAL: FindingCode
FINDING_CODE_COARSE_POSITIONS: FindingCode
FINDING_CODE_NAMES_RESPELLED: FindingCode
FINDING_CODE_PIXELS_AS_STORED: FindingCode
FINDING_CODE_FAR_COORDINATES: FindingCode
FINDING_CODE_CONTROL_POINT_OFF: FindingCode
FINDING_CODE_CONTROL_POINTS_SWAPPED: FindingCode
FINDING_CODE_CONTROL_POINT_SEEN_ONCE: FindingCode
FINDING_CODE_CONTROL_POINT_WITHOUT_PARALLAX: FindingCode
FINDING_CODE_CONTROL_MARKS_DISAGREE: FindingCode
FINDING_CODE_CONTROL_MARK_OFF: FindingCode
FINDING_CODE_MARKED_IMAGES_UNKNOWN: FindingCode

class Notice(_message.Message):
    __slots__ = ("code", "severity", "images", "numbers", "texts", "message", "hint")
    class NumbersEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    class TextsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    CODE_FIELD_NUMBER: _ClassVar[int]
    SEVERITY_FIELD_NUMBER: _ClassVar[int]
    IMAGES_FIELD_NUMBER: _ClassVar[int]
    NUMBERS_FIELD_NUMBER: _ClassVar[int]
    TEXTS_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    HINT_FIELD_NUMBER: _ClassVar[int]
    code: FindingCode
    severity: Severity
    images: _containers.RepeatedScalarFieldContainer[str]
    numbers: _containers.ScalarMap[str, float]
    texts: _containers.ScalarMap[str, str]
    message: str
    hint: str
    def __init__(self, code: _Optional[_Union[FindingCode, str]] = ..., severity: _Optional[_Union[Severity, str]] = ..., images: _Optional[_Iterable[str]] = ..., numbers: _Optional[_Mapping[str, float]] = ..., texts: _Optional[_Mapping[str, str]] = ..., message: _Optional[str] = ..., hint: _Optional[str] = ...) -> None: ...
