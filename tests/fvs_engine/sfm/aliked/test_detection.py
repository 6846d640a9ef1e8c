import pytest
import torch
from torch import Tensor

from fvs_engine.sfm.aliked.detection import RADIUS, detect


def blob(scores: Tensor, x: float, y: float, height: float) -> None:
    rows, columns = (torch.arange(size, dtype=scores.dtype) for size in scores.shape)
    scores += height * torch.exp(-((rows[:, None] - y) ** 2 + (columns - x) ** 2) / 2.0)


def test_peaks_are_found_to_a_part_of_a_pixel_the_highest_first():
    scores = torch.zeros(40, 50)
    blob(scores, 12.3, 20.0, 0.6)
    blob(scores, 30.0, 9.7, 0.9)
    found = detect(scores, 0.2, 10)
    assert found.tolist() == [pytest.approx([30.0, 9.7], abs=0.15), pytest.approx([12.3, 20.0], abs=0.15)]
    # The refinement moves towards the true position from the pixel's centre.
    assert found[0, 1] < 9.95
    assert found[1, 0] > 12.05


def test_only_the_highest_are_kept_and_low_ones_never():
    scores = torch.zeros(40, 50)
    blob(scores, 10.0, 10.0, 0.5)
    blob(scores, 30.0, 30.0, 0.8)
    blob(scores, 40.0, 10.0, 0.1)
    assert len(detect(scores, 0.2, 10)) == 2
    assert detect(scores, 0.2, 1).tolist() == [pytest.approx([30.0, 30.0], abs=1e-4)]


def test_a_lower_peak_beside_a_higher_one_is_none():
    scores = torch.zeros(20, 20)
    scores[10, 10], scores[10, 10 + RADIUS] = 0.9, 0.8
    assert len(detect(scores, 0.2, 10)) == 1
    scores[10, 10 + RADIUS], scores[10, 11 + RADIUS] = 0.0, 0.8
    assert len(detect(scores, 0.2, 10)) == 2


def test_the_border_has_no_key_points():
    scores = torch.zeros(20, 20)
    for x, y in ((1, 10), (18, 10), (10, 0), (10, 19)):
        scores[y, x] = 0.9
    assert len(detect(scores, 0.2, 10)) == 0
