"""Which images of a model its pairs connect, on checks made by hand."""

from types import SimpleNamespace
from typing import Any

import pytest

from fvs_engine.sfm.verification.links import Links
from fvs_engine.sfm.verification.pair_check import PairCheck
from fvs_engine.sfm.verification.thresholds import PAIRS

FEATURES = 4000
ENOUGH = int(PAIRS.min_link_share * FEATURES)


def check(first: int, second: int, matches: int, supported: int) -> PairCheck:
    return PairCheck(first, second, matches, supported, FEATURES, 0.0, 0.0)


def links(*checks: PairCheck, images: int = 6) -> Links:
    """Those of a model with images 0 to 5, named by their ids, of which 0 to 3 form a chain of good pairs."""
    posed = {i: SimpleNamespace(name=str(i), has_pose=True) for i in range(images)}
    model: Any = SimpleNamespace(images=posed)
    chain = (check(i, i + 1, 500, 490) for i in range(3))
    return Links.of(model, [*chain, *checks])


def test_images_of_good_pairs_are_connected():
    found = links(check(3, 4, 300, 290), check(2, 5, 200, 200))
    assert not found.contradicted | found.unconnected | found.loose


def test_an_image_without_pairs_is_unconnected_and_one_against_all_its_pairs_is_contradicted():
    found = links(check(3, 4, 100, 10))
    assert found.contradicted == {"4"}
    assert found.unconnected == {"5"}
    assert found.loose == set()


def test_a_group_is_contradicted_when_most_matches_across_its_seam_are():
    inside, fits = check(4, 5, 400, 400), check(3, 4, 60, 60)
    seam = links(inside, fits, check(2, 4, 50, 5), check(1, 5, 50, 5))
    assert seam.contradicted == {"4", "5"}
    assert links(inside, fits, check(2, 4, 50, 5)).contradicted == set()
    assert links(inside).unconnected == {"4", "5"}


@pytest.mark.parametrize(("matches", "loose"), [(ENOUGH - 1, {"4", "5"}), (ENOUGH, set())])
def test_a_group_that_hangs_on_few_matches_is_loose_however_many_pairs_join_it(matches: int, loose: set[str]):
    found = links(check(4, 5, 400, 400), *(check(i, 4, matches, matches) for i in range(4)))
    assert found.loose == loose
    assert not found.contradicted | found.unconnected


def test_only_matches_that_fit_count():
    assert links(check(3, 4, 2 * ENOUGH - 2, ENOUGH - 1), check(2, 5, 400, 400)).loose == {"4"}


def test_a_model_without_pairs_has_only_unconnected_images():
    posed = {i: SimpleNamespace(name=str(i), has_pose=True) for i in range(3)}
    model: Any = SimpleNamespace(images=posed)
    assert Links.of(model, []).unconnected == {"0", "1", "2"}
