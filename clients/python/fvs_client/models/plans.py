"""Plans: which candidates to photograph next, in which order, and what they bring."""

from collections.abc import Iterator, Mapping

from pydantic import Field

from fvs_client.models.base import Answer, Input, ReprArgs, Timestamp
from fvs_client.models.poses import pose_text
from fvs_client.models.rankings import Candidate, Generator, Pose, PoseFrame, RankingWarning
from fvs_client.models.scenes import Alignment, Origin
from fvs_client.models.tables import Table, table_html
from fvs_client.models.volumes import Volume


class PlanRequest(Input):
    """Settings of a plan. Lengths are in units of the scene's world: metres when georeferenced."""

    candidates: tuple[Candidate, ...] | None = None
    generator: Generator | None = None
    targets: tuple[Candidate, ...] | None = None
    views: int = 10
    distance_m: float | None = None
    home: bool = False
    safety_m: float | None = None
    """Keep so far from matter, also on the way. With it, `no_fly` or a volume, legs go around what is in the
    way."""
    no_fly: tuple[Volume, ...] | None = None
    """Volumes to stay out of, at most 20."""
    vehicles: tuple[Pose, ...] | None = None
    for_vehicle: str | None = None
    frame: PoseFrame | None = None
    snapshot_id: str | None = None


class Expectation(Answer):
    """How well the targets are known, and the PSNR to expect of their renders."""

    variance: float
    """Mean kriging variance of the targets: 1 where no image is near, towards 0 among many."""
    psnr_db: float | None
    """Expected mean PSNR; None until three updates have measured their new images."""
    low_db: float | None
    """With `high_db`: an interval that holds the mean PSNR in four of five cases."""
    high_db: float | None


class Stop(Answer):
    """A candidate to photograph; `distance_m` is the way from the stop before, `travel_m` from the start."""

    id: str
    pose: Pose
    """Pose in the frame of the plan's poses."""
    distance_m: float
    travel_m: float
    after: Expectation
    """What to expect once this stop and all earlier ones, those of other vehicles included, have been
    photographed."""
    via: tuple[Pose, ...] = ()
    """Where to pass on the way to it, in order, where something is in the straight line."""


class Tour(Answer):
    """The flight of one vehicle, which is the `vehicle`-th of the request, from 0."""

    vehicle: int
    stops: tuple[Stop, ...]
    length_m: float
    """Length of the flight, home included if requested."""
    via_home: tuple[Pose, ...] = ()
    """Where to pass on the way home, as `via` of a stop."""


class CandidateTerms(Answer):
    """Why a candidate is, or is not, in the plan."""

    id: str
    planned: bool
    gain: float
    """By how much it alone would lower the mean variance of the targets."""
    gain_in_plan: float
    """By how much it lowers the mean variance beside all other planned candidates."""
    variance: float
    """Kriging variance of its own pose."""
    distance_m: float | None
    """Length of the way from the nearest vehicle; None where none leads there."""
    chance: float | None
    """Probability that its photograph can be registered now."""
    helps: tuple[str, ...] = Field(default=())
    """The targets that it helps most: ids of targets and candidates, and digests of images."""
    coverage: float | None = None
    """The share of the view that the model covers, estimated; None beyond the first 100 candidates."""
    median_frequency: float | None = None
    """Its median frequency, estimated: lower means that the model represents it less well. None where nothing
    is in view, and beyond the first 100 candidates."""


class PlanData(Answer):
    """An immutable plan, with the inputs to repeat it."""

    id: str
    scene_id: str
    snapshot_id: str
    request: PlanRequest
    summary: str
    """The plan in a sentence."""
    now: Expectation
    end: Expectation
    tours: tuple[Tour, ...]
    """One for each vehicle, in their order; a vehicle that is not needed, or cannot fly, has no stops."""
    candidates: tuple[CandidateTerms, ...]
    """The planned ones, and others in the order of what they would add; at most 200."""
    photographed: tuple[str, ...] = ()
    """Ids of candidates that were left out because an image was taken there."""
    alignment: Alignment
    """The alignment of the model with the world."""
    origin: Origin | None = None
    """The ENU origin that geodetic poses refer to; None in scenes that are not georeferenced."""
    warnings: tuple[RankingWarning, ...] = ()
    """Limits of the use of the plan."""
    created_at: Timestamp

    @property
    def stops(self) -> tuple[Stop, ...]:
        """All stops, in the order of travel."""
        stops = (stop for tour in self.tours for stop in tour.stops)
        return tuple(sorted(stops, key=lambda stop: stop.travel_m))

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("snapshot_id", self.snapshot_id))
        yield from (("stops", [stop.id for stop in self.stops]), ("summary", self.summary))

    def _repr_html_(self) -> str:
        notes = [self.summary, *(f"{one.message} {one.hint}" for one in self.warnings)]
        return table_html(plan_table(self), f"Plan on {self.snapshot_id}", notes)


class PlanSummary(Answer):
    """What a list tells of a plan."""

    id: str
    scene_id: str
    snapshot_id: str
    summary: str
    """The plan in a sentence."""
    created_at: Timestamp


def plan_table(plan: PlanData) -> Table:
    """The stops of a plan, as text, and where vehicles pass on the way."""
    chances = {terms.id: terms.chance for terms in plan.candidates}
    distance, travel = (plan.alignment.with_unit(what) for what in ("distance", "travel"))
    return Table(
        ("vehicle", "stop", "id", distance, travel, "registered", "expected", "pose"),
        tuple(row for tour in plan.tours for row in _rows(tour, chances)),
        frozenset(("vehicle", "stop", distance, travel, "registered", "expected")),
    )


def _rows(tour: Tour, chances: Mapping[str, float | None]) -> Iterator[tuple[str, ...]]:
    """A row for each stop of a tour, after one for each way point that leads there."""
    vehicle = str(tour.vehicle)
    for number, stop in enumerate(tour.stops, start=1):
        yield from ((vehicle, "", "via", "", "", "", "", pose_text(pose)) for pose in stop.via)
        yield (
            vehicle,
            str(number),
            stop.id,
            f"{stop.distance_m:.2f}",
            f"{stop.travel_m:.2f}",
            "" if (chance := chances.get(stop.id)) is None else f"{chance:.0%}",
            _expected(stop.after),
            pose_text(stop.pose),
        )
    yield from ((vehicle, "", "via, home", "", "", "", "", pose_text(pose)) for pose in tour.via_home)


def _expected(expectation: Expectation) -> str:
    if expectation.psnr_db is None:
        return f"variance {expectation.variance:.3f}"
    return f"{expectation.psnr_db:.1f} dB"
