from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.sfm.growing.neighbours import ImageRetrieval, first_neighbours, neighbours_in_space
from fvs_engine.sfm.settings import GrowthSettings

SETTINGS = GrowthSettings()


def descriptors(name: str) -> NDArray[np.float32]:
    """Images whose number has the same tens show the same thing."""
    ten = int(name[:3]) // 10
    generator = np.random.default_rng(ten)
    shared = generator.random((60, 128), dtype=np.float32)
    return shared + 0.02 * np.random.default_rng(int(name[:3])).random((60, 128), dtype=np.float32)


def names(count: int) -> list[str]:
    return [f"{i:03}.jpg" for i in range(count)]


def retrieval(count: int, folder: Path) -> ImageRetrieval:
    return ImageRetrieval.open(folder / "words.npz", names(count), 0, descriptors)


def test_neighbours_are_near_in_order_added_last_and_similar(tmp_path: Path):
    earlier = [name for name in names(100) if name != "050.jpg"]
    earlier.append(earlier.pop(7))  # 007 was added last
    found = first_neighbours("050.jpg", earlier, retrieval(30, tmp_path), SETTINGS)
    assert found[:6] == [f"{i:03}.jpg" for i in (47, 48, 49, 51, 52, 53)]
    assert "007.jpg" in found
    assert {f"{i:03}.jpg" for i in range(51, 60)} <= set(found)
    assert "050.jpg" not in found
    assert len(found) == len(set(found))


def test_their_number_does_not_grow_with_the_scene(tmp_path: Path):
    known = retrieval(20, tmp_path)
    limit = 2 * SETTINGS.neighbours_in_order + SETTINGS.neighbours_recent + SETTINGS.neighbours_by_similarity
    for count in (5, 50, 500):
        found = first_neighbours("003.jpg", names(count), known, SETTINGS)
        assert 4 <= len(found) <= min(limit, count - 1)
        assert len(set(found)) == len(found)
        assert set(found) <= set(names(count)) - {"003.jpg"}
        assert {"002.jpg", "004.jpg"} <= set(found)


def test_the_vocabulary_is_computed_once(tmp_path: Path):
    first = retrieval(20, tmp_path).most_similar("015.jpg", names(20), 10)
    again = ImageRetrieval.open(tmp_path / "words.npz", [], 5, descriptors).most_similar(
        "015.jpg", names(20), 10
    )
    assert first == again
    assert set(first) == {f"{i:03}.jpg" for i in range(10, 20)}


def test_too_few_descriptors_for_a_vocabulary_still_give_neighbours(tmp_path: Path):
    empty = ImageRetrieval.open(tmp_path / "words.npz", names(3), 0, lambda _: np.zeros((0, 128), np.float32))
    assert empty.most_similar("009.jpg", names(30), 4) == names(4)


def test_neighbours_in_space_are_around_the_best_matched_ones():
    centres = {name: np.array([float(i), 0.0, 0.0]) for i, name in enumerate(names(60))}
    found = neighbours_in_space({"020.jpg": 300, "040.jpg": 200, "050.jpg": 20}, centres, SETTINGS)
    assert found[:6] == [f"{i:03}.jpg" for i in (19, 21, 39, 41, 49, 51)]
    assert len(found) == SETTINGS.neighbours_in_space
    assert neighbours_in_space({}, centres, SETTINGS) == []
    assert neighbours_in_space({"unregistered.jpg": 300}, centres, SETTINGS) == []
