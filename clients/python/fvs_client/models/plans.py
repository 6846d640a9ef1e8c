"""Plans."""

from collections.abc import Iterator, Mapping

from fvs_client.models.display import ReprArgs, Table, pose_text, table_html, with_unit
from fvs_schema.plans import Expectation, Plan, Stop, Tour


class PlanData(Plan):
    """An immutable plan, with the inputs to repeat it."""

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


def plan_table(plan: PlanData) -> Table:
    """The stops of a plan, as text, and where vehicles pass on the way."""
    chances = {terms.id: terms.chance for terms in plan.candidates}
    distance, travel = (with_unit(what, plan.alignment) for what in ("distance", "travel"))
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
