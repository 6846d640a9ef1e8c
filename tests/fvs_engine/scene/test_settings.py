import pytest

from fvs_engine.scene.settings import SceneSettings
from fvs_engine.splat.densification import is_due


@pytest.mark.parametrize(("initial", "step"), [(1000, 100), (200, 50), (600, 60), (300, 10), (500, 250)])
def test_no_model_is_judged_just_after_it_was_split(initial: int, step: int) -> None:
    settings = SceneSettings(initial_iterations=initial, iterations_per_view=step)
    rules = settings.schedule.densification
    due = [iteration for iteration in range(1, 5_000) if is_due(rules, iteration)]
    ends = [initial + step * views for views in range(100)]
    assert min(end - max(d for d in due if d <= end) for end in ends) == step - step // 2
    assert len(due) == pytest.approx(4_900 / max(100, step), rel=0.25)


def test_a_schedule_without_more_iterations_is_the_one_that_was_asked_for() -> None:
    settings = SceneSettings(iterations_per_view=0)
    assert settings.schedule == settings.training
