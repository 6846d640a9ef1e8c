import itertools

import pytest

from fvs_engine.scene.settings import SceneSettings
from fvs_engine.splat.densification import is_due


@pytest.mark.parametrize("iterations", [1, 2, 10, 60, 200, 401, 1_000, 10_000])
def test_no_model_ends_just_after_gaussians_were_split(iterations: int) -> None:
    training = SceneSettings().training_of("full", iterations)
    due = [iteration for iteration in range(1, iterations + 1) if is_due(training.densification, iteration)]
    assert all(training.reduction_at(iteration - 1) > 1 for iteration in due)
    assert len(due) == max(0, (round(0.875 * iterations) // 100) - 1)


@pytest.mark.parametrize("iterations", [8, 200, 1_000])
def test_a_model_is_trained_from_coarse_to_fine(iterations: int) -> None:
    training = SceneSettings().training_of("full", iterations)
    reductions = [training.reduction_at(iteration) for iteration in range(iterations)]
    assert [key for key, _ in itertools.groupby(reductions)] == [8, 4, 2, 1]


@pytest.mark.parametrize("iterations", [8, 60, 400, 1_000])
def test_a_quick_model_of_large_images_is_trained_on_half_of_their_size(iterations: int) -> None:
    training = SceneSettings(long_side_px=800).training_of("quick", iterations)
    reductions = [training.reduction_at(iteration) for iteration in range(iterations)]
    assert [key for key, _ in itertools.groupby(reductions)] == [8, 4, 2]
    due = [iteration for iteration in range(1, iterations + 1) if is_due(training.densification, iteration)]
    assert all(training.reduction_at(iteration - 1) > 2 for iteration in due)
    small = SceneSettings(long_side_px=640)
    assert small.iterations_of("quick", 40) < SceneSettings(long_side_px=800).iterations_of("quick", 40)
    reductions = [
        small.training_of("quick", iterations).reduction_at(iteration) for iteration in range(iterations)
    ]
    assert [key for key, _ in itertools.groupby(reductions)] == [8, 4, 2, 1]


@pytest.mark.parametrize(("iterations", "full_size"), [(8, 1), (1_000, 125), (2_000, 1_000), (4_000, 2_000)])
def test_of_small_images_and_many_views_half_of_the_iterations_are_at_full_size(
    iterations: int, full_size: int
) -> None:
    training = SceneSettings(long_side_px=640).training_of("full", iterations)
    reductions = [training.reduction_at(iteration) for iteration in range(iterations)]
    assert [key for key, _ in itertools.groupby(reductions)] == [8, 4, 2, 1]
    assert reductions.count(1) == full_size
    due = [iteration for iteration in range(1, iterations + 1) if is_due(training.densification, iteration)]
    assert all(training.reduction_at(iteration - 1) > 1 for iteration in due)


def test_the_papers_schedule_is_the_default() -> None:
    settings = SceneSettings()
    assert [settings.iterations_of("full", views) for views in (4, 10, 20, 100)] == [1000, 1000, 2000, 10_000]
    assert settings.iterations_of("quick", 20) < settings.iterations_of("full", 20) / 2
