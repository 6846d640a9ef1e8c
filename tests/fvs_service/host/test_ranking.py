"""Rankings of a runner: what it makes of a question about views."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch
from fvs_service.host.runner.ranking import rank_views
from fvs_service.rankings.port import RankedViews, RankViews

from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.monitor import Monitor
from fvs_engine.plan.familiarity import Observations
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.views import PinholeView

CAMERA = PinholeCamera(32, 24, 30, 30, 16, 12)
RING = 24
"""Candidates 15° apart: 1.04 from one to the next."""


def at(step: float) -> RigidTransform:
    """A model_from_camera on the ring."""
    angle = 2.0 * np.pi * step / RING
    return look_at([4.0 * np.cos(angle), 4.0 * np.sin(angle), 1.0], [0, 0, 0], [0, 0, 1])


def state(*steps: float, seen: bool = True) -> SceneModel:
    """A model of images at these places; ``seen``: its points were seen from everywhere."""
    generator = np.random.default_rng(0)
    points = generator.normal(scale=0.3, size=(200, 3))
    eyes = np.stack([at(step).translation for step in (range(RING) if seen else steps)])
    views = tuple(PinholeView(str(step), CAMERA, at(step).inverse()) for step in steps)
    observations = Observations(
        points, np.repeat(np.arange(len(points)), len(eyes)), np.tile(eyes, (len(points), 1))
    )
    none = torch.zeros((1, 3))
    gaussians = Gaussians(none, none, torch.ones((1, 4)), torch.zeros(1), none, torch.zeros((1, 0, 3)))
    return SceneModel(
        gaussians=gaussians, sh_degree=0, iterations=7, views=views, read_observations=lambda: observations
    )


def ranked(
    of: SceneModel, method: str, here: float, reach: float | None, budget: int, *, rank_all: bool = False
) -> RankedViews:
    """Rank the ring's candidates in reach of a place on it."""
    views = {number: PinholeView(f"{number:02d}", CAMERA, at(number).inverse()) for number in range(RING)}
    place = at(here).translation
    away = {number: float(np.linalg.norm(view.centre - place)) for number, view in views.items()}
    near = [number for number in views if reach is None or away[number] <= reach]
    request = RankViews(
        scene_id="scene",
        snapshot_id="snapshot",
        method=method,
        views=tuple(views[number] for number in near),
        later=tuple(views[number] for number in views if number not in near),
        distances={views[number].name: away[number] for number in near},
        here=tuple(place.tolist()),
        reach=reach,
        budget=budget,
        rank_all=rank_all,
    )
    return rank_views(request, of, create_rasterizer("cpu"), Monitor())


def ranks(result: RankedViews) -> Mapping[str, int]:
    return {one.name: one.rank or 0 for one in result.candidates}


def test_kriging_takes_long_steps_when_the_rest_is_out_of_range() -> None:
    """Known from 0 to 90°, at 90°: three steps of up to 45° are best spent away from what is known."""
    found = ranks(ranked(state(0, 2, 4, 6), "kriging", here=6.0, reach=3.1, budget=3))
    assert set(found) == {f"{number:02d}" for number in range(3, 10)}
    assert found["09"] == 1
    assert found["07"] > 2


@pytest.mark.parametrize(("here", "first"), [(6.2, "09"), (23.8, "21")])
def test_a_way_begins_where_the_vehicle_is_and_not_at_the_last_image(here: float, first: str) -> None:
    found = ranks(ranked(state(0, 2, 4, 6), "kriging", here=here, reach=3.1, budget=3))
    assert found[first] == 1


def test_kriging_keeps_to_what_can_be_registered() -> None:
    far = ranks(ranked(state(0, 1, 2, 3), "kriging", here=3.0, reach=None, budget=1))
    near = ranks(ranked(state(0, 1, 2, 3, seen=False), "kriging", here=3.0, reach=None, budget=1))
    assert min(far, key=far.__getitem__) in {"12", "13", "14", "15", "16"}  # opposite
    assert min(near, key=near.__getitem__) in {"04", "05", "06", "21", "22", "23"}


def test_where_nothing_in_range_can_be_registered_kriging_goes_back() -> None:
    known = state(0, 1, 2, 3, seen=False)
    found = ranks(ranked(known, "kriging", here=7.0, reach=2.2, budget=4, rank_all=True))
    assert set(found) == {f"{number:02d}" for number in range(5, 10)}
    assert (found["05"], found["06"]) == (1, 2)


def test_how_many_can_be_registered_is_told_and_those_that_cannot_have_no_rank() -> None:
    known = state(0, 1, 2, 3, seen=False)
    beyond = ranked(known, "kriging", here=9.0, reach=2.2, budget=4)
    assert (len(beyond.candidates), beyond.registrable) == (5, 0)
    beside = ranked(known, "kriging", here=4.0, reach=2.2, budget=4)
    assert 0 < (beside.registrable or 0) < len(beside.candidates)
    for method in ("kriging", "nearest"):
        found = ranked(known, method, here=7.0, reach=2.2, budget=4)
        assert [(one.rank, one.status) for one in found.candidates] == [(None, "unregistrable")] * 5
        assert all((one.chance or 0.0) < 0.1 for one in found.candidates)
        all_of_them = ranked(known, method, here=7.0, reach=2.2, budget=4, rank_all=True)
        assert [one.rank for one in all_of_them.candidates] == [1, 2, 3, 4, 5]
        assert {one.status for one in all_of_them.candidates} == {"unregistrable"}


def test_nearest_is_near_the_vehicle() -> None:
    found: Any = ranked(state(0, 2, 4, 6), "nearest", here=15.0, reach=None, budget=1)
    assert found.candidates[0].name == "15"
