"""How many candidates a plan considers."""

import numpy as np
import pytest

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.plan.generate import MOST_CANDIDATES
from fvs_engine.plan.plan import considered
from fvs_engine.views import PinholeView

CAMERA = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)
VIEW = PinholeView("view", CAMERA, RigidTransform(np.eye(3), np.zeros(3)))


@pytest.mark.parametrize(
    ("count", "views", "left"),
    [
        (MOST_CANDIDATES, 54, MOST_CANDIDATES),
        (MOST_CANDIDATES, 100, 16_000),
        (MOST_CANDIDATES, 200, 2_000),
        (2_000, 200, 2_000),
        (1, 200, 1),
    ],
)
def test_many_views_are_chosen_among_fewer_candidates(count: int, views: int, left: int) -> None:
    assert len(considered((VIEW,) * count, views, MOST_CANDIDATES)) == left


def test_an_even_share_in_the_order_given_is_considered() -> None:
    candidates = tuple(
        PinholeView(f"{number:05d}", CAMERA, VIEW.camera_from_model) for number in range(10_000)
    )
    names = [view.name for view in considered(candidates, 200, 5_000)]
    assert names == sorted(set(names))
    assert np.histogram(list(map(int, names)), 10, (0, 10_000))[0].min() > 150
    assert len(considered(candidates, 1, 5_000)) == 5_000
