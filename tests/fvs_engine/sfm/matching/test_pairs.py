import itertools

import numpy as np
import pytest

from fvs_engine.sfm.matching.pairs import exhaustive_pairs, selected_pairs
from fvs_engine.sfm.matching.retrieval import global_descriptors


def test_exhaustive_pairs_are_all_pairs_once():
    assert exhaustive_pairs(5) == list(itertools.combinations(range(5), 2))


def random_looks(count: int, seed: int = 0) -> np.ndarray:
    looks = np.random.default_rng(seed).normal(size=(count, 16)).astype(np.float32)
    return looks / np.linalg.norm(looks, axis=1, keepdims=True)


def test_selected_pairs_grow_linearly_are_unique_and_keep_neighbours():
    for count in (100, 400):
        pairs = selected_pairs(count, random_looks(count), {})
        assert len(pairs) == len(set(pairs)) <= 30 * count
        assert all(i < j < count for i, j in pairs)
        assert {(i, i + 1) for i in range(count - 1)} <= set(pairs)


def test_a_loop_is_closed_by_looks():
    looks = random_looks(200)
    looks[199] = looks[3]
    assert (3, 199) in selected_pairs(200, looks, {})


def test_neighbours_in_space_are_paired_whatever_their_order():
    generator = np.random.default_rng(1)
    order = generator.permutation(100)
    positions = {int(i): np.array([10.0 * place, 0.0, 50.0]) for place, i in enumerate(order)}
    pairs = set(selected_pairs(100, random_looks(100), positions))
    along = [tuple(sorted((int(order[k]), int(order[k + 1])))) for k in range(99)]
    assert set(along) <= pairs


def test_images_with_the_same_features_look_alike():
    generator = np.random.default_rng(0)
    scenes = [generator.gamma(0.3, size=(300, 128)).astype(np.float32) for _ in range(4)]
    seen = []

    def read(i: int) -> np.ndarray:
        noise = np.random.default_rng(i).uniform(0.95, 1.05, size=(300, 128)).astype(np.float32)
        return scenes[i % 4] * noise

    looks = global_descriptors(read, 8, 0, seen.append)
    similarity = looks @ looks.T - 2 * np.eye(8)
    assert [int(row.argmax()) for row in similarity] == [4, 5, 6, 7, 0, 1, 2, 3]
    assert seen == list(range(1, 9))
    np.testing.assert_array_equal(looks, global_descriptors(read, 8, 0, lambda _: None))


@pytest.mark.parametrize("features", [0, 5])
def test_hardly_any_features_are_no_error(features: int):
    looks = global_descriptors(lambda _: np.ones((features, 128), np.float32), 3, 0, lambda _: None)
    assert np.isfinite(looks).all()
