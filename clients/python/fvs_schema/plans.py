"""Requests for plans, and plans."""

from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from fvs_schema.base import Listing, Output, Timestamp
from fvs_schema.candidates import (
    Candidates,
    CandidatesRequest,
    InVolume,
    PlanGenerator,
    SafetyDistance,
    Zones,
)
from fvs_schema.checks import require_different, within
from fvs_schema.findings import Notice
from fvs_schema.names import VehicleName
from fvs_schema.poses import Pose, PoseFrame, frame_of
from fvs_schema.quantities import WHOLE, Count, Length, Number
from fvs_schema.scenes import Alignment, Origin
from fvs_schema.terrain import AnyTerrain

_MOST_VEHICLES = 20

_Vehicles = Annotated[tuple[Pose, ...], Field(min_length=1, fail_fast=True), within(_MOST_VEHICLES)]


class PlanRequest(CandidatesRequest):
    """Candidates to plan with: `candidates`, or those of a `generator`; by default an orbit.

    Lengths are in the unit of the scene's world frame: metres once it is georeferenced.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"generator": {"kind": "orbit", "count": 48}, "views": 8},
                {
                    "generator": {"kind": "grid", "columns": 10, "rows": 10, "height_m": 4.0},
                    "views": 20,
                    "distance_m": 120.0,
                    "home": True,
                },
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
                    "no_fly": [{"kind": "box", "centre": [10.0, 0.0, 5.0], "size": [4.0, 4.0, 30.0]}],
                },
            ],
        }
    )

    generator: PlanGenerator | None = None
    """A rule that makes the candidates; either this or `candidates`."""
    targets: Candidates | None = None
    """Poses that the model must serve well; by default those of the registered images and the candidates."""
    views: Annotated[int, Field(strict=True, ge=1, le=100), WHOLE] = 10
    """Maximum number of photographs, of all vehicles together."""
    distance_m: Length | None = None
    """Maximum distance that each vehicle flies; without it there is no limit."""
    home: bool = False
    """Whether each vehicle flies back to where it is now; the way back counts towards `distance_m`."""
    safety_m: SafetyDistance | None = None
    """Minimum distance from matter, which is what the model shows to be solid, at the stops and on the way.
    With `safety_m`, `no_fly` or a volume the way goes around obstacles; otherwise it is straight."""
    no_fly: Zones = ()
    """Volumes of the world frame to stay out of, at most 20."""
    terrain: AnyTerrain | None = None
    """The ground, as in a ranking: candidates under it are not planned. A plan keeps no heights."""
    vehicles: _Vehicles | None = None
    """Where the vehicles are; by default one vehicle at the last registered image."""
    for_vehicle: VehicleName | None = None
    """The requesting vehicle, as in a ranking."""
    frame: PoseFrame | None = None
    """The frame of the poses in the answer; by default as in a ranking."""
    snapshot_id: str | None = None
    """The snapshot to plan for; by default the newest."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        require_different((pose.id for pose in self.candidates or ()), "candidates")
        require_different((pose.id for pose in self.targets or ()), "targets")
        return self

    @property
    def in_model(self) -> bool:
        """Whether all its poses are given, and come back, in the model frame."""
        given = [item.pose for item in (*(self.candidates or ()), *(self.targets or ()))]
        poses = (*given, *(self.vehicles or ()))
        in_model = all(frame_of(pose) == "model" for pose in poses)
        given_all = self.candidates is not None and not self.no_fly and self.terrain is None
        return given_all and self.frame in (None, "model") and in_model

    @property
    def around(self) -> bool:
        """Whether legs go around what is in the way."""
        return isinstance(self.generator, InVolume) or self.safety_m is not None or bool(self.no_fly)


class Expectation(Output):
    """The variance of the targets, and the PSNR to expect of their renders."""

    variance: Number
    """The mean kriging variance of the targets, which says how little is known of them: 1 where no image is
    near, close to 0 among many images."""
    psnr_db: Number | None
    """The expected mean PSNR; null until three updates have measured their new images."""
    low_db: Number | None
    """With `high_db`: an interval that holds the mean PSNR in four of five cases."""
    high_db: Number | None
    """The upper end of that interval."""


class Stop(Output):
    """A candidate to photograph; `distance_m` is the way from the stop before, `travel_m` from the start."""

    id: str
    """The candidate's id."""
    pose: Pose
    """Where its camera is, and where that looks."""
    distance_m: Number
    """The length of the way from the stop before, or from where the vehicle is."""
    travel_m: Number
    """The length of the whole way so far."""
    after: Expectation
    """What to expect once this stop and all earlier ones, those of other vehicles included, have been
    photographed."""
    via: tuple[Pose, ...] = ()
    """Poses to pass on the way to it, in order, when something is in the straight line; they have the
    orientation of the stop."""


class Tour(Output):
    """The flight of one vehicle, which is the `vehicle`-th of the request, from 1."""

    vehicle: Count
    """The number of the vehicle, from 1."""
    stops: tuple[Stop, ...]
    """The candidates to photograph, in order."""
    length_m: Number
    """The length of the flight, home included if requested."""
    via_home: tuple[Pose, ...] = ()
    """Poses to pass on the way home, as in `via` of a stop; they have the orientation of the last stop."""


class CandidateTerms(Output):
    """Why a candidate is, or is not, in the plan."""

    id: str
    """The candidate's id."""
    planned: bool
    """Whether it is in the plan."""
    gain: Number
    """By how much it alone would lower the mean variance of the targets."""
    gain_in_plan: Number
    """By how much it lowers the mean variance beside all other planned candidates."""
    variance: Number
    """The kriging variance of its own pose."""
    distance_m: Number | None
    """The length of the way from the nearest vehicle; null where none leads there."""
    chance: Number | None
    """The probability that its photograph can be registered now."""
    helps: tuple[str, ...]
    """The targets that it helps most: ids of targets and candidates, and digests of images."""
    coverage: Number | None = None
    """The share of the view that the model covers, estimated; null beyond the first 100 candidates."""
    median_frequency: Number | None = None
    """Its median frequency, estimated: lower means that the model represents it less well. Null where nothing
    is in view, and beyond the first 100 candidates."""


class Plan(Output):
    """An immutable plan, with all that is needed to repeat it."""

    id: str
    """The plan's id."""
    scene_id: str
    """The scene."""
    snapshot_id: str
    """The snapshot that it was planned for."""
    request: PlanRequest
    """What was asked for, with the defaults."""
    summary: str
    """The plan in a sentence."""
    now: Expectation
    """What to expect of the model as it is."""
    end: Expectation
    """What to expect once all stops were photographed."""
    tours: tuple[Tour, ...]
    """One for each vehicle, in their order; a vehicle that is not needed, or cannot fly, has no stops."""
    candidates: tuple[CandidateTerms, ...]
    """The planned ones, and others in the order of what they would add; at most 200."""
    photographed: tuple[str, ...]
    """Ids of candidates that were left out because an image was taken there."""
    alignment: Alignment
    """The alignment of the model with the world."""
    origin: Origin | None = None
    """The ENU origin that geodetic poses refer to; null in scenes that are not georeferenced."""
    warnings: tuple[Notice, ...] = ()
    """Limits of the use of the plan."""
    created_at: Timestamp
    """When it was made."""


class PlanSummary(Output):
    """A plan as it appears in a list."""

    id: str
    """The plan's id."""
    scene_id: str
    """The scene."""
    snapshot_id: str
    """The snapshot that it was planned for."""
    summary: str
    """The plan in a sentence."""
    created_at: Timestamp
    """When it was made."""


class PlanList(Listing[PlanSummary]):
    """Plans of a scene, the newest first."""
