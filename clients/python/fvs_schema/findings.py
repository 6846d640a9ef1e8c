"""Findings: what structure from motion, training, rankings and plans have to say about themselves."""

from collections.abc import Iterable

from pydantic import Field

from fvs_schema.base import Output
from fvs_schema.words import Word


class Severity(Word):
    """What a finding means for its result."""

    NOTE = "note"
    """It explains what happened."""
    WARNING = "warning"
    """It limits the use of the result."""
    DOUBT = "doubt"
    """The model is used, and its cameras may be wrong."""
    REJECTION = "rejection"
    """It is the reason why a model was not used."""


class FindingCode(Word):
    """The kind of a finding, for programs. Its sentence and its hint are in ``fvs_engine.wording``."""

    NO_FEATURES = "no-features"
    FEW_FEATURES = "few-features"
    UNCALIBRATED = "uncalibrated"

    NO_PAIRS = "no-pairs"
    MATCH_SUPPORT = "match-support"
    ROTATION_SUPPORT = "rotation-support"
    DIRECTION_SUPPORT = "direction-support"
    CONTRADICTED_POSES = "contradicted-poses"
    WEAK_POSES = "weak-poses"
    WRONG_DISTANCE = "wrong-distance"
    UNKNOWN_DISTANCE = "unknown-distance"
    LOOSELY_LINKED = "loosely-linked"
    CONFLICTING_VIEWS = "conflicting-views"
    UNLIKELY_FOCAL_LENGTH = "unlikely-focal-length"
    FAR_FROM_PRIORS = "far-from-priors"
    CENTRES_OFF_PRIORS = "centres-off-priors"
    UNCONFIRMED = "unconfirmed"
    HARDLY_CONFIRMED = "hardly-confirmed"
    CONFIRMED_BY_POSITIONS = "confirmed-by-positions"
    RIVAL_MODEL = "rival-model"

    POSITIONS_IGNORED = "positions-ignored"
    ORIENTATIONS_IGNORED = "orientations-ignored"
    FROZEN_POSITIONS = "frozen-positions"

    POSE_UNSUPPORTED = "pose-unsupported"
    POSE_AT_WRONG_DISTANCE = "pose-at-wrong-distance"
    POSE_FAR_FROM_PRIOR = "pose-far-from-prior"
    POSE_UNCERTAIN = "pose-uncertain"
    POSE_UNDETERMINED = "pose-undetermined"
    LOOK_ALIKE_PLACE = "look-alike-place"
    UNMATCHED = "unmatched"
    FEW_POINTS = "few-points"
    UNREGISTERED = "unregistered"
    SEPARATE_MODEL = "separate-model"
    POSES_LOST = "poses-lost"
    LEFT_OUT = "left-out"
    QUARANTINED = "quarantined"
    NO_IMAGE_OF_CAMERA = "no-image-of-camera"

    SUPPORT_FELL = "support-fell"
    MANY_UNREGISTERED = "many-unregistered"
    REMAPPED = "remapped"
    NO_BETTER_MODEL = "no-better-model"
    NEW_MODEL_REJECTED = "new-model-rejected"
    NEW_MODEL_DOUBTFUL = "new-model-doubtful"
    NEW_MODEL_UNALIGNED = "new-model-unaligned"

    VIEWS_WITHOUT_PHOTOGRAPH = "views-without-photograph"
    PHOTOGRAPHS_WITHOUT_POSE = "photographs-without-pose"
    UNUSABLE_PHOTOGRAPH = "unusable-photograph"
    WITHOUT_MASK = "without-mask"
    NAMES_RESPELLED = "names-respelled"
    PIXELS_AS_STORED = "pixels-as-stored"
    FAR_COORDINATES = "far-coordinates"

    VIDEO_DAMAGED = "video-damaged"
    FRAMES_BLURRED = "frames-blurred"
    FRAMES_WITHOUT_POSITION = "frames-without-position"
    FRAMES_WITHOUT_ALTITUDE = "frames-without-altitude"
    FRAMES_ABOVE_ELLIPSOID = "frames-above-ellipsoid"
    FRAMES_SPACED_WIDER = "frames-spaced-wider"
    FRAMES_LEFT_OUT = "frames-left-out"
    VIDEO_UNDECODABLE = "video-undecodable"

    FEW_STARTS = "few-starts"
    ALREADY_TRAINED = "already-trained"
    NONE_HELD_OUT = "none-held-out"
    LITTLE_MEMORY = "little-memory"
    FLOATERS_REMOVED = "floaters-removed"
    RUN_FAILED = "run-failed"
    STARTED_AGAIN_AFTER_DAMAGE = "started-again-after-damage"
    STARTED_AGAIN_WITH_SETTINGS = "started-again-with-settings"
    UPDATE_UNCHANGED = "update-unchanged"

    ILL_CONDITIONED = "ill-conditioned"
    POSITIONS_UNUSED = "positions-unused"
    HEIGHTS_NOT_ELLIPSOIDAL = "heights-not-ellipsoidal"
    COARSE_POSITIONS = "coarse-positions"
    FEW_REGISTRABLE = "few-registrable"
    NONE_FEASIBLE = "none-feasible"
    FEWER_CANDIDATES = "fewer-candidates"
    CANDIDATES_DRAWN = "candidates-drawn"
    VEHICLE_BLOCKED = "vehicle-blocked"
    VEHICLE_WITHOUT_WAY = "vehicle-without-way"
    VEHICLE_OUT_OF_RANGE = "vehicle-out-of-range"
    TOO_CLOSE = "too-close"
    UNDER_GROUND = "under-ground"
    GROUND_UNKNOWN = "ground-unknown"
    UNREACHABLE = "unreachable"
    SAME_POSE = "same-pose"
    NOTHING_IN_VIEW = "nothing-in-view"
    CONTROL_POINT_OFF = "control-point-off"
    CONTROL_POINTS_SWAPPED = "control-points-swapped"
    CONTROL_POINT_SEEN_ONCE = "control-point-seen-once"
    CONTROL_POINT_WITHOUT_PARALLAX = "control-point-without-parallax"
    CONTROL_MARKS_DISAGREE = "control-marks-disagree"
    CONTROL_MARK_OFF = "control-mark-off"
    MARKED_IMAGES_UNKNOWN = "marked-images-unknown"
    CONTROL_POINTS_UNUSED = "control-points-unused"


class Finding(Output):
    """One finding: its ``code``, the images that it is about, and the numbers and words of its sentence."""

    code: FindingCode
    """The kind, stable, for programs."""
    severity: Severity = Severity.WARNING
    """What it means for the result."""
    images: tuple[str, ...] = ()
    """The images that it is about, on the wire their digests; of conflicting views the two of each pair, one
    after the other."""
    candidates: tuple[str, ...] = ()
    """The candidates that it is about, by id."""
    numbers: dict[str, float] = Field(default={})
    """Its numbers, by name."""
    texts: dict[str, str] = Field(default={})
    """Its other data, by name: a stage, a mapper, a file."""

    def with_severity(self, severity: Severity) -> "Finding":
        """The same finding with another meaning for its result."""
        return self.model_copy(update={"severity": severity})

    @classmethod
    def of(
        cls,
        code: FindingCode,
        images: Iterable[str] = (),
        severity: Severity = Severity.WARNING,
        candidates: Iterable[str] = (),
        **data: float | str,
    ) -> "Finding":
        """The finding with its ``data``: numbers and texts."""
        return cls(
            code=code,
            severity=severity,
            images=tuple(images),
            candidates=tuple(candidates),
            numbers={name: value for name, value in data.items() if not isinstance(value, str)},
            texts={name: value for name, value in data.items() if isinstance(value, str)},
        )


class Notice(Finding):
    """A finding for people, too."""

    message: str
    """What was found, in a sentence; images have their senders' names."""
    hint: str
    """What to do about it."""
