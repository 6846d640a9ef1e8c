"""What a selection writes down about each of its steps."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

from fvs_engine.score.interface import CandidateStatus


class _Record(BaseModel):
    """Immutable; unknown fields and non-finite numbers are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class RankedRecord(_Record):
    """One candidate's place; ``distance`` from the current camera centre in the dataset's unit."""

    rank: int | None
    id: str
    score: float | None
    status: CandidateStatus
    coverage: float
    distance: float


class AlignmentRecord(_Record):
    """How the dataset's frame was taken into the model's: ``model_from_world``.

    ``source``: ``known`` when they are one frame; ``centres`` when the visited cameras' centres fixed the
    similarity; ``attitudes`` when they stand on a line, and the cameras' attitudes fixed its rotation.
    ``scale``: model units per unit of the dataset. ``rms``: of the inliers' centres, in the dataset's unit.
    ``attitude_deg``: median angle between the attitudes that the dataset and the model give a view.
    """

    source: Literal["known", "centres", "attitudes"]
    scale: float
    rms: float
    attitude_deg: float
    views: int
    inliers: int


class StepSeconds(_Record):
    """Wall time of a step's parts; ``train`` and ``add`` are those that the chosen image cost."""

    score: float
    add: float
    train: float
    save: float

    @property
    def total(self) -> float:
        """All parts."""
        return self.score + self.add + self.train + self.save


class StepRecord(_Record):
    """One turn of the loop: what was chosen and why, and what became of it.

    ``step`` counts from 1; ``views`` are the visited ones, the chosen included. ``ranked`` holds every
    candidate in reach, the first choice first; ``fallback`` says why the choice is not the ranking's first.
    ``distance`` is how far the camera flew to it, ``travel`` the way through all visited views so far, both
    in the dataset's unit. ``registered`` of the visited views are in the model, ``waiting`` are not yet.
    """

    step: int
    method: str
    chosen: str
    score: float | None
    ranked: tuple[RankedRecord, ...]
    fallback: str | None
    distance: float
    travel: float
    alignment: AlignmentRecord
    views: int
    registered: int
    waiting: int
    iterations: int
    gaussians: int
    seconds: StepSeconds


class StopReason(_Record):
    """Why a selection ended: ``kind`` for programs, ``message`` for people."""

    kind: Literal["budget", "time-limit", "nothing-in-reach"]
    message: str
