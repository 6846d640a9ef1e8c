import numpy as np
import pytest

from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.select.initial_views import initial_views
from fvs_engine.views import AnyView, View

CAMERA = PinholeCamera(40, 30, 30.0, 30.0, 20.0, 15.0)


def circle(count: int) -> list[AnyView]:
    angles = 2 * np.pi * np.arange(count) / count
    poses = [look_at([np.cos(a), np.sin(a), 0], [0, 0, 0], [0, 0, 1]) for a in angles]
    return [View(f"{i:02d}", CAMERA, pose.inverse()) for i, pose in enumerate(poses)]


def test_the_first_of_the_capture_whatever_the_seed() -> None:
    views = circle(8)
    assert initial_views(views, 3, "first", 0) == ("00", "01", "02")
    assert initial_views(views, 3, "first", 7) == ("00", "01", "02")


def test_consecutive_views_begin_anywhere_and_stay_inside() -> None:
    views = circle(8)
    found = {initial_views(views, 3, "consecutive", seed) for seed in range(200)}
    assert found == {tuple(f"{start + k:02d}" for k in range(3)) for start in range(6)}
    assert initial_views(views, 8, "consecutive", 5) == tuple(view.name for view in views)


@pytest.mark.parametrize("seed", range(5))
def test_farthest_views_are_spread_over_the_circle(seed: int) -> None:
    chosen = sorted(int(name) for name in initial_views(circle(16), 4, "farthest", seed))
    gaps = np.diff([*chosen, chosen[0] + 16])
    assert list(gaps) == [4, 4, 4, 4]


def test_the_seed_draws_where_farthest_views_begin() -> None:
    assert len({initial_views(circle(16), 4, "farthest", seed)[0] for seed in range(30)}) > 8
    assert initial_views(circle(16), 4, "farthest", 3) == initial_views(circle(16), 4, "farthest", 3)


def test_planned_views_surround_all_others_and_are_the_best_of_the_whole_plan() -> None:
    views = circle(16)
    chosen = sorted(int(name) for name in initial_views(views, 4, "planned", 0))
    assert list(np.diff([*chosen, chosen[0] + 16])) == [4, 4, 4, 4]
    arc = [*circle(48)[:32], *circle(48)[40:42]]  # two views beyond a gap serve few others
    whole = initial_views(arc, 6, "planned", 0)
    assert initial_views(arc, 3, "planned", 5, budget=6) == whole[:3]
    assert initial_views(arc, 3, "planned", 0) != whole[:3]
    assert {"40", "41"}.isdisjoint(whole[:2])


def test_views_at_one_spot_are_each_taken_once() -> None:
    views = [View(str(i), CAMERA, RigidTransform.identity()) for i in range(5)]
    for choice in ("farthest", "planned"):
        assert sorted(initial_views(views, 5, choice, 1)) == ["0", "1", "2", "3", "4"]
