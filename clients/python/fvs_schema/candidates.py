"""Candidates for the next view: poses, what makes them, and what became of them."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from fvs_schema.base import Input
from fvs_schema.checks import of_fields, within
from fvs_schema.names import CandidateId
from fvs_schema.poses import Pose
from fvs_schema.quantities import MAX_COORDINATE_M, WHOLE, Coordinate, Length, Number, Vector
from fvs_schema.volumes import Volume
from fvs_schema.words import Word

_PoseCount = Annotated[int, Field(strict=True, ge=1, le=2_000), WHOLE]
_MOST_ZONES = 20


class CandidateStatus(Word):
    """Whether a candidate has a rank and, if not, why."""

    RANKED = "ranked"
    VISITED = "visited"
    """An image was taken from this pose already."""
    TAKEN = "taken"
    """Another vehicle flies there, or a photograph from there is on its way."""
    OUT_OF_RANGE = "out-of-range"
    """Farther from the current pose than the radius."""
    OUT_OF_MODEL = "out-of-model"
    """Nothing of the model is in view."""
    LOW_COVERAGE = "low-coverage"
    """The model fills so little of the view that the score describes mostly the empty background."""
    IN_MATTER = "in-matter"
    """The camera would be inside a solid part of the model."""
    TOO_CLOSE = "too-close"
    """Nearer to matter than the safety distance, or than any photograph was: it would see only blur."""
    NO_FLY = "no-fly"
    """In a no-fly zone."""
    UNDER_GROUND = "under-ground"
    """Under the terrain of the request."""
    UNREGISTRABLE = "unregistrable"
    """It shares so little with the images that its photograph could hardly be registered."""


class Candidate(Input):
    """A pose that could be photographed next."""

    id: CandidateId
    """A name of your own for it, which the answer repeats."""
    pose: Pose
    """Where its camera is, and where that looks."""


class Orbit(Input):
    """Poses on a circle around the middle of the model, looking at it."""

    kind: Literal["orbit"] = "orbit"
    """The generator's name."""
    count: _PoseCount = 24
    """How many poses."""
    radius_m: Length | None = None
    """Radius of the circle; by default the median horizontal distance of the images from the middle."""
    height_m: Coordinate | None = None
    """Height above the middle of the model; by default the median height of the images."""
    centre: Vector | None = None
    """Middle of the circle, in the world frame; by default the middle of the model."""


class Grid(Input):
    """Poses on a level grid above the model, looking straight down or at its middle."""

    kind: Literal["grid"] = "grid"
    """The generator's name."""
    columns: Annotated[int, Field(strict=True, ge=1, le=100), WHOLE] = 6
    """How many poses along the grid's first side."""
    rows: Annotated[int, Field(strict=True, ge=1, le=100), WHOLE] = 6
    """How many poses along its second side."""
    height_m: Coordinate | None = None
    """Height above the middle of the model; by default that of the highest image."""
    margin_m: Annotated[Number, Field(ge=0, le=MAX_COORDINATE_M)] = 0.0
    """Margin of the grid around the model's points, on each side."""
    look: Literal["centre", "down"] = "centre"
    """Straight down, or at the middle of the model."""


class Dataset(Input):
    """Poses halfway between neighbouring images."""

    kind: Literal["dataset"] = "dataset"
    """The generator's name."""


class AroundCurrent(Input):
    """Poses spread evenly in the ball of `radius_m` around the current pose, looking at the model."""

    kind: Literal["around-current"] = "around-current"
    """The generator's name."""
    count: _PoseCount = 32
    """How many poses."""


class InVolume(Input):
    """Poses spread evenly over a volume, clear of the model's matter, that have some of it in their frame.

    Coordinates and lengths are those of the world frame.
    """

    kind: Literal["in-volume"] = "in-volume"
    """The generator's name."""
    volume: Volume
    """Where they are."""
    count: _PoseCount = 300
    """How many poses, at most."""
    look: Literal["middle", "nearest"] = "middle"
    """What they look at: the middle of the model, or for each the part of it that is nearest."""
    aim: Vector | None = None
    """A point to look at, instead of what `look` names."""
    level: bool = False
    """Whether they look there with a level camera: in that direction, but not up or down."""

    @model_validator(mode="after")
    def _one_aim(self) -> Self:
        if self.aim is not None and self.look != "middle":
            raise of_fields("give either an aim or where to look, not both", "aim", "look")
        return self


def wanted_of(generator: "Generator | None") -> int | None:
    """The number of candidates that a generator is asked for and may not find; None without one."""
    return generator.count if isinstance(generator, InVolume) else None


Candidates = Annotated[
    tuple[Candidate, ...], Field(min_length=1, fail_fast=True), within("candidates_per_ranking")
]
Generator = Annotated[Orbit | Grid | Dataset | AroundCurrent | InVolume, Field(discriminator="kind")]
PlanGenerator = Annotated[Orbit | Grid | Dataset | InVolume, Field(discriminator="kind")]
"""Generators that need no current pose."""
SafetyDistance = Annotated[Number, Field(ge=0, le=MAX_COORDINATE_M)]
Zones = Annotated[tuple[Volume, ...], Field(fail_fast=True), within(_MOST_ZONES)]


class CandidatesRequest(Input):
    """Base of requests with candidates: `candidates`, or those of a `generator`; by default an orbit."""

    candidates: Candidates | None = None
    """The poses to consider; either these or a `generator`."""
    generator: Generator | None = None
    """A rule that makes the candidates; either this or `candidates`."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if self.candidates is not None and self.generator is not None:
            raise of_fields("give either candidates or a generator, not both", "candidates", "generator")
        return self

    @property
    def complete(self) -> Self:
        """The same request with a generator, where it has neither that nor candidates."""
        if self.candidates is None and self.generator is None:
            return self.model_copy(update={"generator": Orbit()})
        return self
