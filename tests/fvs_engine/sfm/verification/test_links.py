"""Which images of a model its pairs connect, on checks made by hand."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.verification.links import Links
from fvs_engine.sfm.verification.pair_check import PairCheck
from fvs_engine.sfm.verification.thresholds import PAIRS

FEATURES = 4000
ENOUGH = int(PAIRS.min_link_share * FEATURES)


def pose(image_id: int) -> pycolmap.Rigid3d:
    """That of image ``image_id`` of the model: on a line, each turned by 15° more than the one before."""
    turn = pycolmap.Rotation3d(np.radians([0.0, 15.0 * image_id, 0.0]))
    return pycolmap.Rigid3d(turn, np.array([-float(image_id), 0.0, 0.0]))


def check(
    first: int, second: int, matches: int, supported: int, turn_deg: tuple[float, float, float] = (0, 0, 0)
) -> PairCheck:
    """A pair whose matches see the world turned by the rotation vector ``turn_deg``."""
    turned = pose(second) * pycolmap.Rigid3d(pycolmap.Rotation3d(np.radians(turn_deg)), np.zeros(3))
    relative = turned * pose(first).inverse()
    second_from_first = RigidTransform(relative.rotation.matrix(), np.asarray(relative.translation))
    return PairCheck(first, second, matches, supported, FEATURES, 0.0, 0.0, second_from_first)


def model_of(images: int) -> Any:
    """A model with images 0, 1, …, named by their ids."""
    posed = {
        i: SimpleNamespace(name=str(i), has_pose=True, cam_from_world=partial(pose, i)) for i in range(images)
    }
    return SimpleNamespace(images=posed)


def links(*checks: PairCheck, images: int = 6) -> Links:
    """Those of a model with images 0 to 5, named by their ids, of which 0 to 3 form a chain of good pairs."""
    model = model_of(images)
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


def test_a_group_is_contradicted_when_more_matches_across_its_seam_agree_on_another_pose_than_fit():
    inside, fits = check(4, 5, 400, 400), check(3, 4, 60, 60)
    seam = links(inside, fits, check(2, 4, 50, 5, (0, 90, 0)), check(1, 5, 50, 5, (0, 96, 0)))
    assert seam.contradicted == {"4", "5"}
    # The pose that they agree on is one of the group, whichever of its images is the first of a pair.
    other = links(inside, fits, check(2, 4, 50, 5, (0, 90, 0)), check(5, 1, 50, 5, (0, -96, 0)))
    assert other.contradicted == {"4", "5"}
    assert links(inside, fits, check(2, 4, 50, 5, (0, 90, 0))).contradicted == set()
    assert links(inside).unconnected == {"4", "5"}


def test_a_group_that_is_only_in_the_wrong_place_is_contradicted():
    inside, fits = check(4, 5, 400, 400), check(3, 4, 60, 60)
    assert links(inside, fits, check(2, 4, 50, 5), check(1, 5, 50, 5)).contradicted == {"4", "5"}


def test_chance_matches_that_each_give_another_pose_contradict_no_group():
    # As in a courtyard: a group seen by one pair, and twenty pairs of images that show different walls.
    turns_deg = np.random.default_rng(0).uniform(-120.0, 120.0, (20, 3))
    chance = [check(k % 4, 4 + k % 2, 25, 3, tuple(turn)) for k, turn in enumerate(turns_deg)]
    found = links(check(4, 5, 400, 400), check(3, 4, 60, 58), *chance)
    assert sum(pair.matches - pair.supported for pair in chance) > 7 * 58
    assert not found.contradicted | found.unconnected
    assert found.loose == {"4", "5"}


def test_pairs_that_leave_their_relative_pose_open_agree_with_no_other():
    inside, fits = check(4, 5, 400, 400), check(3, 4, 60, 60)
    open_ = [replace(check(k, 4, 50, 5), second_from_first=None) for k in range(3)]
    assert links(inside, fits, *open_).contradicted == set()
    many = replace(check(2, 4, 80, 5), second_from_first=None)
    assert links(inside, fits, many).contradicted == {"4", "5"}


@pytest.mark.parametrize(("matches", "loose"), [(ENOUGH - 1, {"4", "5"}), (ENOUGH, set())])
def test_a_group_that_hangs_on_few_matches_is_loose_however_many_pairs_join_it(matches: int, loose: set[str]):
    found = links(check(4, 5, 400, 400), *(check(i, 4, matches, matches) for i in range(4)))
    assert found.loose == loose
    assert not found.contradicted | found.unconnected


def test_only_matches_that_fit_count():
    assert links(check(3, 4, 2 * ENOUGH - 2, ENOUGH - 1), check(2, 5, 400, 400)).loose == {"4"}


def test_a_model_without_pairs_has_only_unconnected_images():
    assert Links.of(model_of(3), []).unconnected == {"0", "1", "2"}
