"""The memory of a GPU that training and rendering need.

Upper estimates: the tensors that are alive at once, as ``triton_kernels`` makes them (gsplat's are of the
same order), for as many hits of tiles per Gaussian as close views have. Parts that follow each other are
added up: the allocator keeps blocks in sizes that nothing fits into any more.
"""

from collections.abc import Sequence

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.settings import TrainingSettings, sh_coefficient_count
from fvs_engine.splat.views import TrainingView

_FLOAT_BYTES = 4
_COPIES = 7
"""Adding Gaussians: counted in Triton's interpreter were 5.9 copies of degree 3, and 6.9 of degree 0, of the
larger number; a step has parameters, gradients and two moments."""
_SPLAT_BYTES = 300
"""Per Gaussian and camera: record, radius, sort by depth, counts, starts, gradients on the screen."""
_HIT_BYTES = 56
"""Per hit of a tile: the lists and their sort, or the rows of the backward pass."""
_TRAINING_HITS, _RENDERING_HITS = 16, 8
"""Hits per Gaussian: in a training image, with room to spare, and in the mean of many renders."""
_TARGET_PIXEL_BYTES = 3 + 4
"""A photograph, and its mask."""
_TRAINING_PIXEL_BYTES = 160
"""Image, gradient, and the maps of the loss."""
_RENDERED_PIXEL_BYTES = 200
"""Colour, alpha, a copy in planes, its spectrum, and the workspace of the Fourier transform."""


def training_bytes(settings: TrainingSettings, views: Sequence[TrainingView]) -> int:
    """What training with ``settings`` on ``views`` needs, when the model has become as large as it may."""
    per_gaussian = _COPIES * _parameter_bytes(settings.sh_degree) + _SPLAT_BYTES
    per_gaussian += _TRAINING_HITS * _HIT_BYTES
    pixels = [view.camera.width * view.camera.height for view in views]
    images = sum(pixels) * _TARGET_PIXEL_BYTES + max(pixels, default=0) * _TRAINING_PIXEL_BYTES
    return settings.max_gaussians * per_gaussian + images


def model_bytes(gaussians: Gaussians) -> int:
    """What a model needs that is only rendered."""
    return len(gaussians) * _parameter_bytes(gaussians.sh_degree)


def view_bytes(gaussians: Gaussians, width: int, height: int) -> int:
    """What each of the views needs that are rendered and scored at once, beside the model."""
    per_gaussian = _SPLAT_BYTES + _RENDERING_HITS * _HIT_BYTES
    return len(gaussians) * per_gaussian + width * height * _RENDERED_PIXEL_BYTES


def _parameter_bytes(sh_degree: int) -> int:
    return _FLOAT_BYTES * (3 + 3 + 4 + 1 + 3 * sh_coefficient_count(sh_degree))
