import numpy as np
import pytest
import torch

from fvs_engine.errors import TrainingError
from fvs_engine.splat.initialise import initialise_from_points, point_spacing


def test_sizes_are_the_mean_distance_to_three_neighbours() -> None:
    points = np.random.default_rng(0).normal(size=(60, 3))
    distances = np.sort(np.linalg.norm(points[:, None] - points[None], axis=-1), axis=1)
    np.testing.assert_allclose(point_spacing(points), distances[:, 1:4].mean(axis=1), rtol=1e-12)


def test_colours_and_opacities_are_what_they_render_as() -> None:
    colors = np.array([[0, 128, 255]] * 5, np.uint8)
    model = initialise_from_points(np.random.default_rng(1).normal(size=(5, 3)), colors, 3)
    shown = 0.5 + 0.28209479177387814 * model.sh_dc
    np.testing.assert_allclose(shown.numpy() * 255, colors, atol=1e-4)
    np.testing.assert_allclose(torch.sigmoid(model.opacity_logits).numpy(), 0.1, atol=1e-7)
    assert model.sh_degree == 3
    assert not model.sh_rest.any()


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_points(count: int) -> None:
    points = np.eye(4, 3)[:count] + 1
    model = initialise_from_points(points, np.zeros((count, 3), np.uint8), 0)
    assert len(model) == count
    assert torch.isfinite(model.log_scales).all()


def test_duplicates_measure_to_other_places() -> None:
    places = np.random.default_rng(2).normal(size=(20, 3))
    doubled = np.concatenate([places, places, places, places, places])
    np.testing.assert_allclose(point_spacing(doubled), np.tile(point_spacing(places), 5))
    same = point_spacing(np.ones((7, 3)))
    assert (same > 0).all()
    assert np.isfinite(same).all()


def test_an_outlier_does_not_cover_the_scene() -> None:
    points = np.random.default_rng(3).normal(size=(500, 3))
    points[0] = 1e6
    spacing = point_spacing(points)
    assert spacing[0] <= 30 * np.median(spacing) * (1 + 1e-9)


def test_points_that_are_not_finite_are_left_out() -> None:
    points = np.random.default_rng(4).normal(size=(9, 3))
    points[3, 1] = np.nan
    assert len(initialise_from_points(points, np.zeros((9, 3), np.uint8), 0)) == 8
    with pytest.raises(TrainingError, match="no sparse point"):
        initialise_from_points(points[3:4], np.zeros((1, 3), np.uint8), 0)
