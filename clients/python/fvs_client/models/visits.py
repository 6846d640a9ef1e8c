"""Visits: reports of vehicles about views."""

from datetime import datetime

from fvs_client.models.base import Answer, Input, Word
from fvs_client.models.rankings import Candidate, Pose


class VisitState(Word):
    """The state of a vehicle's visit of a view."""

    GOING_TO = "going-to"
    """It flies there: the view is taken for all other vehicles."""
    TAKEN = "taken"
    """It took the photograph, which may still be on its way: the view is taken for all vehicles."""
    FAILED = "failed"
    """It could not take the photograph: the view is free for the others."""


class VisitReport(Input):
    """What a vehicle does about views; it replaces its earlier reports of candidates with the same ids."""

    vehicle: str
    state: VisitState
    views: tuple[Candidate, ...]
    expires_in_s: int = 600


class Visit(Answer):
    """A view that a vehicle has reported."""

    vehicle: str
    candidate_id: str
    state: VisitState
    pose: Pose
    reported_at: datetime
    expires_at: datetime


class VisitList(Answer):
    """The visits of a scene that have not expired, the oldest report first."""

    visits: tuple[Visit, ...]
