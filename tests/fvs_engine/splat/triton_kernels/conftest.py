"""The scenes of the rasterisers, for kernels that Triton's interpreter runs where there is no device."""

import pytest
from raster_scenes import SCENES, Scene, build_scene


@pytest.fixture(params=SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return build_scene(request.param)
