"""Rankings: the question which pose should be photographed next, and its answer."""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from fvs_client.models.base import Answer, Input, Timestamp, Vector, Word
from fvs_client.models.poses import FramePose, VehiclePose
from fvs_client.models.scenes import Alignment


def _kind_of_pose(value: Any) -> str:
    geodetic = isinstance(value, VehiclePose) or (isinstance(value, dict) and "latitude_deg" in value)
    return "vehicle" if geodetic else "frame"


Pose = Annotated[
    Annotated[FramePose, Tag("frame")] | Annotated[VehiclePose, Tag("vehicle")], Discriminator(_kind_of_pose)
]


class CandidateStatus(Word):
    """Whether a candidate takes part."""

    RANKED = "ranked"
    VISITED = "visited"
    """An image was taken there already."""
    OUT_OF_RANGE = "out-of-range"
    OUT_OF_MODEL = "out-of-model"
    """Nothing of the model is in view."""
    LOW_COVERAGE = "low-coverage"
    """The model fills so little of the view that its score describes the void around it."""


class Candidate(Input):
    """A pose that could be photographed next."""

    id: str
    pose: Pose


class Orbit(Input):
    """Poses on a circle around the middle of the model, looking at it."""

    kind: Literal["orbit"] = "orbit"
    count: int = 24
    radius_m: float | None = None
    """By default as far away as the images were taken."""
    height_m: float | None = None
    """Above the middle of the model; by default as high as the images were taken."""
    centre: Vector | None = None


class Grid(Input):
    """Poses on a level grid above the model, looking straight down or at its middle."""

    kind: Literal["grid"] = "grid"
    columns: int = 6
    rows: int = 6
    height_m: float | None = None
    look: Literal["centre", "down"] = "centre"


class Dataset(Input):
    """Poses halfway between neighbouring images."""

    kind: Literal["dataset"] = "dataset"


class AroundCurrent(Input):
    """Poses spread evenly in the ball of `radius_m` around the current pose, looking at the model."""

    kind: Literal["around-current"] = "around-current"
    count: int = 32


Generator = Annotated[Orbit | Grid | Dataset | AroundCurrent, Field(discriminator="kind")]


class RankingRequest(Input):
    """The question. Lengths are in the unit of the scene's world: metres once it is georeferenced."""

    candidates: tuple[Candidate, ...] | None = None
    generator: Generator | None = None
    current_pose: Pose | None = None
    radius_m: float | None = None
    top_k: int | None = None
    method: str = "median-frequency"
    snapshot_id: str | None = None
    budget: int = 1
    seed: int = 0


class RankedCandidate(Answer):
    """One candidate's place; `rank` is None for what cannot be compared (see `status`)."""

    id: str
    rank: int | None
    score: float | None
    """The lower, the less is known of what the view shows."""
    status: CandidateStatus
    coverage: float | None
    """The share of the view that the model fills; None when it was not rendered."""
    distance_m: float | None
    """From the current pose; None without one."""
    pose: FramePose


class RankingData(Answer):
    """An immutable answer, with all that is needed to ask the same again."""

    id: str
    scene_id: str
    snapshot_id: str
    request: RankingRequest
    alignment: Alignment
    iterations: int
    """How long the model had been trained."""
    gaussians: int
    fallback: str | None
    """The rule that chose when the method could not."""
    candidates: tuple[RankedCandidate, ...]
    """The first to be photographed first."""
    total: int
    """How many candidates there were before `top_k`."""
    seconds: float
    """What scoring took."""
    waited_s: float = 0.0
    """How long other questions about the same scene went before."""
    created_at: Timestamp

    @property
    def best(self) -> RankedCandidate | None:
        """The candidate to photograph next; None when nothing can be compared."""
        return next((candidate for candidate in self.candidates if candidate.rank is not None), None)
