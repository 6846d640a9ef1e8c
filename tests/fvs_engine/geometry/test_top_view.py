"""Maps from above; what they look like is tested with the trajectories."""

import numpy as np

from fvs_engine.geometry.top_view import TopView


def test_many_centres_need_little_memory() -> None:
    """An SVD of all centres with full matrices would need 20 GB."""
    centres = np.random.default_rng(0).normal(size=(50_000, 3)) * [5.0, 2.0, 1.0]
    rotations = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (50_000, 3, 3))  # y down is −y of the model
    seen = TopView(centres, rotations).project(centres)
    assert seen.shape == (50_000, 2)
    assert np.abs(np.corrcoef(seen[:, 0], centres[:, 0])[0, 1]) > 0.99


def test_one_place_and_two_places_have_a_map() -> None:
    for count in (1, 2):
        centres = np.arange(3.0 * count).reshape(count, 3)
        seen = TopView(centres, np.broadcast_to(np.eye(3), (count, 3, 3))).project(centres)
        assert np.isfinite(seen).all()
