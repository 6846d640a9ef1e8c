"""Rankings: candidates for the next view, and their order."""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from fvs_client.models.base import Answer, Input, ReprArgs, Timestamp, Vector, Word
from fvs_client.models.poses import FramePose, VehiclePose, pose_text
from fvs_client.models.scenes import Alignment, Origin
from fvs_client.models.tables import Table, table_html
from fvs_client.models.volumes import Volume


def _kind_of_pose(value: Any) -> str:
    geodetic = isinstance(value, VehiclePose) or (isinstance(value, dict) and "latitude_deg" in value)
    return "vehicle" if geodetic else "frame"


Pose = Annotated[
    Annotated[FramePose, Tag("frame")] | Annotated[VehiclePose, Tag("vehicle")], Discriminator(_kind_of_pose)
]


PoseFrame = Literal["world", "model", "geodetic"]
"""In which frame a pose is given; geodetic is a `VehiclePose`, the others are a `FramePose`."""


RankingMethod = Literal[
    "median-frequency",
    "median-frequency-fast",
    "median-frequency-estimate",
    "fisher",
    "d-optimal",
    "coverage",
    "spectral-median",
    "kriging",
    "nearest",
    "farthest",
    "uniform",
    "random",
]
"""The methods of ranking; a newer service may have more, which are given as any other string."""


class CandidateStatus(Word):
    """Whether a candidate was ranked, or why not."""

    RANKED = "ranked"
    VISITED = "visited"
    """An image was taken there."""
    TAKEN = "taken"
    """Another vehicle flies there, or a photograph from there is on its way."""
    OUT_OF_RANGE = "out-of-range"
    OUT_OF_MODEL = "out-of-model"
    """The view shows nothing of the model."""
    LOW_COVERAGE = "low-coverage"
    """The model fills too little of the view for a meaningful score."""
    IN_MATTER = "in-matter"
    """The camera would be inside a solid part of the model."""
    TOO_CLOSE = "too-close"
    """Nearer to matter than the safety distance, or than any photograph was: it would see only blur."""
    NO_FLY = "no-fly"
    """In a no-fly zone."""
    UNREGISTRABLE = "unregistrable"
    """It shares so little with the images that its photograph could hardly be registered."""


class Candidate(Input):
    """A view that could be photographed next."""

    id: str
    pose: Pose


class Orbit(Input):
    """Candidates on a circle around the centre of the model, looking at it."""

    kind: Literal["orbit"] = "orbit"
    count: int = 24
    radius_m: float | None = None
    """Radius of the circle; by default the median horizontal distance of the images from the middle."""
    height_m: float | None = None
    """Height above the middle of the model; by default the median height of the images."""
    centre: Vector | None = None


class Grid(Input):
    """Candidates on a level grid above the model, looking straight down or at its centre."""

    kind: Literal["grid"] = "grid"
    columns: int = 6
    rows: int = 6
    height_m: float | None = None
    look: Literal["centre", "down"] = "centre"


class Dataset(Input):
    """Candidates halfway between neighbouring images."""

    kind: Literal["dataset"] = "dataset"


class AroundCurrent(Input):
    """Candidates spread evenly in the ball of `radius_m` around the current pose, looking at the model."""

    kind: Literal["around-current"] = "around-current"
    count: int = 32


class InVolume(Input):
    """Candidates spread evenly over a volume, clear of matter, that have some of it in their frame."""

    kind: Literal["in-volume"] = "in-volume"
    volume: Volume
    count: int = 300
    look: Literal["middle", "nearest"] = "middle"
    """What they look at: the middle of the model, or for each the part of it that is nearest."""
    aim: Vector | None = None
    """A point to look at, instead of what `look` names."""
    level: bool = False
    """Whether they look there with a level camera: in that direction, but not up or down."""


Generator = Annotated[Orbit | Grid | Dataset | AroundCurrent | InVolume, Field(discriminator="kind")]


class RankingRequest(Input):
    """Settings of a ranking. Lengths are in units of the scene's world: metres when georeferenced."""

    candidates: tuple[Candidate, ...] | None = None
    generator: Generator | None = None
    current_pose: Pose | None = None
    radius_m: float | None = None
    safety_m: float | None = None
    """Least distance from matter; by default half of that from which the nearest photographs saw it."""
    no_fly: tuple[Volume, ...] | None = None
    """Volumes that candidates stay out of, at most 20."""
    rank_all: bool = False
    """Rank candidates also where something is against them (see the statuses)."""
    frame: PoseFrame | None = None
    top_k: int | None = None
    method: str = "median-frequency"
    snapshot_id: str | None = None
    budget: int = 1
    seed: int = 0
    for_vehicle: str | None = None


class ScoredCandidate(Answer):
    """A candidate that has been scored, before the ranking is known."""

    id: str
    score: float | None
    """The lowest ranks first; what it means, its unit and its range depend on the method:
    `docs/reference/methods.md`. None where nothing could be scored."""
    status: CandidateStatus
    coverage: float | None
    """Share of the view that the model fills; None when the view was not rendered."""
    estimated: bool = False
    """Whether the score was predicted, not measured on a render."""
    distance_m: float | None
    """Distance from the current pose; None without one."""
    pose: Pose
    """Pose in the frame of the ranking's poses."""


class RankedCandidate(ScoredCandidate):
    """A candidate of a ranking; `rank` is None for candidates that were not ranked (see `status`)."""

    rank: int | None
    chance: float | None = None
    """Probability that its photograph is registered; None where poses need no registration."""


class RankingWarning(Answer):
    """What limits the use of a ranking, and the remedy."""

    code: str
    """`ill-conditioned`: the world frame may be turned about the line of the photographs.
    `fewer-candidates`: the generator made fewer than requested: the volume has no room for more.
    `few-registrable`: hardly any candidate sees enough of what the images show to be registered.
    `none-feasible`: all candidates are in matter, too close to it, or unlikely to be registered.
    `positions-unused`: the images' positions contradict the model, so the world frame is the model's.
    Of plans only: `vehicle-grounded`: a vehicle gets no tour, because it cannot fly to any candidate;
    `too-close`: some candidates are inside matter or too close to it, and not planned;
    `unreachable`: no way leads to some candidates; `same-pose`: some have the pose of another;
    `nothing-in-view`: no planned view shows anything of the model."""
    message: str
    hint: str


class RankingSummary(Answer):
    """What a list tells of a ranking."""

    id: str
    scene_id: str
    snapshot_id: str
    method: str
    generator: str | None
    """The kind of the generator that made the candidates; None when they were listed."""
    total: int
    """Number of candidates before `top_k`."""
    best: str | None
    """Id of the first candidate; None when none was ranked."""
    created_at: Timestamp


class RankingData(Answer):
    """An immutable ranking, with the inputs to repeat it."""

    id: str
    scene_id: str
    snapshot_id: str
    request: RankingRequest
    alignment: Alignment
    """The alignment of the model with the world."""
    origin: Origin | None = None
    """The ENU origin that geodetic poses refer to; None in scenes that are not georeferenced."""
    iterations: int
    """Training iterations of the snapshot."""
    gaussians: int
    fallback: str | None
    """The rule that ranked instead of the method; None when the method could."""
    candidates: tuple[RankedCandidate, ...]
    """The candidates in order, the next view first."""
    total: int
    """Number of candidates before `top_k`."""
    seconds: float
    """Time that scoring took."""
    waited_s: float = 0.0
    """Time spent waiting for other rankings of the scene."""
    warnings: tuple[RankingWarning, ...] = ()
    """Limits of the use of the ranking."""
    created_at: Timestamp

    @property
    def best(self) -> RankedCandidate | None:
        """The first ranked candidate; None when none was ranked."""
        return next((candidate for candidate in self.candidates if candidate.rank is not None), None)

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("snapshot_id", self.snapshot_id))
        yield from (("method", self.request.method), ("candidates", len(self.candidates)))
        yield "best", None if self.best is None else self.best.id

    def _repr_html_(self) -> str:
        notes = [made_by(self), *(f"{one.message} {one.hint}" for one in self.warnings)]
        return table_html(ranking_table(self), f"Ranking {self.id}", notes)


def ranking_table(ranking: RankingData) -> Table:
    """The candidates of a ranking, as text."""
    distance = ranking.alignment.with_unit("distance")
    return Table(
        ("rank", "id", "score", "coverage", "chance", distance, "status", "pose"),
        tuple(
            (
                "" if item.rank is None else str(item.rank),
                item.id,
                "" if item.score is None else f"{'≈ ' * item.estimated}{item.score:.4g}",
                "" if item.coverage is None else f"{item.coverage:.0%}",
                "" if item.chance is None else f"{item.chance:.0%}",
                "" if item.distance_m is None else f"{item.distance_m:.2f}",
                item.status.value,
                pose_text(item.pose),
            )
            for item in ranking.candidates
        ),
        frozenset(("rank", "score", "coverage", "chance", distance)),
    )


def made_by(ranking: RankingData) -> str:
    """How a ranking was made, and what it leaves out, in a line."""
    more = ranking.total - len(ranking.candidates)
    rest = f"{more} more; " if more > 0 else ""
    fallback = f"; ranked by {ranking.fallback}, because the method could not" if ranking.fallback else ""
    return (
        f"{rest}by {ranking.request.method} on {ranking.snapshot_id}, {ranking.gaussians:,} Gaussians after "
        f"{ranking.iterations:,} iterations, in {ranking.seconds:.2f} s{fallback}"
    )
