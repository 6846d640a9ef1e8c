"""Reports of visits, and visits."""

from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from fvs_schema.base import Input, Output, Timestamp
from fvs_schema.candidates import Candidate
from fvs_schema.checks import require_different, within
from fvs_schema.names import CandidateId, VehicleName
from fvs_schema.poses import Pose
from fvs_schema.quantities import WHOLE
from fvs_schema.words import Word

_MOST_VIEWS = 100


class VisitState(Word):
    """What a vehicle does about a view."""

    GOING_TO = "going-to"
    """It flies there: the view is taken for all other vehicles."""
    TAKEN = "taken"
    """It took the photograph, which may still be on its way: the view is taken for all vehicles."""
    FAILED = "failed"
    """It could not take the photograph: the view is free for the others."""


class VisitReport(Input):
    """What a vehicle does about views; it replaces its earlier reports of the same views.

    A view is the same if its id and its pose are: rankings give the same ids to other poses.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "vehicle": "north-1",
                    "state": "going-to",
                    "views": [
                        {
                            "id": "orbit-7",
                            "pose": {
                                "frame": "world",
                                "position": [0.0, 0.0, -3.0],
                                "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
                            },
                        }
                    ],
                    "expires_in_s": 600.0,
                }
            ]
        }
    )

    vehicle: VehicleName
    """A name that this vehicle keeps, such as its serial number."""
    state: VisitState
    """What the vehicle does about these views."""
    views: Annotated[tuple[Candidate, ...], Field(min_length=1, fail_fast=True), within(_MOST_VIEWS)]
    """Candidates of a ranking or of a plan, at most 100."""
    expires_in_s: Annotated[int, Field(strict=True, ge=1, le=86_400), WHOLE] = 600
    """The report counts for this time, unless it is repeated, so that a lost vehicle blocks no view."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        require_different((view.id for view in self.views), "views")
        return self


class Visit(Output):
    """A view that a vehicle has reported."""

    vehicle: VehicleName
    """The vehicle's name."""
    candidate_id: CandidateId
    """The id of the candidate that the view is."""
    state: VisitState
    """What the vehicle does about it."""
    pose: Pose
    """The view's pose."""
    reported_at: Timestamp
    """When it was reported."""
    expires_at: Timestamp
    """When the report no longer counts."""


class VisitList(Output):
    """The visits of a scene that have not expired, the oldest report first."""

    visits: tuple[Visit, ...]
    """Those that count now."""
