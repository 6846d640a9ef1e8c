import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import SimilarityTransform, alignment_report, robust_umeyama, umeyama

seeds = st.integers(0, 10_000)


def random_similarity(generator: np.random.Generator) -> SimilarityTransform:
    return SimilarityTransform(
        float(np.exp(generator.uniform(-4, 4))),
        Rotation.random(random_state=int(generator.integers(1 << 30))).as_matrix(),
        generator.uniform(-50, 50, 3),
    )


@given(seed=seeds, count=st.integers(3, 40))
def test_umeyama_recovers_any_similarity(seed, count):
    generator = np.random.default_rng(seed)
    source = generator.normal(size=(count, 3))
    truth = random_similarity(generator)
    found = umeyama(source, truth.apply(source))
    size = truth.scale + np.abs(truth.translation).max()
    assert found.scale == pytest.approx(truth.scale, rel=1e-9)
    np.testing.assert_allclose(found.apply(source), truth.apply(source), atol=1e-9 * size)


@given(seed=seeds)
def test_umeyama_on_noisy_points_cannot_be_improved(seed):
    generator = np.random.default_rng(seed)
    source = generator.normal(size=(12, 3))
    target = random_similarity(generator).apply(source)
    target += 0.1 * target.std() * generator.normal(size=target.shape)
    found = umeyama(source, target)

    def cost(transform: SimilarityTransform) -> float:
        return float(((transform.apply(source) - target) ** 2).sum())

    for _ in range(10):
        turn = Rotation.from_rotvec(1e-3 * generator.normal(size=3)).as_matrix()
        nearby = SimilarityTransform(
            found.scale * float(np.exp(1e-3 * generator.normal())),
            turn @ found.rotation,
            found.translation + 1e-3 * generator.normal(size=3),
        )
        assert cost(nearby) >= cost(found)


def test_a_mirror_image_is_fitted_by_a_rotation():
    source = np.random.default_rng(3).normal(size=(20, 3))
    found = umeyama(source, source * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1)


def test_without_scale_the_scale_stays_one():
    source = np.random.default_rng(4).normal(size=(20, 3))
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 1.0]).as_matrix()
    found = umeyama(source, 3 * source @ turn.T, with_scale=False)
    assert found.scale == 1
    np.testing.assert_allclose(found.rotation, turn, atol=1e-12)


@given(seed=seeds, wrong=st.integers(0, 8))
def test_robust_umeyama_finds_the_points_that_are_wrong(seed, wrong):
    generator = np.random.default_rng(seed)
    source = generator.normal(size=(20, 3))
    truth = random_similarity(generator)
    target = truth.apply(source)
    target[:wrong] += truth.scale * (5 + generator.uniform(size=(wrong, 3)) * 20)
    report = robust_umeyama(source, target, inlier_threshold=0.01 * truth.scale, seed=seed)
    np.testing.assert_array_equal(report.inliers, np.arange(20) >= wrong)
    np.testing.assert_allclose(report.scale, truth.scale, rtol=1e-8)
    assert report.rms < 1e-8 * (truth.scale + np.abs(truth.translation).max())


@given(seed=seeds)
def test_without_a_threshold_gross_errors_are_still_found(seed):
    generator = np.random.default_rng(seed)
    source = generator.normal(size=(30, 3))
    truth = random_similarity(generator)
    target = truth.apply(source) + 0.01 * truth.scale * generator.normal(size=(30, 3))
    target[:10] += truth.scale * (5 + generator.uniform(size=(10, 3)) * 20)
    report = robust_umeyama(source, target)
    assert not report.inliers[:10].any()
    assert report.inliers.sum() >= 15
    assert report.scale == pytest.approx(truth.scale, rel=0.02)
    assert report.rms < 0.03 * truth.scale


@pytest.mark.parametrize("seed", range(20))
def test_inliers_are_those_that_agree_with_the_result(seed):
    generator = np.random.default_rng(seed)
    source = generator.normal(size=(40, 3))
    target = source + 0.1 * generator.normal(size=(40, 3))
    report = robust_umeyama(source, target, inlier_threshold=0.2)
    residuals = np.linalg.norm(report.transform.apply(source) - target, axis=1)
    np.testing.assert_array_equal(report.inliers, residuals <= 0.2)
    assert report.rms == pytest.approx(np.sqrt((residuals[report.inliers] ** 2).mean()))
    assert report.median == pytest.approx(np.median(residuals[report.inliers]))


def test_robust_umeyama_is_deterministic_for_a_seed():
    generator = np.random.default_rng(5)
    source = generator.normal(size=(60, 3))
    target = source + 0.2 * generator.normal(size=(60, 3))
    first, second = (robust_umeyama(source, target, seed=7) for _ in range(2))
    np.testing.assert_array_equal(first.inliers, second.inliers)
    np.testing.assert_array_equal(first.transform.rotation, second.transform.rotation)


def test_a_straight_track_is_flagged():
    generator = np.random.default_rng(6)
    source = np.outer(np.linspace(0, 100, 12), [1.0, 2.0, -0.5]) + 0.02 * generator.normal(size=(12, 3))
    report = robust_umeyama(source, 2 * source + 0.02 * generator.normal(size=(12, 3)))
    assert report.ill_conditioned
    assert report.collinearity > 0.99
    assert report.scale == pytest.approx(2, rel=1e-3)


def test_an_exact_line_is_flagged_too():
    source = np.outer(np.arange(6.0), [1.0, 1.0, 0.0])
    report = robust_umeyama(source, source + 1)
    assert report.ill_conditioned
    assert report.collinearity == pytest.approx(1)
    assert report.rms < 1e-9


def test_noise_as_large_as_the_track_is_wide_is_ill_conditioned():
    generator = np.random.default_rng(7)
    source = np.column_stack([np.linspace(0, 10, 10), generator.uniform(-0.5, 0.5, (10, 2))])
    clean = robust_umeyama(source, source + 0.001 * generator.normal(size=(10, 3)))
    noisy = source + 0.5 * generator.normal(size=(10, 3))
    assert not clean.ill_conditioned
    assert alignment_report(source, noisy, umeyama(source, noisy)).ill_conditioned


def test_points_spread_in_a_plane_are_well_conditioned():
    generator = np.random.default_rng(8)
    source = np.column_stack([generator.uniform(-1, 1, (15, 2)), np.zeros(15)])
    report = robust_umeyama(source, 3 * source)
    assert not report.ill_conditioned
    assert report.median < 1e-9


@pytest.mark.parametrize("align", [umeyama, robust_umeyama])
@pytest.mark.parametrize(
    ("source", "target"),
    [
        (np.eye(3)[:2], np.eye(3)[:2]),
        (np.eye(3), np.eye(4)[:, :3]),
        (np.ones((5, 3)), np.random.default_rng(0).normal(size=(5, 3))),
        (np.random.default_rng(0).normal(size=(5, 3)), np.zeros((5, 3))),
        (np.array([[np.nan, 0, 0], [1, 0, 0], [0, 1, 0]]), np.eye(3)),
        (np.eye(3), np.array([[np.inf, 0, 0], [1, 0, 0], [0, 1, 0]])),
        (np.zeros((3, 2)), np.zeros((3, 2))),
    ],
)
def test_points_that_fix_nothing_are_refused(align, source, target):
    with pytest.raises(InvalidInputError):
        align(source, target)


def test_an_alignment_that_nothing_supports_is_refused():
    generator = np.random.default_rng(9)
    source, target = generator.normal(size=(2, 30, 3))
    with pytest.raises(InvalidInputError):
        robust_umeyama(source, target, inlier_threshold=1e-6)
