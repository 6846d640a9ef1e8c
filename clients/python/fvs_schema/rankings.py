"""Requests for rankings, and rankings."""

from functools import cached_property
from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from fvs_schema.base import Listing, Output, Timestamp
from fvs_schema.candidates import (
    AroundCurrent,
    CandidatesRequest,
    CandidateStatus,
    SafetyDistance,
    Zones,
)
from fvs_schema.checks import of_fields, require_different
from fvs_schema.findings import Notice
from fvs_schema.names import VehicleName
from fvs_schema.poses import Pose, PoseFrame, frame_of
from fvs_schema.quantities import WHOLE, Count, Length, Number
from fvs_schema.scenes import Alignment, Origin
from fvs_schema.terrain import AnyTerrain
from fvs_schema.words import Method

_FEW_CANDIDATES = 100


class RankingRequest(CandidatesRequest):
    """Candidates to rank: `candidates`, or those of a `generator`; by default an orbit.

    Lengths are in the unit of the scene's world frame: metres once it is georeferenced.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"generator": {"kind": "orbit", "count": 24}, "top_k": 5},
                {
                    "generator": {
                        "kind": "in-volume",
                        "volume": {
                            "kind": "cylinder",
                            "base": [0.0, 0.0, 5.0],
                            "radius": 30.0,
                            "height": 15.0,
                        },
                        "count": 200,
                    },
                    "safety_m": 2.0,
                    "top_k": 5,
                },
                {
                    "candidates": [
                        {
                            "id": "north",
                            "pose": {
                                "frame": "world",
                                "position": [0.0, 0.0, -3.0],
                                "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
                            },
                        }
                    ],
                    "method": "median-frequency",
                },
            ],
        }
    )

    current_pose: Pose | None = None
    """Where the camera is now; needed for `radius_m` and for `around-current`."""
    radius_m: Length | None = None
    """Exclude candidates that are farther from the current pose."""
    safety_m: SafetyDistance | None = None
    """Minimum distance of candidates from matter, which is what the model shows to be solid. By default half
    of the distance from which the nearest photographs saw that matter."""
    no_fly: Zones = ()
    """Volumes of the world frame that candidates stay out of, at most 20."""
    terrain: AnyTerrain | None = None
    """The ground, under which candidates are `under-ground`, by the datum of the scene's altitudes; where it
    has no height, a warning says so. A ranking keeps no heights."""
    rank_all: bool = False
    """Rank also candidates that are `in-matter`, `too-close`, `no-fly` or `unregistrable`; they keep that
    status."""
    frame: PoseFrame | None = None
    """The frame of the poses in the answer. Defaults to the frame of the candidates, else of the
    current pose, else to geodetic poses in a georeferenced scene and the world frame in others."""
    top_k: Annotated[int, Field(strict=True, ge=1, le=100_000), WHOLE] | None = None
    """Return only the first `top_k` candidates."""
    method: Method = "median-frequency"
    """How candidates are scored; `docs/reference/methods.md` describes the methods."""
    snapshot_id: str | None = None
    """The snapshot to score with; by default the newest state of the model, also during a training."""
    budget: Annotated[int, Field(strict=True, ge=1, le=10_000), WHOLE] = 1
    """Number of images that are still to be taken, for which `kriging` and `uniform` plan."""
    seed: Annotated[int, Field(strict=True, ge=0, le=2**31 - 1), WHOLE] = 0
    """Seed of `random`, and on a GPU of `fisher` and `d-optimal`."""
    for_vehicle: VehicleName | None = None
    """Name of the requesting vehicle, as in its visits: the views that it flies to itself are not `taken` for
    it."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.radius_m is not None and self.current_pose is None:
            raise of_fields("radius_m needs a current_pose to be measured from", "current_pose")
        if isinstance(self.generator, AroundCurrent):
            missing = [name for name in ("current_pose", "radius_m") if getattr(self, name) is None]
            if missing:
                raise of_fields("around-current needs current_pose and radius_m", *missing)
        require_different((candidate.id for candidate in self.candidates or ()), "candidates")
        return self

    @property
    def in_model(self) -> bool:
        """Whether all its poses are given, and come back, in the model frame."""
        poses = (*(candidate.pose for candidate in self.candidates or ()), self.current_pose)
        free = not self.no_fly and self.terrain is None
        given = self.candidates is not None and free and self.frame in (None, "model")
        return given and all(pose is None or frame_of(pose) == "model" for pose in poses)


class ScoredCandidate(Output):
    """One candidate that has been scored, before the ranking is known."""

    id: str
    """The candidate's id."""
    score: Number | None
    """The lowest ranks first; what it means, its unit and its range depend on the method:
    `docs/reference/methods.md`. Null where nothing could be scored."""
    status: CandidateStatus
    """Whether it has a rank and, if not, why."""
    coverage: Number | None
    """The share of the view that the model covers; null when it was not rendered."""
    estimated: bool = False
    """Whether the score was predicted, not measured on a render."""
    distance_m: Number | None
    """Distance from the current pose; null if none was given."""
    pose: Pose
    """Its pose, in the frame of the answer."""


class RankedCandidate(ScoredCandidate):
    """One candidate of a ranking; `rank` is null when it cannot be compared (see `status`)."""

    rank: Count | None
    """Counts from 1, the first to photograph; null when it cannot be compared."""
    chance: Number | None = None
    """The probability that its photograph is registered; null where poses need no registration."""


class Ranking(Output):
    """An immutable ranking, with all that is needed to repeat it."""

    id: str
    """The id, `rnk_…`."""
    scene_id: str
    """The scene."""
    snapshot_id: str
    """The snapshot whose model scored."""
    request: RankingRequest
    """The request, with what was filled in."""
    alignment: Alignment
    """The alignment of the model with the world."""
    origin: Origin | None = None
    """The ENU origin that geodetic poses refer to; null in scenes that are not georeferenced."""
    iterations: Count
    """Training iterations of the model that scored."""
    gaussians: Count
    """The number of Gaussians of the model that scored."""
    fallback: str | None
    """The rule that ordered the candidates when the method could rank none; else null."""
    candidates: tuple[RankedCandidate, ...]
    """The candidates in order: the first should be photographed first."""
    total: Count
    """The number of candidates before `top_k`."""
    seconds: Number
    """Time of scoring."""
    waited_s: Number = 0.0
    """Time in the queue behind other rankings of the same scene."""
    warnings: tuple[Notice, ...] = ()
    """Limits of the use of the ranking."""
    created_at: Timestamp
    """When it was made."""

    @property
    def is_small(self) -> bool:
        """Whether an event loop may serialise it: another thread would take longer, and the loop can wait."""
        return self.total <= _FEW_CANDIDATES  # which the request may list

    @cached_property
    def document(self) -> bytes:
        """The ranking as JSON, made once for the database and the client."""
        return self.model_dump_json().encode()


class RankingSummary(Output):
    """A ranking as it appears in a list."""

    id: str
    """The ranking's id."""
    scene_id: str
    """The scene."""
    snapshot_id: str
    """The snapshot that scored."""
    method: str
    """How candidates were scored."""
    generator: str | None
    """The kind of the generator that made the candidates; null when they were listed."""
    total: Count
    """The number of candidates before `top_k`."""
    best: str | None
    """The id of the candidate that should be photographed first; null when none was ranked."""
    created_at: Timestamp
    """When it was made."""


class RankingList(Listing[RankingSummary]):
    """Rankings of a scene, the newest first."""


class RankingPart(Output):
    """A part of a ranking that is streamed: what has been scored since the part before; last, the ranking."""

    candidates: tuple[ScoredCandidate, ...] = ()
    """Candidates in the order of scoring. When scoring had to begin again, a candidate can come twice."""
    ranking: Ranking | None = None
    """Present only in the last part."""
