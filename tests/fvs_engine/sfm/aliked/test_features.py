import numpy as np
import pytest
import torch
from PIL import Image

import fvs_engine.sfm.aliked.features as features_module
from fvs_engine.sfm.aliked.features import MAX_KEYPOINTS, extract
from fvs_engine.sfm.aliked.network import DIM, Aliked


def test_key_points_are_in_pixels_of_the_photograph(monkeypatch: pytest.MonkeyPatch):
    """Whatever the weights are: the network is given any, and must find points all over the image."""
    monkeypatch.setattr(features_module, "LONG_SIDE_PX", 160)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = Aliked().eval()
    texture = np.random.default_rng(0).integers(0, 256, size=(50, 80, 3), dtype=np.uint8)
    image = Image.fromarray(texture).resize((320, 200), Image.Resampling.NEAREST)
    features = extract(network, image)
    assert 0 < len(features.keypoints) <= MAX_KEYPOINTS
    assert features.descriptors.shape == (len(features.keypoints), DIM)
    assert (features.keypoints.min(axis=0) < 40.0).all()
    assert (features.keypoints.max(axis=0) > (280.0, 160.0)).all()
    assert (features.keypoints >= 0.0).all()
    assert (features.keypoints <= (320.0, 200.0)).all()
