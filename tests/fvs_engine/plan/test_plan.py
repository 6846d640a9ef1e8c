"""Missions: what is said of a plan."""

import numpy as np
import pytest

from fvs_engine.errors import Cancelled, InvalidInputError
from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.monitor import Monitor
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.flight import FreeLegs, free_legs
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.plan import make_plan
from fvs_engine.plan.plan_records import Plan
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget
from fvs_engine.plan.volumes import Box, Cylinder
from fvs_engine.views import PinholeView
from fvs_engine.wording import hint, sentence
from fvs_schema.findings import Finding, FindingCode

CAMERA = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)


def ring(*angles: int) -> list[PinholeView]:
    found = []
    for degrees in angles:
        a = np.radians(degrees)
        centre = (3 * np.cos(a), 3 * np.sin(a), 0.3)
        found.append(
            PinholeView(f"{degrees:03d}", CAMERA, look_at(centre, (0, 0, 0), (0.0, 0.0, 1.0)).inverse())
        )
    return found


@pytest.fixture
def targets() -> Targets:
    return Targets(ring(0), ring(*range(10, 360, 10)))


SEEN = [Seen(0.8, 14.0), Seen(0.5, 21.0), Seen(0.3, 25.0), Seen(0.6, 18.5)]


def plan(targets: Targets, **budget: object) -> Plan:
    starts = [ring(0)[0].centre]
    return make_plan(targets, Budget(**{"views": 5, **budget}), starts, SEEN)  # type: ignore[arg-type]


def test_stops_add_up_to_the_tour_and_lead_to_the_end(targets: Targets) -> None:
    found = plan(targets)
    (tour,) = found.tours
    assert len(tour.stops) == found.stops == 5
    assert tour.stops[-1].travel == pytest.approx(tour.length) == pytest.approx(found.length)
    assert sum(stop.distance for stop in tour.stops) == pytest.approx(tour.length)
    variances = [found.now.variance, *(stop.after.variance for stop in tour.stops)]
    assert variances == sorted(variances, reverse=True)
    assert found.end == tour.stops[-1].after
    before, after = np.array(found.target_variances).T
    assert before.mean() == pytest.approx(found.now.variance)
    assert after.mean() == pytest.approx(found.end.variance)


def test_terms_say_why(targets: Targets) -> None:
    found = plan(targets)
    planned = {stop.name for stop in found.tours[0].stops}
    assert {term.name for term in found.terms if term.planned} == planned
    assert [term.planned for term in found.terms] == [True] * 5 + [False] * 30
    terms = {term.name: term for term in found.terms}
    assert terms["180"].variance > terms["010"].variance
    assert terms["010"].distance == pytest.approx(2 * 3 * np.sin(np.radians(5)))
    assert all(term.chance is None for term in found.terms)
    assert all(0 <= term.gain_in_plan <= term.gain for term in found.terms)
    # Targets are the visited view, then the ring: a view at 90 degrees helps itself most.
    assert terms["090"].helps[0] == 9


def test_the_sentence_is_for_a_pilot(targets: Targets) -> None:
    text = plan(targets).sentence("m")
    assert text.startswith("5 more photographs, ")
    assert " m of flight, for " in text
    assert text.endswith("dB each.")
    assert plan(targets, views=1).sentence("units").startswith("1 more photograph, ")
    blind = make_plan(targets, Budget(views=3), [ring(0)[0].centre])
    assert blind.end.forecast is None
    assert "the mean variance falls by" in blind.sentence("units")


def test_several_vehicles_have_their_own_tours(targets: Targets) -> None:
    starts = [ring(0)[0].centre, ring(180)[0].centre]
    found = make_plan(targets, Budget(views=6), starts, SEEN)
    first, second = found.tours
    assert first.stops
    assert second.stops
    assert not {stop.name for stop in first.stops} & {stop.name for stop in second.stops}
    assert found.end.variance == pytest.approx(min(s.after.variance for t in found.tours for s in t.stops))


def test_there_must_be_candidates() -> None:
    with pytest.raises(InvalidInputError, match="no candidate"):
        make_plan(Targets(ring(0), []), Budget(views=3), [np.zeros(3)])


def test_what_is_behind_a_fence_has_no_distance(targets: Targets) -> None:
    fence = Box(centre=(-2.0, 0.0, 0.0), size=(0.1, 100.0, 100.0))
    start = ring(0)[0].centre
    legs = FreeLegs(np.concatenate([targets.centres, [start]]), FreeSpace(no_fly=[fence]))
    found = make_plan(targets, Budget(views=5, home=True), [start], SEEN, legs)
    behind = {name for name, x in zip(targets.index, targets.centres[:, 0], strict=True) if x < -2.05}
    assert {term.name for term in found.terms if term.distance is None} == behind
    assert not {stop.name for stop in found.tours[0].stops} & behind


def test_the_way_home_goes_around_what_is_in_the_way() -> None:
    start, targets = np.array([-3.0, 0.0, 0.3]), Targets(ring(200), ring(0, 90), ring(2))
    tower = Cylinder(base=(0.0, 0.0, -9.0), radius=1.0, height=18.0)
    legs = FreeLegs(np.concatenate([targets.centres, [start]]), FreeSpace(no_fly=[tower]))
    (tour,) = make_plan(targets, Budget(views=1, home=True), [start], (), legs).tours
    (stop,) = tour.stops
    assert stop.name == "000"
    assert stop.via == tour.via_home == (tuple(targets.centres[1].tolist()),)
    assert tour.length == pytest.approx(2 * stop.distance)
    assert not make_plan(targets, Budget(views=1), [start], (), legs).tours[0].via_home


def test_it_says_how_many_candidates_can_be_registered() -> None:
    assert plan(Targets(ring(0), ring(10, 20)), views=1).registrable is None  # poses are known
    points = np.random.default_rng(0).normal(scale=0.2, size=(300, 3))
    eyes = np.stack([view.centre for view in ring(0, 10)])
    observations = Observations(points, np.repeat(np.arange(300), 2), np.tile(eyes, (300, 1)))
    targets = Targets(ring(0, 10), ring(15, 20, 90, 180), (), observations)
    assert plan(targets, views=1).registrable == 2


@pytest.mark.parametrize("count", [1, 2])
def test_few_targets_are_served_from_near_them_and_not_from_afar(count: int) -> None:
    """Targets at one position, or side by side, have no spread that distances could be measured by."""
    wanted = [view_at(np.radians(170 + 1e-3 * number), 3.0) for number in range(count)]
    far = [view_at(np.radians(170), 300.0)]  # in the same direction
    found = make_plan(
        Targets(ring(0, 10, 20), [*far, *ring(*range(30, 360, 10))], wanted),
        Budget(views=1),
        [ring(0)[0].centre],
    )
    assert [stop.name for stop in found.tours[0].stops] == ["170"]
    assert found.end.variance < 0.6 * found.now.variance


def test_targets_that_no_candidate_is_near_are_refused() -> None:
    far = Targets(ring(0, 10, 20), ring(*range(30, 360, 10)), [view_at(0.0, 300.0)])
    with pytest.raises(InvalidInputError, match="No candidate helps the targets") as found:
        make_plan(far, Budget(views=3), [ring(0)[0].centre])
    assert "nearer to the targets" in (found.value.hint or "")
    beside = Targets(ring(0, 10, 20), ring(*range(30, 360, 10)), [view_at(0.0, 9.0)])
    assert make_plan(beside, Budget(views=3), [ring(0)[0].centre]).stops == 3


FENCE = Box(centre=(-2.0, 0.0, 0.0), size=(0.1, 100.0, 100.0))
ROUND_THE_START = Box(centre=(3.0, 0.0, 0.3), size=(0.2, 0.2, 0.2))


@pytest.mark.parametrize("home", [False, True])
@pytest.mark.parametrize("distance", [None, 6.0])
@pytest.mark.parametrize(
    ("start", "zones", "why"),
    [
        (ring(0)[0].centre, [ROUND_THE_START], "its start is in a no-fly zone."),
        (np.array([-9.0, 0.0, 0.3]), [FENCE], "no way leads from its start to a candidate."),
    ],
)
def test_a_vehicle_that_cannot_fly_leaves_the_views_to_the_others(
    start: np.ndarray, zones: list[Box], why: str, distance: float | None, home: bool
) -> None:
    targets = Targets(ring(0), ring(*range(10, 120, 10)))
    starts = np.stack([start, ring(60)[0].centre])
    legs = free_legs(targets.centres, starts, FreeSpace(no_fly=zones))
    found = make_plan(targets, Budget(4, distance, home), list(starts), SEEN, legs)
    grounded, flying = found.tours
    assert (grounded.stops, grounded.length, grounded.via_home) == ((), 0.0, ())
    assert len(flying.stops) >= 2
    (warning,) = found.warnings
    assert sentence(warning) == f"Vehicle 1 of 2 gets no tour: {why}"
    assert hint(warning).endswith(".")


@pytest.mark.parametrize("home", [False, True])
def test_a_vehicle_whose_distance_is_too_short_says_how_far_it_is(targets: Targets, home: bool) -> None:
    starts = [ring(0)[0].centre, np.array([13.0, 0.0, 0.3])]
    found = make_plan(targets, Budget(5, 9.0, home, scale=2.0), starts, SEEN)
    assert found.tours[0].stops
    assert not found.tours[1].stops
    (warning,) = found.warnings
    nearest = np.linalg.norm(targets.centres - starts[1], axis=1).min()
    assert warning.code is FindingCode.VEHICLE_OUT_OF_RANGE
    assert (warning.numbers["vehicle"], warning.numbers["distance"]) == (2, pytest.approx(18))
    assert warning.numbers["nearest"] == pytest.approx(2 * nearest)
    least = warning.numbers["least"] / 2.0
    assert least >= nearest * (2 if home else 1)
    assert not make_plan(targets, Budget(5, least, home), starts, SEEN).warnings


def test_a_vehicle_that_is_not_needed_could_fly(targets: Targets) -> None:
    found = make_plan(targets, Budget(1), [ring(0)[0].centre, np.array([13.0, 0.0, 0.3])], SEEN)
    assert [bool(tour.stops) for tour in found.tours].count(False) == 1
    assert not found.warnings


def test_candidates_behind_a_fence_are_counted(targets: Targets) -> None:
    start = ring(0)[0].centre
    legs = free_legs(targets.centres, start[None], FreeSpace(no_fly=[FENCE]))
    found = make_plan(targets, Budget(views=5), [start], SEEN, legs)
    (warning,) = found.warnings
    behind = sum(term.distance is None for term in found.terms)
    assert warning == Finding.of(FindingCode.UNREACHABLE, missed=behind, of=35)


def test_one_photograph_is_planned_of_each_pose() -> None:
    one, other = ring(90, 180)
    turned = one.camera_from_model.rotation * np.array([[-1.0], [-1.0], [1.0]])  # rolled by half a turn
    pose = RigidTransform(turned, one.camera_from_model.translation * np.array([-1.0, -1.0, 1.0]))
    copies = [PinholeView(f"copy {number}", CAMERA, one.camera_from_model) for number in range(3)]
    targets = Targets(ring(0), [one, *copies, PinholeView("rolled", CAMERA, pose), other])
    for budget in (Budget(views=6), Budget(views=6, distance=50.0)):
        found = make_plan(targets, budget, [ring(0)[0].centre], SEEN)
        assert {stop.name for stop in found.tours[0].stops} == {"090", "180"}
        (warning,) = found.warnings
        assert warning == Finding.of(FindingCode.SAME_POSE, copies=4, of=6)


def test_a_candidate_far_away_does_not_make_others_appear_the_same() -> None:
    near = ring(*range(10, 360, 10))
    targets = Targets(ring(0, 90), [*near, view_at(0.0, 1e7)])
    assert targets.one_of_pose.all()


def test_candidates_that_see_no_point_are_refused() -> None:
    points = np.random.default_rng(0).normal(scale=0.2, size=(300, 3))
    eyes = np.stack([view.centre for view in ring(0, 10)])
    observations = Observations(points, np.repeat(np.arange(300), 2), np.tile(eyes, (300, 1)))
    away = [
        PinholeView(view.name, CAMERA, look_at(view.centre, 2 * view.centre, (0.0, 0.0, 1.0)).inverse())
        for view in ring(0, 10, 20)
    ]
    with pytest.raises(InvalidInputError, match="No candidate can be registered") as found:
        plan(Targets(ring(0, 10), away, (), observations))
    assert "nearer to the images" in (found.value.hint or "")
    assert plan(Targets(ring(0, 10), [*away, *ring(15)], (), observations)).stops == 1


class Impatient(Monitor):
    """Is cancelled at a check."""

    def __init__(self, at: int) -> None:
        super().__init__()
        self.left = at

    def check(self) -> None:
        self.left -= 1
        if self.left == 0:
            self.cancel()
        super().check()


@pytest.mark.parametrize("at", [1, 2, 8])
def test_a_plan_stops_between_its_steps_when_it_is_cancelled(targets: Targets, at: int) -> None:
    start = [ring(0)[0].centre]
    for budget in (Budget(views=20), Budget(views=20, distance=5.0)):
        with pytest.raises(Cancelled):
            make_plan(targets, budget, start, SEEN, monitor=Impatient(at))


def test_what_a_plan_needs_stops_when_it_is_cancelled() -> None:
    views = ring(*range(0, 60, 10))
    places = np.array([view.centre for view in views])
    space = FreeSpace(no_fly=[Box(centre=(0, 0, 0), size=(1, 1, 1))] * 3, monitor=Impatient(3))
    with pytest.raises(Cancelled):
        FreeLegs(places, space)
    seen = Observations(np.zeros((1, 3)), np.zeros(1, dtype=np.int64), places[:1])
    with pytest.raises(Cancelled):
        Targets(views[:1], views[1:], observations=seen, monitor=Impatient(3))


def view_at(angle: float, radius: float) -> PinholeView:
    centre = (radius * np.cos(angle), radius * np.sin(angle), 0.1 * radius)
    return PinholeView(f"{angle} {radius}", CAMERA, look_at(centre, (0, 0, 0), (0.0, 0.0, 1.0)).inverse())
