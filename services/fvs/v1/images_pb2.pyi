import datetime

from fvs.v1 import downloads_pb2 as _downloads_pb2
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

class Verdict(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VERDICT_UNSPECIFIED: _ClassVar[Verdict]
    VERDICT_ACCEPTED: _ClassVar[Verdict]
    VERDICT_DUPLICATE: _ClassVar[Verdict]
    VERDICT_UNREADABLE: _ClassVar[Verdict]
    VERDICT_TOO_SMALL: _ClassVar[Verdict]
    VERDICT_TOO_LARGE: _ClassVar[Verdict]
    VERDICT_TOO_NARROW: _ClassVar[Verdict]
    VERDICT_VIDEO: _ClassVar[Verdict]

class Registration(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    REGISTRATION_UNSPECIFIED: _ClassVar[Registration]
    REGISTRATION_PENDING: _ClassVar[Registration]
    REGISTRATION_REGISTERED: _ClassVar[Registration]
    REGISTRATION_UNREGISTERED: _ClassVar[Registration]
    REGISTRATION_UNUSED: _ClassVar[Registration]
    REGISTRATION_EXCLUDED: _ClassVar[Registration]
    REGISTRATION_QUARANTINED: _ClassVar[Registration]

class ImageWarning(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    IMAGE_WARNING_UNSPECIFIED: _ClassVar[ImageWarning]
    IMAGE_WARNING_BLURRED: _ClassVar[ImageWarning]
    IMAGE_WARNING_POSITION_IGNORED: _ClassVar[ImageWarning]

class PriorSource(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    PRIOR_SOURCE_UNSPECIFIED: _ClassVar[PriorSource]
    PRIOR_SOURCE_REQUEST: _ClassVar[PriorSource]
    PRIOR_SOURCE_METADATA: _ClassVar[PriorSource]
VERDICT_UNSPECIFIED: Verdict
VERDICT_ACCEPTED: Verdict
VERDICT_DUPLICATE: Verdict
VERDICT_UNREADABLE: Verdict
VERDICT_TOO_SMALL: Verdict
VERDICT_TOO_LARGE: Verdict
VERDICT_TOO_NARROW: Verdict
VERDICT_VIDEO: Verdict
REGISTRATION_UNSPECIFIED: Registration
REGISTRATION_PENDING: Registration
REGISTRATION_REGISTERED: Registration
REGISTRATION_UNREGISTERED: Registration
REGISTRATION_UNUSED: Registration
REGISTRATION_EXCLUDED: Registration
REGISTRATION_QUARANTINED: Registration
IMAGE_WARNING_UNSPECIFIED: ImageWarning
IMAGE_WARNING_BLURRED: ImageWarning
IMAGE_WARNING_POSITION_IGNORED: ImageWarning
PRIOR_SOURCE_UNSPECIFIED: PriorSource
PRIOR_SOURCE_REQUEST: PriorSource
PRIOR_SOURCE_METADATA: PriorSource

class CheckImagesRequest(_message.Message):
    __slots__ = ("scene_id", "check")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    CHECK_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    check: DigestCheck
    def __init__(self, scene_id: _Optional[str] = ..., check: _Optional[_Union[DigestCheck, _Mapping]] = ...) -> None: ...

class ImageUpload(_message.Message):
    __slots__ = ("scene_id", "digest", "size_bytes", "offset_bytes", "metadata")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    OFFSET_BYTES_FIELD_NUMBER: _ClassVar[int]
    METADATA_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    size_bytes: int
    offset_bytes: int
    metadata: ImageMetadata
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ..., size_bytes: _Optional[int] = ..., offset_bytes: _Optional[int] = ..., metadata: _Optional[_Union[ImageMetadata, _Mapping]] = ...) -> None: ...

class UploadImageRequest(_message.Message):
    __slots__ = ("upload", "chunk")
    UPLOAD_FIELD_NUMBER: _ClassVar[int]
    CHUNK_FIELD_NUMBER: _ClassVar[int]
    upload: ImageUpload
    chunk: bytes
    def __init__(self, upload: _Optional[_Union[ImageUpload, _Mapping]] = ..., chunk: _Optional[bytes] = ...) -> None: ...

class UploadImageResponse(_message.Message):
    __slots__ = ("created", "image")
    CREATED_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FIELD_NUMBER: _ClassVar[int]
    created: bool
    image: Image
    def __init__(self, created: _Optional[bool] = ..., image: _Optional[_Union[Image, _Mapping]] = ...) -> None: ...

class GetUploadRequest(_message.Message):
    __slots__ = ("scene_id", "digest")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ...) -> None: ...

class Upload(_message.Message):
    __slots__ = ("scene_id", "digest", "size_bytes", "offset_bytes", "expires_at")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    OFFSET_BYTES_FIELD_NUMBER: _ClassVar[int]
    EXPIRES_AT_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    size_bytes: int
    offset_bytes: int
    expires_at: _timestamp_pb2.Timestamp
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ..., size_bytes: _Optional[int] = ..., offset_bytes: _Optional[int] = ..., expires_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ...) -> None: ...

class ListImagesRequest(_message.Message):
    __slots__ = ("scene_id", "after", "limit")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    AFTER_FIELD_NUMBER: _ClassVar[int]
    LIMIT_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    after: str
    limit: int
    def __init__(self, scene_id: _Optional[str] = ..., after: _Optional[str] = ..., limit: _Optional[int] = ...) -> None: ...

class GetImageRequest(_message.Message):
    __slots__ = ("scene_id", "digest")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ...) -> None: ...

class DeleteImageRequest(_message.Message):
    __slots__ = ("scene_id", "digest")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ...) -> None: ...

class ExcludeImageRequest(_message.Message):
    __slots__ = ("scene_id", "digest")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ...) -> None: ...

class IncludeImageRequest(_message.Message):
    __slots__ = ("scene_id", "digest")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ...) -> None: ...

class SetMaskRequest(_message.Message):
    __slots__ = ("scene_id", "digest", "mask")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    MASK_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    mask: bytes
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ..., mask: _Optional[bytes] = ...) -> None: ...

class RemoveMaskRequest(_message.Message):
    __slots__ = ("scene_id", "digest")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ...) -> None: ...

class SetSubtitlesRequest(_message.Message):
    __slots__ = ("scene_id", "digest", "subtitles")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    SUBTITLES_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    subtitles: bytes
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ..., subtitles: _Optional[bytes] = ...) -> None: ...

class DownloadImageRequest(_message.Message):
    __slots__ = ("scene_id", "digest", "start", "stop")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    start: int
    stop: int
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ..., start: _Optional[int] = ..., stop: _Optional[int] = ...) -> None: ...

class GetThumbnailRequest(_message.Message):
    __slots__ = ("scene_id", "digest")
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    scene_id: str
    digest: str
    def __init__(self, scene_id: _Optional[str] = ..., digest: _Optional[str] = ...) -> None: ...

class Thumbnail(_message.Message):
    __slots__ = ("jpeg",)
    JPEG_FIELD_NUMBER: _ClassVar[int]
    jpeg: bytes
    def __init__(self, jpeg: _Optional[bytes] = ...) -> None: ...

class Prior(_message.Message):
    __slots__ = ("source", "latitude_deg", "longitude_deg", "altitude_m", "altitude_datum", "x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg", "position_sigma_m", "attitude_sigma_deg", "height_above_takeoff_m")
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    Z_M_FIELD_NUMBER: _ClassVar[int]
    YAW_DEG_FIELD_NUMBER: _ClassVar[int]
    PITCH_DEG_FIELD_NUMBER: _ClassVar[int]
    ROLL_DEG_FIELD_NUMBER: _ClassVar[int]
    POSITION_SIGMA_M_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_SIGMA_DEG_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_ABOVE_TAKEOFF_M_FIELD_NUMBER: _ClassVar[int]
    source: PriorSource
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: _poses_pb2.AltitudeDatum
    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    position_sigma_m: float
    attitude_sigma_deg: float
    height_above_takeoff_m: float
    def __init__(self, source: _Optional[_Union[PriorSource, str]] = ..., latitude_deg: _Optional[float] = ..., longitude_deg: _Optional[float] = ..., altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ..., x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., z_m: _Optional[float] = ..., yaw_deg: _Optional[float] = ..., pitch_deg: _Optional[float] = ..., roll_deg: _Optional[float] = ..., position_sigma_m: _Optional[float] = ..., attitude_sigma_deg: _Optional[float] = ..., height_above_takeoff_m: _Optional[float] = ...) -> None: ...

class ImageMetadata(_message.Message):
    __slots__ = ("name", "captured_at", "latitude_deg", "longitude_deg", "altitude_m", "altitude_datum", "x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg", "position_sigma_m", "attitude_sigma_deg", "every_s")
    NAME_FIELD_NUMBER: _ClassVar[int]
    CAPTURED_AT_FIELD_NUMBER: _ClassVar[int]
    LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_M_FIELD_NUMBER: _ClassVar[int]
    ALTITUDE_DATUM_FIELD_NUMBER: _ClassVar[int]
    X_M_FIELD_NUMBER: _ClassVar[int]
    Y_M_FIELD_NUMBER: _ClassVar[int]
    Z_M_FIELD_NUMBER: _ClassVar[int]
    YAW_DEG_FIELD_NUMBER: _ClassVar[int]
    PITCH_DEG_FIELD_NUMBER: _ClassVar[int]
    ROLL_DEG_FIELD_NUMBER: _ClassVar[int]
    POSITION_SIGMA_M_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_SIGMA_DEG_FIELD_NUMBER: _ClassVar[int]
    EVERY_S_FIELD_NUMBER: _ClassVar[int]
    name: str
    captured_at: _timestamp_pb2.Timestamp
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: _poses_pb2.AltitudeDatum
    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float
    position_sigma_m: float
    attitude_sigma_deg: float
    every_s: float
    def __init__(self, name: _Optional[str] = ..., captured_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., latitude_deg: _Optional[float] = ..., longitude_deg: _Optional[float] = ..., altitude_m: _Optional[float] = ..., altitude_datum: _Optional[_Union[_poses_pb2.AltitudeDatum, str]] = ..., x_m: _Optional[float] = ..., y_m: _Optional[float] = ..., z_m: _Optional[float] = ..., yaw_deg: _Optional[float] = ..., pitch_deg: _Optional[float] = ..., roll_deg: _Optional[float] = ..., position_sigma_m: _Optional[float] = ..., attitude_sigma_deg: _Optional[float] = ..., every_s: _Optional[float] = ...) -> None: ...

class Image(_message.Message):
    __slots__ = ("digest", "scene_id", "number", "name", "verdict", "reason", "hint", "warnings", "duplicate_of", "registration", "size_bytes", "format", "width_px", "height_px", "focal_length_px", "sharpness", "prior", "captured_at", "received_at", "finding", "mask", "video", "every_s", "frames")
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    SCENE_ID_FIELD_NUMBER: _ClassVar[int]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    HINT_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    DUPLICATE_OF_FIELD_NUMBER: _ClassVar[int]
    REGISTRATION_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    FOCAL_LENGTH_PX_FIELD_NUMBER: _ClassVar[int]
    SHARPNESS_FIELD_NUMBER: _ClassVar[int]
    PRIOR_FIELD_NUMBER: _ClassVar[int]
    CAPTURED_AT_FIELD_NUMBER: _ClassVar[int]
    RECEIVED_AT_FIELD_NUMBER: _ClassVar[int]
    FINDING_FIELD_NUMBER: _ClassVar[int]
    MASK_FIELD_NUMBER: _ClassVar[int]
    VIDEO_FIELD_NUMBER: _ClassVar[int]
    EVERY_S_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    digest: str
    scene_id: str
    number: int
    name: str
    verdict: Verdict
    reason: str
    hint: str
    warnings: _containers.RepeatedScalarFieldContainer[ImageWarning]
    duplicate_of: str
    registration: Registration
    size_bytes: int
    format: str
    width_px: int
    height_px: int
    focal_length_px: float
    sharpness: float
    prior: Prior
    captured_at: _timestamp_pb2.Timestamp
    received_at: _timestamp_pb2.Timestamp
    finding: _findings_pb2.FindingCode
    mask: str
    video: str
    every_s: float
    frames: int
    def __init__(self, digest: _Optional[str] = ..., scene_id: _Optional[str] = ..., number: _Optional[int] = ..., name: _Optional[str] = ..., verdict: _Optional[_Union[Verdict, str]] = ..., reason: _Optional[str] = ..., hint: _Optional[str] = ..., warnings: _Optional[_Iterable[_Union[ImageWarning, str]]] = ..., duplicate_of: _Optional[str] = ..., registration: _Optional[_Union[Registration, str]] = ..., size_bytes: _Optional[int] = ..., format: _Optional[str] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., focal_length_px: _Optional[float] = ..., sharpness: _Optional[float] = ..., prior: _Optional[_Union[Prior, _Mapping]] = ..., captured_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., received_at: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., finding: _Optional[_Union[_findings_pb2.FindingCode, str]] = ..., mask: _Optional[str] = ..., video: _Optional[str] = ..., every_s: _Optional[float] = ..., frames: _Optional[int] = ...) -> None: ...

class ImageList(_message.Message):
    __slots__ = ("items", "next")
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    NEXT_FIELD_NUMBER: _ClassVar[int]
    items: _containers.RepeatedCompositeFieldContainer[Image]
    next: str
    def __init__(self, items: _Optional[_Iterable[_Union[Image, _Mapping]]] = ..., next: _Optional[str] = ...) -> None: ...

class DigestCheck(_message.Message):
    __slots__ = ("digests",)
    DIGESTS_FIELD_NUMBER: _ClassVar[int]
    digests: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, digests: _Optional[_Iterable[str]] = ...) -> None: ...

class KnownImage(_message.Message):
    __slots__ = ("digest", "verdict", "reason", "hint", "mask")
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    VERDICT_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    HINT_FIELD_NUMBER: _ClassVar[int]
    MASK_FIELD_NUMBER: _ClassVar[int]
    digest: str
    verdict: Verdict
    reason: str
    hint: str
    mask: str
    def __init__(self, digest: _Optional[str] = ..., verdict: _Optional[_Union[Verdict, str]] = ..., reason: _Optional[str] = ..., hint: _Optional[str] = ..., mask: _Optional[str] = ...) -> None: ...

class DigestAnswer(_message.Message):
    __slots__ = ("known", "missing", "images")
    KNOWN_FIELD_NUMBER: _ClassVar[int]
    MISSING_FIELD_NUMBER: _ClassVar[int]
    IMAGES_FIELD_NUMBER: _ClassVar[int]
    known: _containers.RepeatedScalarFieldContainer[str]
    missing: _containers.RepeatedScalarFieldContainer[str]
    images: _containers.RepeatedCompositeFieldContainer[KnownImage]
    def __init__(self, known: _Optional[_Iterable[str]] = ..., missing: _Optional[_Iterable[str]] = ..., images: _Optional[_Iterable[_Union[KnownImage, _Mapping]]] = ...) -> None: ...
