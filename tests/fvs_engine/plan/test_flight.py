"""Flight around obstacles, against all ways that there are."""

import itertools

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.clearance import FreeSpace, Matter
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.flight import MOST_PLACES, FreeLegs, free_legs
from fvs_engine.plan.route import StraightLegs, shortest_route
from fvs_engine.plan.volumes import Box, Cylinder
from fvs_schema.candidates import CandidateStatus

FENCE = Box(centre=(0.0, 0.0, 0.0), size=(0.2, 100.0, 100.0))


def all_of(count):
    return np.arange(count)


def test_without_obstacles_legs_are_straight():
    places = np.random.default_rng(0).normal(size=(50, 3))
    legs = FreeLegs(places, FreeSpace())
    straight = StraightLegs(places).between(all_of(50), all_of(50))
    assert legs.between(all_of(50), all_of(50)) == pytest.approx(straight)
    assert legs.way(3, 4) == () == legs.way(3, 3)


@pytest.mark.parametrize("seed", range(3))
def test_ways_around_obstacles_are_the_shortest_of_all(seed):
    draw = np.random.default_rng(seed)
    places = draw.uniform(-2.0, 2.0, size=(5, 3))
    matter = Matter(draw.uniform(-1.0, 1.0, size=(5, 3)), np.full(5, 0.3))
    space = FreeSpace(matter, 0.1, [Cylinder(base=(1.0, 1.0, -3.0), radius=0.4, height=6.0)])
    legs = FreeLegs(places, space)
    found = legs.between(all_of(5), all_of(5))
    assert found == pytest.approx(found.T)
    for a, b in itertools.permutations(range(5), 2):
        best = np.inf
        others = [index for index in range(5) if index not in (a, b)]
        for size in range(4):
            for through in itertools.permutations(others, size):
                way = places[[a, *through, b]]
                if space.joins(way[:-1], way[1:]).all():
                    best = min(best, path_length(way))
        assert found[a, b] == pytest.approx(best)
        way = legs.way(a, b)
        if way is None:
            assert best == np.inf
        else:
            flown = places[[a, *way, b]]
            assert space.joins(flown[:-1], flown[1:]).all()
            assert path_length(flown) == pytest.approx(best)


def test_a_fence_leaves_no_way_across():
    places = np.array([[-1.0, 0, 0], [-2.0, 1, 0], [1.0, 0, 0], [0.0, 0, 0]])
    legs = FreeLegs(places, FreeSpace(no_fly=[FENCE]))
    assert np.isfinite(legs.between(np.array([0]), np.array([0, 1]))).all()
    assert (legs.between(np.array([0]), np.array([2, 3])) == np.inf).all()
    assert legs.way(0, 2) is None


def test_a_route_can_be_flown():
    """Around a pillar: the ring's opposite places have no straight leg."""
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    space = FreeSpace(no_fly=[Cylinder(base=(0.0, 0.0, -1.0), radius=0.6, height=2.0)])
    legs = FreeLegs(ring, space)
    assert legs.way(0, 6) not in {None, ()}
    order, length = shortest_route(legs, 0, [3, 6, 9])
    assert np.isfinite(length)
    for a, b in itertools.pairwise([0, *order]):
        way = ring[[a, *legs.way(a, b), b]]
        assert space.joins(way[:-1], way[1:]).all()


def test_places_in_one_place_are_joined():
    legs = FreeLegs(np.zeros((3, 3)), FreeSpace())
    assert legs.between(all_of(3), all_of(3)) == pytest.approx(np.zeros((3, 3)))
    assert legs.way(0, 2) == ()


def test_groups_far_apart_are_joined():
    draw = np.random.default_rng(0)
    places = np.concatenate([draw.normal(size=(400, 3)), draw.normal(size=(400, 3)) + 1000.0])
    legs = FreeLegs(places, FreeSpace())
    found = legs.between(all_of(800)[:1], all_of(800))
    straight = StraightLegs(places).between(all_of(800)[:1], all_of(800))
    assert np.isfinite(found).all()
    assert (found >= straight - 1e-9).all()
    assert (found[0, 400:] <= 1.01 * straight[0, 400:]).all()


def test_eight_hundred_places_around_a_ball_are_joined_by_short_ways():
    draw = np.random.default_rng(0)
    places = draw.uniform(-3.0, 3.0, size=(800, 3))
    surface = draw.normal(size=(5_000, 3))
    matter = Matter(surface / np.linalg.norm(surface, axis=1, keepdims=True), np.full(5_000, 0.04))
    legs = FreeLegs(places, FreeSpace(matter, 0.1))
    free = matter.clear(places, 0.1) & (np.linalg.norm(places, axis=1) > 1.0)
    outside = np.flatnonzero(free)
    found = legs.between(outside[:8], outside)
    assert np.isfinite(found).all()
    straight = StraightLegs(places).between(outside[:8], outside)
    visible = np.array(
        [
            matter.sees(np.broadcast_to(places[i], (len(outside), 3)), places[outside], 0.1)
            for i in outside[:8]
        ]
    )
    assert (found >= straight - 1e-9).all()
    assert np.mean(found[visible & (straight > 0)] / straight[visible & (straight > 0)]) < 1.1


def test_too_many_places_are_refused():
    with pytest.raises(InvalidInputError, match="at most 10,000 positions") as caught:
        FreeLegs(np.zeros((MOST_PLACES + 1, 3)), FreeSpace())
    assert caught.value.hint


def test_ways_that_are_flown_are_straight_where_nothing_is_between():
    places = np.random.default_rng(0).uniform(-5.0, 5.0, size=(2_000, 3))
    legs = FreeLegs(places, FreeSpace())
    flown = [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert any(legs.way(*leg) for leg in flown)
    legs.straighten(flown)
    for one, other in flown:
        assert legs.way(one, other) == ()
        straight = np.linalg.norm(places[one] - places[other])
        assert legs.between(np.array([one]), np.array([other]))[0, 0] == pytest.approx(straight)


def test_ways_that_are_flown_still_go_around_a_zone():
    places = np.random.default_rng(0).uniform(-5.0, 5.0, size=(2_000, 3))
    places[:2] = [[-4.0, 0.0, 0.0], [4.0, 0.0, 0.0]]
    space = FreeSpace(no_fly=[Cylinder(base=(0.0, 0.0, -9.0), radius=2.0, height=18.0)])
    legs = FreeLegs(places, space)
    before = legs.between(np.array([0]), np.array([1]))[0, 0]
    legs.straighten([(0, 1)])
    way = [0, *legs.way(0, 1), 1]
    assert len(way) > 2
    assert space.joins(places[way[:-1]], places[way[1:]]).all()
    assert legs.between(np.array([0]), np.array([1]))[0, 0] == pytest.approx(path_length(places[way]))
    assert path_length(places[way]) <= before


BALL = Matter(np.zeros((1, 3)), np.ones(1))
ZONE = Box(centre=(5.0, 0.0, 0.0), size=(2.0, 2.0, 2.0))
INSIDE, ZONED, FREE = (0.5, 0.0, 0.0), (5.0, 0.5, 0.0), (0.0, 4.0, 0.0)


@pytest.mark.parametrize(
    ("candidates", "starts", "words"),
    [
        ([ZONED, ZONED], [FREE], r"All 2 candidates are in no-fly zones\."),
        ([INSIDE], [FREE], r"The only candidate is inside a solid part of the model, or within the safety"),
        (
            [INSIDE, ZONED],
            [FREE],
            "The only candidate outside of no-fly zones is inside a solid part of the model",
        ),
        ([FREE, INSIDE], [ZONED], "start of the vehicle is in a no-fly zone"),
        (
            [FREE],
            [INSIDE, ZONED],
            "start of vehicle 1 of 2 is inside a solid part of the model, or within the safety",
        ),
    ],
)
def test_what_no_way_leads_to_is_named(candidates, starts, words):
    with pytest.raises(InvalidInputError, match=words) as found:
        free_legs(np.array(candidates), np.array(starts), FreeSpace(BALL, 0.1, [ZONE]))
    assert found.value.hint


def test_candidates_that_cannot_be_flown_to_do_not_matter_beside_others():
    legs = free_legs(np.array([INSIDE, ZONED, FREE]), np.array([FREE]), FreeSpace(BALL, 0.1, [ZONE]))
    assert legs.between(np.array([3]), np.arange(3))[0].tolist() == pytest.approx([np.inf, np.inf, 0.0])


def test_one_start_from_which_no_way_leads_does_not_matter_beside_another():
    legs = free_legs(np.array([FREE]), np.array([ZONED, FREE, INSIDE]), FreeSpace(BALL, 0.1, [ZONE]))
    zoned, free, inside = (legs.blocked(place) for place in (1, 2, 3))
    assert (zoned, free, inside) == (CandidateStatus.NO_FLY, None, CandidateStatus.TOO_CLOSE)
    found = legs.between(np.array([1, 2, 3]), np.array([0]))[:, 0]
    assert found.tolist() == pytest.approx([np.inf, 0.0, np.inf])
