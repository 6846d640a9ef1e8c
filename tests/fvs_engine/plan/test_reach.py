import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.reach import SPACINGS, Reach, default_radius

CENTRES = {
    "far": np.array([0.0, 5.0, 0.0]),
    "near": np.array([1.0, 0.0, 0.0]),
    "b": np.array([0.0, 0.0, 2.0]),
    "a": np.array([0.0, -2.0, 0.0]),
}
HERE = np.zeros(3)


def test_a_radius_includes_its_edge_and_orders_by_distance_then_name() -> None:
    assert list(Reach(radius=2.0).distances(HERE, CENTRES).items()) == [("near", 1.0), ("a", 2.0), ("b", 2.0)]


def test_the_nearest_few_need_no_radius() -> None:
    assert list(Reach(nearest=2).distances(HERE, CENTRES)) == ["near", "a"]
    assert list(Reach(nearest=99).distances(HERE, CENTRES)) == ["near", "a", "b", "far"]


def test_nothing_is_in_reach_of_a_short_radius_or_among_no_views() -> None:
    assert Reach(radius=0.9).distances(HERE, CENTRES) == {}
    assert Reach(nearest=3).distances(HERE, {}) == {}


def test_distance_is_between_centres_wherever_the_camera_is() -> None:
    here = np.array([1.0, 1.0, 0.0])
    assert Reach(radius=1.0).distances(here, CENTRES) == {"near": 1.0}


@pytest.mark.parametrize("given", [{}, {"radius": 1.0, "nearest": 2}])
def test_reach_is_one_of_the_two(given: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match="exactly one"):
        Reach(**given)  # type: ignore[arg-type]


def test_the_default_radius_scales_with_the_dataset_and_ignores_pauses_and_jumps() -> None:
    steps = np.array([0.0, 1.0, 2.0, 2.0, 2.0, 3.0, 4.0, 104.0])  # two pauses, one jump
    centres = np.stack([steps, 0 * steps, 0 * steps], axis=1)
    assert default_radius(centres) == pytest.approx(SPACINGS)
    assert default_radius(30.0 * centres) == pytest.approx(30.0 * SPACINGS)


def test_a_camera_that_stands_still_has_no_default_radius() -> None:
    centres = np.tile([3.0, 4.0, 1000.0], (5, 1))
    centres[2] += 1e-13
    with pytest.raises(InvalidInputError, match="have the same position"):
        default_radius(centres)


def test_travel_is_the_way_and_not_the_distance() -> None:
    assert path_length([[0, 0, 0], [3, 4, 0], [0, 0, 0]]) == 10.0
    assert path_length([[1, 2, 3]]) == 0.0
    assert path_length([]) == 0.0
