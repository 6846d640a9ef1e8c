import numpy as np
from numpy.typing import NDArray

from fvs_engine.sfm.aliked.matching import match

DIM = 128


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def random(count: int, seed: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(size=(count, DIM))


def test_the_same_descriptors_match_whatever_their_order():
    descriptors = unit(random(30, 0))
    order = np.random.default_rng(1).permutation(30)
    found = match(descriptors, descriptors[order])
    assert sorted(map(tuple, found)) == sorted((int(order[k]), k) for k in range(30))


def test_a_descriptor_with_two_equally_near_ones_does_not_match():
    first, noise = random(5, 0), 0.01 * random(1, 3)
    second = np.concatenate([first[1:], first[:1] + noise, first[:1] - noise])
    found = match(unit(first), unit(second))
    assert found[:, 0].tolist() == [1, 2, 3, 4]
    turned = match(unit(second), unit(first))
    assert sorted(map(tuple, turned[:, ::-1])) == sorted(map(tuple, found))


def test_fewer_than_two_descriptors_match_nothing():
    assert match(unit(random(1, 0)), unit(random(9, 1))).shape == (0, 2)
    assert match(unit(random(9, 1)), np.zeros((0, DIM), dtype=np.float32)).shape == (0, 2)
