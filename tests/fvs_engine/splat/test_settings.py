import pytest
from pydantic import ValidationError

from fvs_engine.splat.densification import is_due, reset_is_due
from fvs_engine.splat.settings import PRESETS, LearningRates, Level, TrainingSettings, memory_need_bytes


def test_presets() -> None:
    assert (PRESETS["coarse"].sh_degree, PRESETS["coarse"].iterations) == (0, 2_000)
    assert (PRESETS["fine"].sh_degree, PRESETS["fine"].iterations) == (3, 30_000)
    for preset in PRESETS.values():
        assert preset == preset.with_iterations(preset.iterations)


@pytest.mark.parametrize("iterations", [300, 1_000, 7_000, 15_000, 100_000])
def test_shorter_runs_still_densify_and_then_settle(iterations: int) -> None:
    settings = PRESETS["fine"].with_iterations(iterations)
    rules = settings.densification
    due = [i for i in range(iterations + 1) if is_due(rules, i)]
    assert len(due) >= 1
    assert due[-1] <= max(0.8 * iterations, 15_000 * iterations / 30_000)
    assert all(i < due[-1] for i in range(iterations + 1) if reset_is_due(rules, i))
    assert 3 * settings.sh_degree_interval <= iterations / 2


@pytest.mark.parametrize("iterations", [1_000, 7_000, 30_000])
def test_a_fine_model_grows_with_its_images(iterations: int) -> None:
    settings = PRESETS["fine"].model_copy(update={"max_gaussians": 400_000}).with_iterations(iterations)
    at = [round(share * iterations) for share in (0.0, 0.29, 0.31, 0.59, 0.61, 0.99)]
    assert [settings.reduction_at(i) for i in at] == [4, 4, 2, 2, 1, 1]
    assert [settings.max_gaussians_at(i) for i in at] == [
        *(100_000, 100_000, 200_000, 200_000, 400_000, 400_000)
    ]
    full_size_from = settings.levels[-1].until_iteration
    assert any(is_due(settings.densification, i) for i in range(full_size_from + 1, iterations))


def test_opacities_of_short_fine_runs_are_not_reset() -> None:
    resets = {
        n: [i for i in range(0, n, 100) if reset_is_due(PRESETS["fine"].with_iterations(n).densification, i)]
        for n in (7_000, 21_000, 30_000)
    }
    assert resets == {7_000: [], 21_000: [], 30_000: [15_000]}


def test_rates_are_multiplied_except_those_of_positions() -> None:
    rates, doubled = LearningRates(), LearningRates().times(2)
    assert (doubled.means_first, doubled.means_last) == (rates.means_first, rates.means_last)
    assert doubled.sh_rest == 2 * rates.sh_rest
    assert doubled.opacity_logits == 2 * rates.opacity_logits


def test_settings_refuse_what_cannot_be() -> None:
    with pytest.raises(ValidationError):
        TrainingSettings(sh_degree=4)
    with pytest.raises(ValidationError):
        TrainingSettings.model_validate({"iteration": 3})
    with pytest.raises(ValidationError, match="means_last"):
        TrainingSettings(learning_rates=LearningRates(means_first=1e-6, means_last=1e-5))


def test_memory_need_grows_with_everything() -> None:
    base = memory_need_bytes(100_000, 3, 50, 960, 540)
    assert memory_need_bytes(200_000, 3, 50, 960, 540) > base
    assert memory_need_bytes(100_000, 0, 50, 960, 540) < base
    assert memory_need_bytes(100_000, 3, 51, 960, 540) == base + 3 * 960 * 540
    assert base > 4 * 59 * 4 * 100_000


def test_a_coarse_run_ends_on_images_of_full_size() -> None:
    settings = PRESETS["coarse"].with_iterations(800)
    assert [settings.reduction_at(i) for i in (0, 399, 400, 599, 600, 699, 700, 799)] == [
        *(8, 8, 4, 4),
        *(2, 2, 1, 1),
    ]
    assert settings.work_until(800) == 400 / 8 + 200 / 4 + 100 / 2 + 100
    assert settings.work_until(500) == 400 / 8 + 100 / 4
    assert TrainingSettings().work_until(800) == 800


def test_levels_that_do_not_refine_are_refused() -> None:
    with pytest.raises(ValidationError, match="levels"):
        TrainingSettings(
            levels=(Level(until_iteration=5, reduction=2), Level(until_iteration=9, reduction=2))
        )


@pytest.mark.parametrize("iterations", [1, 2, 7])
def test_shortest_runs_have_levels(iterations: int) -> None:
    assert PRESETS["coarse"].with_iterations(iterations).work_until(iterations) > 0
