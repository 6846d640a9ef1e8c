"""Records of a selection's steps."""

from typing import Literal

from fvs_engine.candidates import RankedCandidate
from fvs_engine.geometry.alignment.dataset import DatasetAlignment
from fvs_engine.plan.plan_records import Outlook
from fvs_engine.records import Record
from fvs_schema.findings import Finding


class AlignmentRecord(Record):
    """The alignment of the dataset with the model, see ``DatasetAlignment``.

    ``scale``: model units per unit of the dataset.
    """

    source: Literal["known", "centres", "attitudes"]
    scale: float
    rms: float
    attitude_deg: float
    views: int
    inliers: int

    @classmethod
    def of(cls, alignment: DatasetAlignment) -> "AlignmentRecord":
        """The record of an alignment."""
        return cls(
            source=alignment.source,
            scale=alignment.model_from_world.scale,
            rms=alignment.rms,
            attitude_deg=alignment.attitude_deg,
            views=alignment.views,
            inliers=alignment.inliers,
        )


class Choice(Record):
    """The choice of one step; ``step`` counts from 1.

    ``ranked`` holds every candidate in reach, the best first; ``fallback`` names the rule that chose the view
    where no candidate could be ranked. ``distance``: how far the camera flies to it; ``travel``: the path of
    all vehicles through all visited views up to it; both in the dataset's unit. ``vehicle`` is the one that
    flies there, and those that have ``landed`` fly no more, by their numbers from 1. ``seconds``: wall time
    of aligning, rendering and scoring.

    ``outlook``: what was to be expected before the visit. ``variance``: the kriging variance of the chosen
    pose then. ``before_db``: the PSNR of its photograph, rendered by the model that had not seen it; None
    until it was taken, and where it could not be registered.
    """

    step: int
    method: str
    chosen: str
    score: float | None
    ranked: tuple[RankedCandidate, ...]
    fallback: str | None
    distance: float
    travel: float
    alignment: AlignmentRecord
    seconds: float
    outlook: Outlook
    variance: float
    before_db: float | None = None
    vehicle: int = 1
    landed: tuple[int, ...] = ()


class StepSeconds(Record):
    """Wall time of a step's parts: choosing, registering the image, training the quick model."""

    score: float
    add: float
    train: float

    @property
    def total(self) -> float:
        """All parts."""
        return self.score + self.add + self.train


class StepRecord(Record):
    """One step of the loop: the choice and its outcome.

    ``views`` were visited, the chosen one included; of them ``registered`` are in the model and
    ``unregistered`` are not. ``iterations`` and ``gaussians`` are those of the quick model. ``warnings`` are
    about this view.
    """

    choice: Choice
    views: int
    registered: int
    unregistered: int
    iterations: int
    gaussians: int
    warnings: tuple[Finding, ...]
    seconds: StepSeconds

    @property
    def chosen(self) -> str:
        """The view that was visited."""
        return self.choice.chosen

    @property
    def travel(self) -> float:
        """The length of the path through all visited views, in the dataset's unit."""
        return self.choice.travel

    @property
    def alignment(self) -> AlignmentRecord:
        """The alignment that took the candidates into the model frame."""
        return self.choice.alignment


class StopReason(Record):
    """Why a selection ended: ``kind`` for programs, ``message`` for people."""

    kind: Literal["budget", "time-limit", "nothing-in-reach", "travel", "quality", "gain"]
    message: str
