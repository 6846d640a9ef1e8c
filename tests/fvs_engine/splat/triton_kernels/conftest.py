"""The scenes of the rasterisers, for kernels that Triton's interpreter runs where there is no device."""

from collections.abc import Callable

import pytest
import torch
from raster_scenes import FOR_THE_INTERPRETER, Scene, build_scene
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.raster.packed_view import PackedView


@pytest.fixture(scope="session")
def device() -> torch.device:
    """Where the kernels run."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


@pytest.fixture(params=FOR_THE_INTERPRETER)
def scene(request: pytest.FixtureRequest) -> Scene:
    return build_scene(request.param)


@pytest.fixture
def as_cameras(device: torch.device) -> Callable[..., Tensor]:
    """Makes the [C, 19] of a camera at several poses."""

    def build(camera: PinholeCamera, *poses: RigidTransform) -> Tensor:
        return torch.stack([torch.from_numpy(PackedView(camera, pose, 0).vector) for pose in poses]).to(
            device
        )

    return build
