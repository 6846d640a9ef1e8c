import numpy as np
import pytest
from PIL import Image

from fvs_engine.images.sharpness import measure_sharpness


def test_sharpness_does_not_depend_on_contrast() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    dim = (noise // 4).astype(np.uint8)
    assert measure_sharpness(Image.fromarray(noise)) == pytest.approx(
        measure_sharpness(Image.fromarray(dim)), rel=0.1
    )
    assert measure_sharpness(Image.new("RGB", (64, 64), "grey")) == 1.0
